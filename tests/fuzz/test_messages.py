"""Whatever a message holds, its conversion returns a value that a block can use, or refuses it with one line; no node ends."""

import itertools
import math
import random
import subprocess
import sys
import time
import warnings
from importlib import import_module

import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
    pytest.importorskip("rosidl_generator_py", reason="needs the extra [ros]")

from hostile_messages import healthy, hostile
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from cmd_vel_guard.process import Runner
from turtlebot_gym.parameters import is_covariance
from turtlebot_gym.values import Fix, Pose
from turtlebot_gym_ros.base.executor import FastExecutor
from turtlebot_gym_ros.node.block import FARTHEST
from turtlebot_gym_ros.node.convert import CONVERSIONS, conversion

KINDS = {kind.__name__: way for kind, way in CONVERSIONS.items()}


def numbers(value):
    """Yield all numbers of a value, without those of arrays, which may be infinite or NaN on purpose."""
    if isinstance(value, tuple):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, float):
        yield value


@pytest.mark.parametrize("number", [100, pytest.param(8000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", KINDS)
def test_a_message_is_read_or_refused_in_one_line(name, number):
    way, taken, chance = KINDS[name], 0, random.Random(number)
    for _ in range(number):
        message, began = hostile(lambda: healthy(way.message), chance), time.process_time()
        value, refusal = None, ""
        try:
            value = way.read(message)
        except ValueError as error:
            refusal = str(error)
        if value is None:
            assert 0 < len(refusal) < 600
            assert "\n" not in refusal
        else:
            taken += 1
            assert name in ("Clearance", "Fix", "InitialPose", "Scan", "GridMap") or all(map(math.isfinite, numbers(value)))
            pose = getattr(value, {"Fix": "pose", "GridMap": "origin"}.get(name, ""), value if name == "Pose" else ())
            assert all(abs(number) <= FARTHEST for number in pose)
        assert time.process_time() - began < 1.0
    assert taken or name in ("Located", "Transform", "Obstacles")


@pytest.mark.parametrize("tiny", [5e-324, 1e-320, 1e-170, 1e-16, 1e10, 1e170, 1e308, math.inf, -math.inf, math.nan, 0.0, -0.0])
@pytest.mark.parametrize("at", [0, 7, 35])
def test_a_fix_whose_variance_no_sensor_has_is_refused_for_it(tiny, at):
    message = healthy(conversion(Fix).message)
    message.pose.covariance[at] = tiny
    if at == 35 and (tiny == math.inf or tiny < 0.0):  # the heading was not measured
        assert conversion(Fix).read(message).R[2] == math.inf
        return
    with pytest.raises(ValueError, match="must state"):
        conversion(Fix).read(message)


def test_whether_numbers_are_a_covariance_is_known_for_all_that_a_float_can_hold():
    variances = (5e-324, 1e-170, 1.0, 1e308)
    for xx, yy, share in itertools.product(variances, variances, (-2.0, -0.5, 0.0, 0.5, 2.0, math.inf, math.nan)):
        xy = share * math.sqrt(xx) * math.sqrt(yy)
        if xy == 0.0 or abs(xy) > 1e-300:  # below, a float has no digits left
            is_one = abs(xy) <= math.sqrt(xx) * math.sqrt(yy)
            assert is_covariance((xx, yy, 1.0), (xy, 0.0, 0.0)) is is_one, (xx, yy, share)


@pytest.mark.parametrize("far", [1.0001e5, 3e9, 1e308])
@pytest.mark.parametrize("name", ["Pose", "State", "Odometry", "Estimate", "Fix", "GridMap"])
def test_what_is_farther_than_any_robot_is_refused_and_not_written(name, far):
    message = healthy(KINDS[name].message)
    where = message.info.origin if name == "GridMap" else message.pose
    where = getattr(where, "pose", where)
    where.position.y = -far
    with pytest.raises(ValueError, match="nothing is beyond 100000"):
        KINDS[name].read(message)
    where.position.y = -1e5
    value = KINDS[name].read(message)
    if name == "Pose":
        assert value.y == -1e5
        with pytest.raises(ValueError, match="nothing is beyond 100000"):
            KINDS[name].write(Pose(far, 0.0, 0.0), message.header)


# Real nodes.


BURGER = "-p max_linear:=0.2108 -p max_angular:=2.635 -p wheel_separation:=0.16 -p radius:=0.105 -p scan_x:=-0.032"
NODES = {
    "kalman_filter": "-p takes_fixes:=true",
    "cmd_vel_guard": f"{BURGER} -p collision_monitor:=true -p geofence:=3.0 -p require_standby:=true",
    "velocity_controller": "-p start_enabled:=true",
}
"""Nodes that move a robot, with their parameters. Each is in a namespace of its own, and alone there."""
MESSAGES, PERIOD = 1500, 0.0025
"""Number of messages, and the time between them, s: on no topic a flood."""


def publishers_of(node, name):
    """Return the type of each topic that a node hears, and a publisher on it."""
    deadline = time.monotonic() + 120.0
    topics = []
    while time.monotonic() < deadline and not topics:
        time.sleep(0.5)
        if (name, f"/{name}") in node.get_node_names_and_namespaces():
            topics = node.get_subscriber_names_and_types_by_node(name, f"/{name}")
    found, qos = [], QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for topic, kinds in topics:
        if topic != "/parameter_events":
            package, part, kind = kinds[0].split("/")
            found.append((getattr(import_module(f"{package}.{part}"), kind), topic))
    assert found
    return [(kind, node.create_publisher(kind, topic, qos)) for kind, topic in found]


@pytest.mark.slow
def test_no_node_ends(tmp_path):
    chance, runner, processes = random.Random(MESSAGES), Runner(executor=FastExecutor), {}

    def stamped(kind):
        message = healthy(kind)
        if hasattr(message, "header"):
            message.header.stamp = node.get_clock().now().to_msg()
            message.header.frame_id = chance.choice(("odom", "map"))
        return message

    for name, given in NODES.items():
        package = "cmd_vel_guard" if name.startswith("cmd_vel") else "turtlebot_gym_ros"
        command = [sys.executable, "-m", package, name, "--ros-args", *given.split(), "-r", f"__ns:=/{name}"]
        with (tmp_path / f"{name}.log").open("w") as log:
            processes[name] = subprocess.Popen(command, cwd=tmp_path, stdout=log, stderr=subprocess.STDOUT)
    runner.start()
    try:
        node = Node("attacker", context=runner.context)
        runner.add(node)
        publishers = [pair for name in NODES for pair in publishers_of(node, name)]
        for k in range(MESSAGES):
            kind, publisher = chance.choice(publishers)
            publisher.publish(hostile(lambda kind=kind: stamped(kind), chance))
            time.sleep(PERIOD)
            if k % 100 == 0 or k == MESSAGES - 1:
                ended = [name for name, process in processes.items() if process.poll() is not None]
                assert not ended, [(tmp_path / f"{name}.log").read_text()[-3000:] for name in ended]
    finally:
        runner.close()
        for process in processes.values():
            process.terminate()
            process.wait(30.0)
