"""Real nodes hear messages as no sender should send them: no node ends."""

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
from turtlebot_gym_ros.base.executor import FastExecutor

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
