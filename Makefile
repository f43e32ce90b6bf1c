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
	$(PYTHON) -m venv $(VENV)
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]'
	@touch $@

SQUARE := turtlebot_gym/TurtleBotSquare-v0

##@ See it
demo: $(READY)  ## drive a noisy TurtleBot on an EKF's estimate, train a policy, and put it into a live ROS graph
	@mkdir -p $(OUT)
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --robot tutorial --switch time --episodes 40 --plot $(OUT)/square_by_time.png --force
	@if [ -f $(DATA)/wifibot1.txt ]; then \
		$(RUN)turtlebot-gym replay $(DATA)/wifibot1.txt --plot $(OUT)/replay.png --force; \
	else echo "There is no recorded drive in $(DATA): the replay is left out: turtlebot-gym data fetch gets one."; fi
	$(RUN)turtlebot-gym evaluate --policy proportional bearing ppo-nav --noise tutorial documented \
		--json $(OUT)/nav.json --plot $(OUT)/nav.png --force
	$(RUN)turtlebot-gym train --env $(SQUARE) --steps 1500000 --out $(OUT)/square --resume
	$(RUN)turtlebot-gym evaluate --env $(SQUARE) --policy bearing $(OUT)/square/policy.onnx
	$(RUN)python -m turtlebot_gym_ros bringup --policy $(OUT)/square/policy.onnx --duration 40 --figure $(OUT)/graph.png --force
	$(RUN)turtlebot-gym watch --env turtlebot_gym/TurtleBotRooms-v0 --world office --policy vfh ppo-rooms --seed 1 \
		--html $(OUT)/rooms.html
	@echo
	@echo "Look at what is in $(OUT)/:"
	@echo "  rooms.html           open it in a browser: two policies in a room side by side; play and scrub"
	@echo "  square_by_time.png   the tutorial's square on raw odometry and on the filter's estimate"
	@if [ -f $(OUT)/replay.png ]; then echo "  replay.png           the filter on a recorded drive of a real robot"; fi
	@echo "  nav.png              paths of three policies to the same goal"
	@echo "  graph.png            the policy that was just trained, in the live ROS graph"
	@echo "  square/policy.onnx   that policy: $(RUN)turtlebot-gym watch --env $(SQUARE) --policy $(OUT)/square/policy.onnx"

##@ Test
# What the tests use; several compile faster in one process, since systems share most kernels.
COMPILED := nav kalman wheels gated mixture scale kalman+fixes wheels+fixes mixture+fixes rooms-kalman rooms-wheels \
            rooms-localized
ELSEWHERE := not slow and not clients and not cluster and not browser
# Reordered, the files of the fewest tests, which last longest, would come last.
IN_PARALLEL := -n 3 --dist loadfile --no-loadscope-reorder

test: $(READY)  ## what one runs before each commit (6 to 8 minutes)
	$(RUN)turtlebot-gym compile --system $(COMPILED)
	$(RUN)python -m pytest $(IN_PARALLEL) -m "$(ELSEWHERE) and not nightly"

test-all: $(READY)  ## the same, and pages that train, further live graphs, and statistics of size (20 minutes)
	$(RUN)turtlebot-gym compile --system $(COMPILED)
	$(RUN)python -m pytest $(IN_PARALLEL) -m "$(ELSEWHERE)"

test-slow: $(READY)  ## the tests that take minutes
	$(RUN)python -m pytest -m slow

fuzz: $(READY)  ## more than 30,000 inputs of all kinds: each ends in success or in one line, with bounded time and memory (part of test-slow; 12 minutes)
	$(RUN)python -m pytest -m slow tests/fuzz

test-cluster: $(READY)  ## Ray, which it installs: the same results on a cluster, kills, errors (5 minutes)
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[cluster]'
	$(RUN)python -m pytest -m cluster tests/agents/cluster

CHROMIUM ?= $(shell command -v chromium || command -v chromium-browser || command -v google-chrome)

