"""Real nodes hear messages and requests as no sender should send them: no node ends, and none grows."""

import os
import random
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

try:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
        import rosidl_generator_py  # noqa: F401
        from hostile_messages import anything, healthy, hostile
        from rclpy.node import Node
        from rclpy.qos import DurabilityPolicy, QoSProfile
except ImportError:
    pytest.skip("needs the extra [ros]", allow_module_level=True)

from cmd_vel_guard.process import Runner
from turtlebot_gym_ros.base.executor import FastExecutor

NUMBERS = "-p max_linear:=0.2108 -p max_angular:=2.635 -p wheel_separation:=0.16 -p radius:=0.105 -p scan_x:=-0.032"
"""Of a Burger, for the guard."""
NODES = {
    "kalman_filter": "-p takes_fixes:=true",
    "waypoint_generator": "-p frame:=map",
    "velocity_controller": "-p start_enabled:=true",
    "localizer": "",
    "turtlebot_simulator": "",
    "cmd_vel_guard": f"{NUMBERS} -p collision_monitor:=true -p geofence:=3.0 -p require_standby:=true",
    "cmd_vel_standby": "",
    "data_logger": "-p output:=bag",
}
"""Nodes with their parameters. Each is in a namespace of its own, and alone there."""
RATE = 400.0
"""Messages and requests a second: on no topic a flood."""
REQUESTS = 50
"""Messages for each request of a service."""
GROWTH = 2**28
"""Most memory by which a node may grow after a tenth of the messages, bytes."""


def memory(process):
    """Return the memory that a process holds, bytes."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def interface(name):
    package, part, kind = name.split("/")
    return getattr(import_module(f"{package}.{part}"), kind)


class Attacker:
    """A node that publishes on all topics that other nodes hear, and calls all their services."""

    def __init__(self, runner, names, chance):
        self.node, self._chance = Node("attacker", context=runner.context), chance
        self._publishers, self._clients = [], []
        runner.add(self.node)
        for name in names:
            self._find(name, f"/{name}")

    def _find(self, name, space):
        deadline = time.monotonic() + 120.0
        while not (topics := self._ask("get_subscriber", name, space)) and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(0.5)  # the rest of them
        for topic, kinds in self._ask("get_subscriber", name, space):
            if topic != "/parameter_events":
                qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
                kind = interface(kinds[0])
                self._publishers.append((kind, self.node.create_publisher(kind, topic, qos)))
        for service, kinds in self._ask("get_service", name, space):
            self._clients.append(self.node.create_client(interface(kinds[0]), service))
        assert topics

    def _ask(self, what, name, space):
        try:
            return getattr(self.node, f"{what}_names_and_types_by_node")(name, space)
        except Exception:  # not there yet
            return []

    def _healthy(self, kind):
        message = healthy(kind)
        if hasattr(message, "header"):
            message.header.stamp = self.node.get_clock().now().to_msg()
            message.header.frame_id = self._chance.choice(("odom", "map"))
        return message

    def send(self, k):
        """Send one message, or call a service."""
        if k % REQUESTS == 0:
            client = self._chance.choice(self._clients)
            future = client.call_async(anything(client.srv_type.Request, self._chance, 20))
            client.remove_pending_request(future)
            return
        kind, publisher = self._chance.choice(self._publishers)
        (message,) = hostile(lambda: self._healthy(kind), 1, self._chance, share=0.2)
        publisher.publish(message)


@pytest.mark.parametrize(
    ("names", "number"),
    [
        pytest.param(["kalman_filter", "cmd_vel_guard"], 1500, marks=pytest.mark.nightly),
        pytest.param(list(NODES), 100_000, marks=pytest.mark.slow),
    ],
)
def test_no_node_ends_or_grows(names, number, tmp_path):
    number, held = int(os.environ.get("MESSAGES", number)), {}
    command = [sys.executable, "-m", "turtlebot_gym_ros"]
    logs = {name: (tmp_path / f"{name}.log").open("w+") for name in names}
    processes = {
        name: subprocess.Popen(
            [*command, name, "--ros-args", *NODES[name].split(), "-r", f"__ns:=/{name}"],
            cwd=tmp_path,
            stdout=logs[name],
            stderr=subprocess.STDOUT,
        )
        for name in names
    }
    runner = Runner(executor=FastExecutor)
    runner.start()
    try:
        attacker, began = Attacker(runner, names, random.Random(number)), time.monotonic()
        for k in range(number):
            attacker.send(k)
            if k % 100 == 0:
                ended = {name: process.returncode for name, process in processes.items() if process.poll() is not None}
                assert not ended, [(logs[name].seek(0), logs[name].read()[-3000:])[1] for name in ended]
            if k == number // 10:
                held = {name: memory(process) for name, process in processes.items()}
            time.sleep(max(0.0, began + k / RATE - time.monotonic()))
        time.sleep(2.0)
        assert all(process.poll() is None for process in processes.values())
        grown = {name: memory(process) - held[name] for name, process in processes.items()}
        print({name: f"{growth / 1e6:+.0f} MB, {memory(processes[name]) / 1e6:.0f} MB" for name, growth in grown.items()})
        assert max(grown.values()) < GROWTH, grown
    finally:
        runner.close()
        for process in processes.values():
            process.terminate()
        for process in processes.values():
            process.wait(30.0)
        for log in logs.values():
            log.close()
