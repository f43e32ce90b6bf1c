"""Real ROS 2 for the guard's tests: nodes and processes that are ended, and waiting for states."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
import warnings
from threading import Thread

import pytest

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
        import rclpy.node
        import rosidl_generator_py  # noqa: F401
except ImportError:
    pytest.skip("needs rclpy", allow_module_level=True)

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
if importlib.util.find_spec("cmd_vel_guard"):
    from cmd_vel_guard.process import prepare

    prepare()
else:
    collect_ignore_glob = ["test_*.py"]
PATIENCE = 30.0
"""Longest wait for a state, s: far above what it takes, so that only a missing state fails."""


@pytest.fixture(name="wait_for", scope="session")
def wait_for_fixture():
    return wait_for


def wait_for(what):
    """Wait until a condition holds, and return its value."""
    deadline = time.monotonic() + PATIENCE
    while not (value := what()):
        if time.monotonic() > deadline:
            pytest.fail(f"waited {PATIENCE} s in vain")
        time.sleep(0.005)
    return value


class Runner:
    """A context, and an executor that runs nodes in its own thread."""

    def __init__(self, arguments=()):
        self.context = Context()
        rclpy.init(args=list(arguments), context=self.context, signal_handler_options=rclpy.SignalHandlerOptions.NO)
        self._executor, self._nodes = SingleThreadedExecutor(context=self.context), []
        self._thread = Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self):
        while self.context.ok():
            try:
                self._executor.spin_once(timeout_sec=0.05)
            except ExternalShutdownException:
                return
            except Exception:
                if self.context.ok():
                    raise

    def add(self, node):
        self._nodes.append(node)
        self._executor.add_node(node)

    def close(self):
        self._executor.shutdown(timeout_sec=0.5)
        self.context.shutdown()
        self._thread.join(1.0)
        for node in self._nodes:
            node.destroy_node()


def running():
    runner = Runner()
    yield runner
    runner.close()


runner, another_runner = (pytest.fixture(running, name=name) for name in ("runner", "another_runner"))


@pytest.fixture
def make_runner():
    """Make runners with arguments, and close them."""
    made = []

    def make(*arguments):
        made.append(Runner(arguments))
        return made[-1]

    yield make
    for runner in made:
        runner.close()


class Peer:
    """An independent node: it receives topics, sends messages and calls services."""

    def __init__(self, runner):
        self.node, self._clients = rclpy.node.Node("peer", context=runner.context), {}
        runner.add(self.node)

    def hear(self, topic, message_type, qos=100):
        """Collect the messages of a topic; returns the growing list."""
        heard = []
        self.node.create_subscription(message_type, topic, heard.append, qos)
        return heard

    def speak(self, topic, message_type, qos=100):
        return self.node.create_publisher(message_type, topic, qos)

    def ask(self, service, service_type, request):
        """Call a service, and return the response."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(service_type, service)
        client, deadline = self._clients[service], time.monotonic() + PATIENCE
        wait_for(client.service_is_ready)
        while time.monotonic() < deadline:
            future, again = client.call_async(request), time.monotonic() + 1.0
            while not future.done() and time.monotonic() < again:
                time.sleep(0.002)
            if future.done():
                return future.result()
            client.remove_pending_request(future)  # it went to a killed server whose loss is not detected yet
        return pytest.fail(f"{service} did not answer")


@pytest.fixture
def peer(another_runner):
    return Peer(another_runner)


@pytest.fixture
def launch(tmp_path):
    """Start processes, and let none survive the test."""
    started = []

    def start(*arguments, **environment):
        process = subprocess.Popen(
            [sys.executable, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env={**os.environ, **environment},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGCONT)
            process.terminate()
    for process in started:
        try:
            process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            pytest.fail(f"{process.args} did not end at SIGTERM")