test-browser: $(READY)  ## the viewer, the field test's report and every page of the documentation in headless Chromium; no request leaves the machine (6 minutes)
	@test -n "$(CHROMIUM)" || { echo "make test-browser needs Chromium: sudo apt-get install chromium"; exit 2; }
	@mkdir -p $(OUT)/browser
	CHROMIUM=$(CHROMIUM) SCREENSHOTS=$(OUT)/browser $(RUN)python -m pytest -m browser tests/browser

KILTED := .venv-kilted

test-kilted:  ## the ROS nodes on ROS 2 Kilted, in an environment of their own
	$(PYTHON) -m venv $(KILTED)
	grep -v '^ros-' constraints.txt > $(KILTED)/constraints.txt
	$(KILTED)/bin/python -m pip install --quiet --disable-pip-version-check --constraint $(KILTED)/constraints.txt \
		--editable '.[ros-kilted,deploy,dev]'
	$(KILTED)/bin/python -m pytest -m "not slow" tests/bridges/test_guard.py tests/bridges/test_lockstep_graph.py \
		tests/bridges/test_namespaces.py tests/bridges/test_convert.py

CLIENTS := .venv-clients

test-clients: $(READY)  ## train with every RL library, each in an environment of its own, and drive the policies (8 minutes, and the installations)
	$(RUN)python tests/clients/environments.py $(CLIENTS)
	$(RUN)python -m pytest -m clients tests/clients --clients-json benchmarks/clients.json

check: $(READY)  ## style, types, the direction of imports, and spelling
	$(RUN)ruff check
	$(RUN)ruff format --check
	$(RUN)pyright --pythonpath $(RUN)python
	$(RUN)lint-imports
	$(RUN)codespell

##@ Measure speed
SPEED ?= $(OUT)/speed

bench: $(READY)  ## speed by wall time and CPU seconds, as ratios in one run, alone and beside busy processes (4 minutes)
	$(RUN)turtlebot-gym benchmark --busy 4 --json $(SPEED).json --plot $(SPEED).png --force

bench-peers: $(READY)  ## the same, beside gymnax and EnvPool in environments of their own (6 minutes; 2 GB)
	$(RUN)turtlebot-gym benchmark --busy 4 --peers $(OUT)/peers --json $(SPEED).json --plot $(SPEED).png --force

BEFORE ?= benchmarks/speed_zen5.json

bench-check: $(READY)  ## whether a ratio has lost more than a quarter against BEFORE=benchmarks/speed_zen5.json (a minute)
	$(RUN)turtlebot-gym benchmark --check $(BEFORE) --seconds 0.15

AGAINST ?= ../before

bench-pairs: $(READY)  ## whether the step has lost more than 3 % against another clone, AGAINST=../before, in pairs of turns (2 minutes)
	$(RUN)turtlebot-gym benchmark --against $(AGAINST) --rounds 21

bench-train: $(READY)  ## from command to policy: what train takes beside the learning, alone and beside busy processes (10 minutes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/command_to_policy.py --busy 4 --json $(OUT)/command_to_policy.json

bench-from: $(READY)  ## trainings that begin with a known policy, beside plain ones, 5 seeds (20 minutes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/from_policy.py --json $(OUT)/from_policy.json

