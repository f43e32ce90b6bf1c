"""The graph and a client whose types are built apart from Nav2's own definition, on the ways of nav2_simple_commander."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
from std_srvs.srv import SetBool

from cmd_vel_guard.reports import ERROR
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.node.errand import Failure

SIDE = 0.05
SIZE = 6.0, 4.0
"""Length and width of the hall, m."""
PATIENCE = 60.0
PROMPT = 5.0
"""Longest time from an event to its result, s."""


@pytest.fixture(scope="module")
def hall(tmp_path_factory, write_map):
    """The path of a map: a hall with pillars, and a corner without a door."""
    cells = np.zeros((round(SIZE[1] / SIDE), round(SIZE[0] / SIDE)), np.uint8)
    cells[[0, 1, -2, -1]] = cells[:, [0, 1, -2, -1]] = 1
    cells[:22, 94:96] = cells[20:22, 94:] = 1
    for x, y, size in ((1.2, 3.2, 4), (3.1, 0.6, 6), (4.4, 3.3, 3), (2.0, 1.0, 3)):
        row, column = round(y / SIDE), round(x / SIDE)
        cells[row - size : row + size, column - 3 : column + 3] = 1
    return write_map(tmp_path_factory.mktemp("hall"), np.where(cells[::-1] == 1, 0, 254).astype(np.uint8), resolution=SIDE)


@pytest.fixture
def robot(hall, interfaces, monkeypatch):
    """The graph in real time, in processes with our build of the messages."""
    for name, value in interfaces.items():
        monkeypatch.setenv(name, value)
    parameters = {"policy": "vfh", "noise": "wheel", "localizer": "match", "when_lost": "stop", "publish_tf": True}
    with Graph(world=str(hall), processes=True, speed=1.0, seed=4, **parameters) as graph:
        graph.wait_until(lambda graph: graph.time > 2.0)
        yield graph


class Client:
    """The client's process: it is told what to do, and its outcomes are read."""

    def __init__(self, variables, folder):
        self.errors = (folder / "errors").open("w+")
        words = [sys.executable, str(Path(__file__).with_name("nav2_client.py"))]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            words, stdin=pipe, stdout=pipe, stderr=self.errors, text=True, env={**os.environ, **variables}
        )

    def tell(self, do, **task):
        print(json.dumps({"do": do, **task}), file=self.process.stdin, flush=True)

    def hear(self, key):
        """Return the next outcome with a key."""
        (patience := Timer(PATIENCE, self.process.kill)).start()
        for line in self.process.stdout:
            if key in (told := json.loads(line)):
                patience.cancel()
                return told
        self.errors.seek(0)
        raise AssertionError(self.errors.read())

    def close(self):
        self.process.stdin.close()
        self.process.wait(30.0)
        self.errors.seek(0)
        return self.errors.read()


@pytest.fixture
def client(robot, theirs, tmp_path):
    client = Client(theirs, tmp_path)
    with client.errors, client.process.stdout, client.process.stdin:
        yield client
        client.process.kill()
        client.process.wait()


def distance(robot, goal):
    return math.dist(robot.latest["true_state"][:2], goal)


def far_goal(robot):
    """Return one of two places at least 2 m away."""
    return max(((1.0, 2.2), (4.8, 2.2)), key=lambda goal: distance(robot, goal))


def reached(robot, client):
    """The event is the first moment at which the robot stands at its goal."""
    x, y, heading = robot.latest["true_state"][:3]
    goal = min(
        ((x + 0.5 * math.cos(heading + turn), y + 0.5 * math.sin(heading + turn)) for turn in np.linspace(0.0, 6.0, 25)),
        key=lambda goal: math.dist(goal, (2.9, 2.1)),
    )
    client.tell("go", x=goal[0], y=goal[1])
    robot.wait_until(lambda graph: distance(graph, goal) < 0.15, timeout=PATIENCE)
    return time.monotonic(), "reached", Failure.NONE


def refused(robot, client, cases=iter(3 * [{"tree": "mine.xml"}, {"frame": "odom"}])):  # noqa: B008
    options = next(cases)
    client.tell("go", x=1.0, y=2.2, **options)
    code = Failure.BEHAVIOR_TREE if "tree" in options else Failure.NOT_LOCALIZED
    return client.hear("sent")["at"], "failed", code


def cancelled(robot, client):
    x, y = far_goal(robot)
    client.tell("go", x=x, y=y, cancel=2.0)
    return client.hear("cancels")["at"], "cancelled", Failure.NONE


def plant_of(robot):
    """Return the process of the simulated robot."""
    (plant,) = (process for process in robot._processes if "turtlebot_simulator" in process.args)
    return plant


def lost(robot, client):
    """The event is the moment from which no odometry comes, and so no estimate: the robot's process is suspended."""
    x, y = far_goal(robot)
    client.tell("go", x=x, y=y)
    robot.wait_until(lambda graph: graph.latest["true_state"].v > 0.1, timeout=PATIENCE)
    plant_of(robot).send_signal(signal.SIGSTOP)
    return time.monotonic(), "failed", Failure.NOT_LOCALIZED


@pytest.mark.nightly
def test_each_outcome_arrives_within_5_s_and_no_quality_of_service_is_incompatible(robot, client, peer, capfd):
    truth = robot.latest["true_state"]
    client.tell("set_pose", x=truth.x, y=truth.y, z=math.sin(0.5 * truth.theta), w=math.cos(0.5 * truth.theta))
    client.tell("wait")
    assert client.hear("end")["end"] == "active"
    late = {}
    for event in 5 * (refused, reached, cancelled, lost):
        at, end, code = event(robot, client)
        told = client.hear("end")
        late.setdefault(event.__name__, []).append(round(told["at"] - at, 2))
        assert (told["end"], told["code"]) == (end, code), told
        assert bool(told["said"]) == (code != Failure.NONE)
        assert told["incompatible"] == 0
        if event is reached:
            assert (told["heard"]["frame"], told["heard"]["recoveries"]) == ("map", 0)
            assert 0.0 < told["heard"]["left"] < 0.3
        if event is lost:
            plant_of(robot).send_signal(signal.SIGCONT)
            time.sleep(2.0)  # if the robot did not do what it was told meanwhile, a person lets it go on
            peer.ask("velocity_controller/enable", SetBool, SetBool.Request(data=True))
        robot.wait_until(lambda graph: not graph.latest["true_state"].v and graph.reports["localizer"][0] < ERROR[0])
    errors = client.close() + capfd.readouterr().err
    print(late)
    assert max(map(max, late.values())) < PROMPT, late
    assert not re.search("incompatible QoS", errors)
