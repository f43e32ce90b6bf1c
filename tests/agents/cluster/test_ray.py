"""Ray: the same results on a cluster as without it, also when a worker is killed, and one line where it cannot do the work."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from pathlib import Path

import numpy as np
import pytest

if importlib.util.find_spec("ray") is None:  # it is not imported here: it reads the environment then
    pytest.skip("needs the extra [cluster]", allow_module_level=True)

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # helpers, which workers import too
import processes

from turtlebot_gym_agents.cluster.drives import drives
from turtlebot_gym_agents.cluster.units import Store, complete
from turtlebot_gym_agents.cluster.workers import workers_on
from turtlebot_gym_agents.commands.cli import main

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.filterwarnings("ignore"),  # Ray's own, of sockets and processes that it leaves to the collector
]


def refused(address):
    """Return the one-line error of a refused command, which takes less than 25 s."""
    begun = time.monotonic()
    arguments = ["evaluate", "--policy", "bearing", "--episodes", "500", "--cluster", address]
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    assert not done.stdout
    (line,) = done.stderr.splitlines()
    assert time.monotonic() - begun < 25.0
    return line


COMMAND = [sys.executable, "-m", "turtlebot_gym_agents"]


class Cluster:
    """Nodes on this machine, as `ray start` starts them."""

    def __init__(self, variables, folder):
        self._variables, self._folder, self._nodes = variables, folder, []
        with socket.create_server(("0.0.0.0", 0)) as free:
            self.port = free.getsockname()[1]
        self.host = socket.gethostbyname(socket.gethostname())
        self.address = ""

    def start(self, *options, **variables):
        """Start a node."""
        log = (self._folder / f"node-{len(self._nodes)}").open("w")
        ray = [sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats"]
        ray += ["--object-store-memory", "100000000", *options]
        self._nodes.append(
            subprocess.Popen(ray, env={**self._variables, **variables}, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        )

    def head(self, *options, **variables):
        """Start the first node, and wait until it prints its address."""
        self.start("--head", "--port", str(self.port), "--include-dashboard", "false", *options, **variables)
        log = self._folder / "node-0"
        assert processes.wait_until(lambda: "ray start --address=" in log.read_text()), log.read_text()
        self.address = log.read_text().partition("ray start --address='")[2].partition("'")[0]

    def stop(self):
        for node in reversed(self._nodes):
            processes.end(node)


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Return a cluster without nodes; their processes are found by a mark in their environment, and end with the test."""
    mark = f"MARK{uuid.uuid4().hex}"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), *filter(None, sys.path)]))
    monkeypatch.setenv("RAY_AUTH_MODE", "token")  # as the page has it
    monkeypatch.setenv("RAY_AUTH_TOKEN", uuid.uuid4().hex * 2)
    made = Cluster({**os.environ, "TURTLEBOT_GYM_TEST": mark}, tmp_path)
    yield made
    made.stop()
    assert processes.wait_until(lambda: not processes.marked(mark), 30.0), processes.marked(mark)


def test_a_cluster_of_two_nodes_writes_the_same_file(cluster, tmp_path):
    cluster.head("--num-cpus", "1")
    cluster.start("--address", cluster.address, "--num-cpus", "1")
    second = tmp_path / "node-1"
    assert processes.wait_until(lambda: "Ray runtime started" in second.read_text()), second.read_text()
    paths = tmp_path / "cluster.json", tmp_path / "plain.json"
    arguments = ["evaluate", "--policy", "bearing", "--episodes", "5000", "--json"]
    command = [*COMMAND, *arguments, str(paths[0]), "--cluster", cluster.address, "--store", str(tmp_path / "store")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert main([*arguments, str(paths[1])]) == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    store = Store(tmp_path / "store")
    times = [store.get(path.stem).times for path in (tmp_path / "store").iterdir()]
    assert len({unit["process"] for unit in times}) == 2  # one core on each node


def test_a_killed_worker_changes_no_number(cluster):
    cluster.head("--num-cpus", "2")
    units = drives("bearing", env="turtlebot_gym/TurtleBotNav-v0", episodes=3000, seed=0)
    expected, killings = complete(units), []

    def kill(done):
        if done and not killings:
            killings.append(os.kill(process, signal.SIGKILL))

    with workers_on(cluster.address) as workers:
        process = complete(units[:1], workers=workers)[0].times["process"]
        results = complete(units, workers=workers, progress=kill)
    assert killings
    for result, other in zip(results, expected, strict=True):
        assert {name: value.tobytes() for name, value in result.arrays.items()} == {
            name: value.tobytes() for name, value in other.arrays.items()
        }


ABSENT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "turtlebot_gym_agents":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
"""
OTHER = """
import numpy
import importlib.metadata as m
v = m.version
m.version = lambda name: '1.0' if name == 'numpy' else v(name)
"""


@pytest.mark.parametrize(
    ("code", "options", "message"),
    [
        ("", ["--memory", "100000000"], "too little memory: a worker needs 524 MB, and its largest node gives 100 MB."),
        ("", None, "it asks for a token: set RAY_AUTH_MODE=token"),
        (ABSENT, [], "lacks a module, 'turtlebot_gym_agents': install the extra [cluster]"),
        (OTHER, [], f"has numpy 1.0, here it is {np.__version__}: results could differ."),
    ],
    ids=["memory", "token", "package", "version"],
)
def test_a_cluster_that_cannot_do_the_work_is_refused_in_one_line(cluster, tmp_path, monkeypatch, code, options, message):
    (tmp_path / "sitecustomize.py").write_text(code)
    there = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}"} if code else {}
    cluster.head("--num-cpus", "1", *(options or ()), **there)
    if options is None:
        for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN"):
            monkeypatch.delenv(name)
    assert message in refused(cluster.address)


def test_without_a_cluster_there_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        assert f"There is no cluster at {address}: nothing answers." in refused(address)
    assert f"There is no cluster at {address}: " in refused(address)
    assert "Ray is not running on this machine" in refused("auto")