##@ Document
notebooks: $(READY)  ## execute the notebooks and store their outputs
	$(RUN)python notebooks/execute.py notebooks/*.ipynb

docs: $(READY)  ## build the documentation into out/docs
	DISABLE_MKDOCS_2_WARNING=true NO_MKDOCS_2_WARNING=true $(RUN)python -m mkdocs build --strict --site-dir $(abspath $(OUT))/docs

VERSION ?= $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' turtlebot_gym/__init__.py)

publish-docs: $(READY)  ## build the pages of VERSION into the branch gh-pages, beside those of other versions, and push it
	VERSIONS=mike DISABLE_MKDOCS_2_WARNING=true NO_MKDOCS_2_WARNING=true PATH="$(abspath $(RUN)):$$PATH" \
		$(RUN)mike deploy --push --update-aliases $(basename $(VERSION)) latest
	$(RUN)mike set-default --push latest

##@ Measure the results on the pages
bench-ros: $(READY)  ## the live graph: latency, jitter, CPU, memory, time to a stop (15 minutes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/ros.py --json $(OUT)/ros.json

bench-ros-layer: $(READY)  ## what the safety layer adds to the controller in the live graph: CPU and delay (7 minutes)
	$(RUN)python benchmarks/ros.py --only layer --json benchmarks/ros_layer.json

bench-lockstep: $(READY)  ## the live graph and the environment: equality, speed, real time under load (15 minutes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/lockstep.py --json $(OUT)/lockstep.json

bench-lockstep-office: $(READY)  ## 100 offices in the live graph, with the planner within the safety layer: to the bit, and as a TurtleBot3 speaks (15 minutes)
	$(RUN)python benchmarks/lockstep.py --only rooms --rooms 100 --room-world office --room-policy planner+safety \
		--no-room-processes --json benchmarks/lockstep_office.json
	$(RUN)python benchmarks/as_robot.py --drives 100 --guarded 0 --live 0 --world office --policy planner+safety \
		--kept $(OUT)/as_robot_office --json benchmarks/as_robot_office.json

bench-rooms: $(READY)  ## rooms: rays, steps, maps and the making of worlds, beside IR-SIM (3 minutes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/rooms.py --peer $(OUT)/irsim --json $(OUT)/rooms.json

bench-barn: $(READY)  ## baselines and the oracle in the 200 worlds of the BARN challenge (half an hour; resumes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/barn.py $(DATA)/barn/worlds.npz --json $(OUT)/barn.json

bench-buildings: $(READY)  ## the localizer on recordings of two real buildings, under fourteen conditions (2 minutes)
	$(RUN)python benchmarks/buildings.py --data $(DATA)

bench-estimation: $(READY)  ## filters beside the bound that no filter can pass, 20,000 drives in each setting (3 minutes)
	$(RUN)python benchmarks/estimation.py

bench-blind: $(READY)  ## true contacts with LiDARs that see a part of the circle, or measure in another unit (2 hours)
	$(RUN)python benchmarks/blind.py

bench-arrival: $(READY)  ## when a robot should believe that it has arrived: rules side by side (2 minutes)
	$(RUN)python benchmarks/arrival.py

bench-localization: $(READY)  ## the localizer in rooms: errors, honesty, wrong maps and wheels, speed (2 minutes)
	$(RUN)python benchmarks/localization.py

bench-missions: $(READY)  ## goals in turn for ten minutes: on wheels, localized, and on the truth (2 minutes)
	$(RUN)python benchmarks/missions.py

bench-belief: $(READY)  ## trainings on the truth, on wheels and on the localizer, all driven on its belief (40 minutes; resumes)
	$(RUN)python benchmarks/belief.py

bench-people: $(READY)  ## among people who walk: geometry, a stop by rule, a stop that was learned, and one that knows (15 minutes)
	$(RUN)python benchmarks/people.py

bench-planner: $(READY)  ## rooms with a memory, and within the safety layer: the planner, and ppo-rooms (10 minutes; resumes)
	$(RUN)python benchmarks/rooms_study.py --seeds 0 --keep --policy planner+safety \
		--only dense office cellular corridor crowd --out $(OUT)/planner
	cp $(OUT)/planner/rooms_study.json benchmarks/rooms_planner.json

bench-planner-lidars: $(READY)  ## the planner within the safety layer with other LiDARs (8 minutes; resumes)
	$(RUN)python benchmarks/rooms_study.py --seeds 0 --policy planner+safety --out $(OUT)/planner_lidars \
		--only 'dense, lds02' 'dense, a1' 'dense, ideal' 'office, lds02' 'office, a1' 'office, ideal' \
		'cellular, lds02' 'cellular, a1' 'cellular, ideal' 'corridor, lds02' 'corridor, a1' 'corridor, ideal'
	cp $(OUT)/planner_lidars/rooms_study.json benchmarks/rooms_planner_lidars.json

bench-planner-wheel: $(READY)  ## the same, bare too, with the noise of wheels that sway in turns (15 minutes; resumes)
	$(RUN)python benchmarks/rooms_study.py --seeds 0 --keep --policy planner planner+safety --out $(OUT)/planner_wheel \
		--episodes 500 --only 'dense, noise wheel' 'office, noise wheel' 'cellular, noise wheel' 'corridor, noise wheel'
	cp $(OUT)/planner_wheel/rooms_study.json benchmarks/rooms_planner_wheel.json

bench-known-map: $(READY)  ## offices with and without the localizer's map in the planner (2 minutes)
	$(RUN)python benchmarks/known_map.py --world office

bench-fix: $(READY)  ## wheel odometry with fixes from outside, in time, late, and late but taken for new (5 minutes)
	$(RUN)python benchmarks/fix.py

bench-calibration-intervals: $(READY)  ## whether intervals hold the truth, by a simulator that shares no code: 200 drives in 8 settings (20 minutes; resumes)
	$(RUN)python benchmarks/calibration_intervals.py --kept $(OUT)/calibration_intervals.jsonl

bench-calibration-by-map: $(READY)  ## whether intervals by a map hold the truth in 200 simulated offices, and halves of a building (30 minutes; resumes)
	$(RUN)python benchmarks/calibration_by_map.py --data $(DATA) --kept $(OUT)/calibration_by_map.jsonl

bench-calibration: $(READY)  ## whether intervals from innovations alone hold the truth, and what a calibration is worth (20 minutes; resumes)
	$(RUN)python benchmarks/calibration.py --kept $(OUT)/calibration
	$(RUN)python benchmarks/calibration.py --part recorded --data $(DATA)

bench-calibration-policy: $(READY)  ## what a policy trained on a calibrated file loses against one trained on the truth (25 minutes; resumes)
	$(RUN)python benchmarks/calibration_policy.py --first 3 --seeds 7 --kept $(OUT)/calibration_policy

bench-as-robot: $(READY)  ## rooms in the live graph by a simulator that speaks like a TurtleBot3, with and without the monitor (half an hour; resumes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/as_robot.py --kept $(OUT)/as_robot --json $(OUT)/as_robot.json

bench-cluster: $(READY)  ## Ray: what a unit of work costs with 1 and 2 workers, and what breaks first with 1,000 (5 minutes)
	$(RUN)python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[cluster]'
	$(RUN)python benchmarks/cluster.py

study: $(READY)  ## what learning is worth: train and tune it all, ship the policies (half an hour; an interrupted run resumes)
	$(RUN)python benchmarks/robustness.py
	$(RUN)python benchmarks/pretrained.py
	$(RUN)python benchmarks/publish.py

study-rooms: $(READY)  ## who finds the way through rooms: train ppo-rooms, drive all policies, ship it (two hours; resumes)
	$(RUN)python benchmarks/rooms_study.py
	$(RUN)python benchmarks/publish.py

study-transfer: $(READY)  ## what carries over from the unicycle to MuJoCo: policies and filters, with grip and without (20 minutes; resumes)
	$(RUN)python benchmarks/transfer.py

faults: $(READY)  ## 103 kinds of fault, 10 times each, injected into live chains, with a driver that may lie and an independent judge (an hour; resumes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/faults.py --kept $(OUT)/faults.jsonl --json benchmarks/faults.json

liars: $(READY)  ## 14 lies of a driver, ten times each: time and way until the robot stands, cause, and whether it stays (20 minutes; resumes)
	@mkdir -p $(OUT)
	$(RUN)python benchmarks/liars.py --kept $(OUT)/liars.jsonl --json benchmarks/liars.json

planted: $(READY)  ## defects planted in copies: whether the faults, or a test, notice each (half an hour; --named: 15 minutes)
	$(RUN)python benchmarks/faults_planted.py --json benchmarks/faults_planted.json

##@ Package
build: $(READY)  ## build wheel and source distribution into dist
	rm -rf dist && $(RUN)python -m build --quiet

release-check: $(READY)  ## make wheel, source distribution, site and container of a clean tree, install each alone, and try it (10 minutes)
	.ci/release-check $(PYTHON) $(OUT)/release

image:  ## a container image, turtlebot-gym, for machines without Linux; needs docker
	docker build --tag turtlebot-gym .

clean:  ## remove the virtual environment and all output
	rm -rf $(VENV) $(KILTED) $(CLIENTS) $(OUT) dist build
