# Every target sets up what it needs, in .venv, from pinned versions. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/
DATA ?= $(if $(wildcard data/wifibot1.txt),data,../shared/data)
OUT ?= out
READY := $(VENV)/.ready
unexport PYTHONDONTWRITEBYTECODE  # tests start hundreds of processes: without bytecode each compiles all modules anew

.PHONY: $(shell sed -nE 's/^([a-z-]+):.*/\1/p' $(firstword $(MAKEFILE_LIST)))

help:  ## this list, as plain make prints it
	@awk -F ':.*## ' '/^##@/ {print "\n" substr($$0, 5)} /^[a-z-]+:.*## / { \
		line = sprintf("  %-18s", $$1); count = split($$2, words, " "); \
		for (at = 1; at <= count; at++) { \
			if (length(line " " words[at]) > 79) {print line; line = sprintf("%20s", "")} \
			line = line " " words[at]} \
		print line}' $(MAKEFILE_LIST)
	@echo
	@echo "Variables: PYTHON=$(PYTHON) makes .venv, OUT=$(OUT) takes results, DATA=$(DATA) has recorded drives."

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.12")'
	@echo "Installing what is pinned into $(VENV), once: 2 to 10 minutes, 3 GB, and 4 GB more with CUDA. A dot is 5 seconds."
	$(PYTHON) -m venv $(VENV)
	@(while sleep 5 && kill -0 $$$$; do printf .; done) 2>/dev/null & \
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]'; \
	code=$$?; kill $$!; echo; exit $$code
	@touch $@

SQUARE := turtlebot_gym/TurtleBotSquare-v0

##@ See it
demo: $(READY)  ## drive a noisy TurtleBot on an EKF's estimate, train a policy, and put it into a live ROS graph
	@mkdir -p $(OUT)
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --robot tutorial --switch time --episodes 40 \
		--policy bearing --observation odometry ekf --plot $(OUT)/square_by_time.png --force
	@if [ -f $(DATA)/wifibot1.txt ]; then \
		$(RUN)turtlebot-gym replay $(DATA)/wifibot1.txt --plot $(OUT)/replay.png --force; \
	else echo "There is no recorded drive in $(DATA): the replay is left out."; fi
	$(RUN)turtlebot-gym evaluate --policy proportional bearing ppo-nav --noise tutorial documented \
		--json $(OUT)/nav.json --plot $(OUT)/nav.png --force
	[ -f $(OUT)/square/policy.onnx ] || \
		{ rm -rf $(OUT)/square; $(RUN)turtlebot-gym train --env $(SQUARE) --out $(OUT)/square --plot $(OUT)/learning.png --force; }
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --policy bearing $(OUT)/square/policy.onnx
	$(RUN)python -m turtlebot_gym_ros bringup --policy $(OUT)/square/policy.onnx --duration 40 --figure $(OUT)/graph.png --force
	$(RUN)turtlebot-gym watch --env turtlebot_gym/TurtleBotRooms-v0 --world office --policy vfh ppo-rooms --seed 1 \
		--html $(OUT)/rooms.html
	@echo
	@echo "Look at what is in $(OUT)/:"
	@echo "  rooms.html           open it in a browser: two policies in a room over each other; play, and select times"
	@echo "  square_by_time.png   the tutorial's square on raw odometry and on the filter's estimate"
	@if [ -f $(OUT)/replay.png ]; then echo "  replay.png           the filter on a recorded drive of a real robot"; fi
	@echo "  nav.png              drives of three policies to the same goal, and whether the filter is as sure as it may be:"
	@echo "                       not under documented, whose bias of 2 cm no filter can see"
	@echo "  learning.png         goals reached and return during the training"
	@echo "  graph.png            the policy that was just trained, in the live ROS graph"
	@echo "  square/policy.onnx   that policy: $(RUN)turtlebot-gym watch --env $(SQUARE) --policy $(OUT)/square/policy.onnx"

##@ Test
ELSEWHERE := not slow and not clients and not cluster and not browser
# Reordered, the files of the fewest tests, which last longest, would come last.
IN_PARALLEL := -n 3 --dist loadfile --no-loadscope-reorder

test: $(READY)  ## before each commit: laws on a sample of their cases, and long tests of parts that the last commit touches (12 minutes)
	$(RUN)python -m pytest $(IN_PARALLEL) -m "$(ELSEWHERE) and not nightly"

test-all: $(READY)  ## all of that, pages that train, further live graphs, and statistics of size (45 minutes)
	$(RUN)python -m pytest $(IN_PARALLEL) -m "$(ELSEWHERE)"

test-slow: $(READY)  ## the tests that take minutes, among them more than 20,000 inputs of all kinds
	$(RUN)python -m pytest -m slow

CHROMIUM ?= $(shell command -v chromium || command -v chromium-browser || command -v google-chrome)

test-browser: $(READY)  ## the viewer in headless Chromium; no request leaves the machine (3 minutes)
	@test -n "$(CHROMIUM)" || { echo "make test-browser needs Chromium: sudo apt-get install chromium"; exit 2; }
	@mkdir -p $(OUT)/browser
	CHROMIUM=$(CHROMIUM) SCREENSHOTS=$(OUT)/browser $(RUN)python -m pytest -m browser tests/browser

CLIENTS := .venv-clients

test-clients: $(READY)  ## train with every RL library, each in an environment of its own, and drive the policies (8 minutes, and the installations)
	$(RUN)python tests/clients/environments.py $(CLIENTS)
	$(RUN)python -m pytest -m clients tests/clients --clients-json $(OUT)/clients.json

test-kilted: $(READY)  ## the guard and the live graph on ROS 2 Kilted, in an environment of its own
	$(RUN)python -m venv .venv-kilted && grep -v '^ros-' constraints.txt > .venv-kilted/constraints.txt
	.venv-kilted/bin/pip install --constraint .venv-kilted/constraints.txt --editable '.[ros-kilted,deploy,dev]'
	.venv-kilted/bin/python -m pytest -m "not slow" tests/guard/test_guard.py \
		tests/bridges/test_lockstep_graph.py tests/bridges/test_graph.py tests/bridges/test_convert.py

check: $(READY)  ## style, types, the direction of imports, and spelling
	$(RUN)ruff check
	$(RUN)ruff format --check
	$(RUN)pyright --pythonpath $(RUN)python
	$(RUN)lint-imports
	$(RUN)codespell

##@ Measure; benchmarks/README.md has the commands of all results
bench: $(READY)  ## speed by wall time and CPU seconds, as ratios in one run, alone and beside busy processes (4 minutes)
	$(RUN)python benchmarks/speed.py --json $(OUT)/speed.json

faults: $(READY)  ## 127 kinds of fault, 8 times each, injected into live chains, with a driver that may lie and an independent judge (an hour; resumes)
	$(RUN)python benchmarks/faults.py --kept $(OUT)/faults.jsonl

##@ Document
notebooks: $(READY)  ## execute the notebooks and store their outputs
	TURTLEBOT_GYM_DATA=$(abspath $(DATA)) $(RUN)python notebooks/execute.py notebooks/*.ipynb

docs: $(READY)  ## build the documentation into out/docs
	DISABLE_MKDOCS_2_WARNING=true NO_MKDOCS_2_WARNING=true $(RUN)python -m mkdocs build --strict --site-dir $(abspath $(OUT))/docs

##@ Package
build: $(READY)  ## build wheel and source distribution into dist
	rm -rf dist && $(RUN)python -m build --quiet

clean:  ## remove the virtual environment and all output
	rm -rf $(VENV) .venv-kilted $(CLIENTS) $(OUT) dist build
