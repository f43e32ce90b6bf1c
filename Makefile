# Every target sets up what it needs, in .venv, from pinned versions. PYTHON makes .venv, OUT takes results.
PYTHON ?= python3
OUT ?= out
RUN := .venv/bin/
READY := .venv/.ready
SQUARE := turtlebot_gym/TurtleBotSquare-v0
unexport PYTHONDONTWRITEBYTECODE  # tests start hundreds of processes: without bytecode each compiles all modules anew

.PHONY: help demo test test-all check bench docs notebooks clean

help:  ## this list, as plain make prints it
	@sed -nE 's/^([a-z-]+):.*## (.*)/  \1\t\2/p' Makefile | expand -t 14

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.12")'
	@echo "Installing what is pinned into .venv, once: 2 to 10 minutes, 3 GB, and 4 GB more with CUDA."
	$(PYTHON) -m venv .venv
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: $(READY)  ## drive on an EKF's estimate, train a policy, put the policy into a live ROS graph
	@mkdir -p $(OUT)
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --robot tutorial --switch time --episodes 40 \
		--policy bearing --observation odometry ekf --plot $(OUT)/square_by_time.png --force
	$(RUN)turtlebot-gym train --env $(SQUARE) --out $(OUT)/square --plot $(OUT)/learning.png --force
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --policy bearing $(OUT)/square/policy.onnx
	$(RUN)python -m turtlebot_gym_ros bringup --policy $(OUT)/square/policy.onnx --duration 40 --figure $(OUT)/graph.png --force
	$(RUN)turtlebot-gym watch --env turtlebot_gym/TurtleBotRooms-v0 --world office --policy vfh ppo-rooms --seed 1 \
		--html $(OUT)/rooms.html --force
	@echo "In $(OUT)/: square_by_time.png (the square on raw odometry and on the filter's estimate), learning.png (the training),"
	@echo "graph.png (that policy in the live ROS graph), square/policy.onnx (that policy), rooms.html (two policies in an office)."

# Reordered, the files of the fewest tests, which last longest, would come last.
PYTEST := $(RUN)python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

test: $(READY)  ## before each commit
	$(PYTEST) -m "not slow"

# One file of slow tests lasts longer than all others: the processes share its tests.
test-all: $(READY)  ## all tests; those of the viewer need Chromium, those of other libraries environments of their own
	$(PYTEST) --dist worksteal

check: $(READY)  ## style, types, the direction of imports, and spelling
	$(RUN)ruff check && $(RUN)ruff format --check && $(RUN)codespell
	$(RUN)pyright --pythonpath $(RUN)python
	$(RUN)lint-imports

bench: $(READY)  ## speed as ratios in one run, alone and beside busy processes; benchmarks/README.md has the other commands
	$(RUN)python benchmarks/speed.py --json $(OUT)/speed.json

notebooks: $(READY)  ## execute the notebooks and store their outputs
	$(RUN)python notebooks/execute.py notebooks/*.ipynb

docs: $(READY)  ## build the documentation into out/docs
	NO_MKDOCS_2_WARNING=true DISABLE_MKDOCS_2_WARNING=true $(RUN)python -m mkdocs build --strict --site-dir $(abspath $(OUT))/docs

clean:  ## remove the virtual environment and all output
	rm -rf .venv .venv-* $(OUT) dist build
