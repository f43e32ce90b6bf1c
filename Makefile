# Every target sets up what it needs, in .venv, from pinned versions. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/
DATA ?= ../shared/data
OUT ?= out
READY := $(VENV)/.ready

.PHONY: help demo test test-slow check bench build clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Python 3.10 or newer is needed: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]'
	@touch $@

demo: $(READY)  ## drive a noisy TurtleBot on an EKF's estimate, in numbers and in a picture
	@mkdir -p $(OUT)
	$(RUN)turtlebot-gym evaluate --env turtlebot_gym/TurtleBotSquare-v0 --robot tutorial --switch time \
		--policy proportional bearing --episodes 40 --json $(OUT)/square_by_time.json --plot $(OUT)/square_by_time.png
	$(RUN)turtlebot-gym evaluate --env turtlebot_gym/TurtleBotSquare-v0 --policy bearing --episodes 1 --seed 3 \
		--plot $(OUT)/square.png
	$(RUN)turtlebot-gym evaluate --noise tutorial documented rough --episodes 1000 --json $(OUT)/nav.json --plot $(OUT)/nav.png
	@if [ -f $(DATA)/wifibot1.txt ]; then \
		$(RUN)turtlebot-gym replay $(DATA)/wifibot1.txt --noise documented --plot $(OUT)/replay.png; \
	else echo "No recorded drives in $(DATA): the replay is left out."; fi
	@echo "The figures are in $(OUT)/."

test: $(READY)  ## all tests but the slow ones
	$(RUN)python -m pytest -n 2 --dist loadfile -m "not slow"

test-slow: $(READY)  ## the tests that take minutes
	$(RUN)python -m pytest -m slow

check: $(READY)  ## style, types and the direction of imports
	$(RUN)ruff check
	$(RUN)ruff format --check
	$(RUN)pyright --pythonpath $(RUN)python
	$(RUN)lint-imports

bench: $(READY)  ## speed, as ratios in one run
	@mkdir -p $(OUT)
	$(RUN)turtlebot-gym benchmark --json $(OUT)/speed.json

build: $(READY)  ## build the wheel, install it alone, and try it
	rm -rf dist && $(RUN)python -m build --quiet
	$(PYTHON) -m venv dist/try && dist/try/bin/pip install --quiet --constraint constraints.txt dist/*.whl
	cd dist && try/bin/turtlebot-gym evaluate --episodes 20

clean:  ## remove the virtual environment and all output
	rm -rf $(VENV) $(OUT) dist build
