"""Real ROS 2 for the tests: contexts and processes that are shut down, and waiting for states."""

import functools
import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
        import rclpy.node
        import rosidl_generator_py  # noqa: F401
except ImportError:
    pytest.skip("needs the extra [ros]", allow_module_level=True)

from bench import PATIENCE, Bench, wait_for

from cmd_vel_guard.discovery import prepare
from cmd_vel_guard.process import Runner
from turtlebot_gym_ros.base.executor import FastExecutor

prepare()


@pytest.fixture(name="wait_for", scope="session")
def wait_for_fixture():
    return wait_for


@pytest.fixture
def make_runner():
    """Return a function that starts a context and its executor's thread: each is as far away as another process."""
    made = []

    def make(*arguments):
        made.append(Runner(arguments, executor=FastExecutor))
        made[-1].start()
        return made[-1]

    yield make
    for runner in made:
        runner.close()


@pytest.fixture
def runner(make_runner):
    return make_runner()


@pytest.fixture
def another_runner(make_runner):
    return make_runner()


class Peer:
    """An independent node that shares nothing with the shell: it receives topics, sends messages and calls services."""

    def __init__(self, runner, name="peer"):
        self.node = rclpy.node.Node(name, context=runner.context)
        self.subscriptions = {}
        self._clients = {}
        runner.add(self)

    def hear(self, topic, message_type, qos=100):
        heard = []
        self.subscriptions[topic] = self.node.create_subscription(message_type, topic, heard.append, qos)
        return heard

    def speak(self, topic, message_type, qos=100):
        return self.node.create_publisher(message_type, topic, qos)

    def ask(self, service, service_type, request):
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
        pytest.fail(f"{service} did not answer")

    def close(self):
        self.node.destroy_node()


@pytest.fixture
def peer(another_runner):
    return Peer(another_runner)


@pytest.fixture
def launch(tmp_path):
    """Start processes, and let none survive the test."""
    started = []

    def start(*arguments, **environment):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        process = subprocess.Popen([sys.executable, *arguments], cwd=tmp_path, env={**os.environ, **environment}, **pipes)
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


@pytest.fixture
def make_bench(runner, peer):
    return functools.partial(Bench, runner, peer)


@pytest.fixture
def bench(make_bench):
    return make_bench()
