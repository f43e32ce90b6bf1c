"""Ray: the same files as without it, nothing lost or repeated when workers are killed, clear ends, and localhost alone."""

import importlib.util
import json
import os
import random
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
sys.path.insert(0, str(HERE))  # helpers, which workers import as well
import killed
import processes

from turtlebot_gym_agents import provenance
from turtlebot_gym_agents.cluster.ray_workers import ray_workers
from turtlebot_gym_agents.cluster.store import Store
from turtlebot_gym_agents.cluster.units import drives, key
from turtlebot_gym_agents.cluster.work import complete
from turtlebot_gym_agents.commands.cli import main

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.filterwarnings("ignore"),  # Ray's own, of sockets and processes that it leaves to the collector
]
KILLS = int(os.environ.get("TURTLEBOT_GYM_KILLS", "20"))
LOOPBACK = {"0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000"}
YAML = """default:
  n_envs: 32
  n_timesteps: 1024
  policy: MlpPolicy
  n_steps: 16
  batch_size: 512
  learning_rate: 0.001
  policy_kwargs: {net_arch: [32, 32]}
"""
STUDY = """
episodes: 40
seed: 1000
grid: {noise: [clean, rough]}
policies: [bearing, proportional]
trainings:
  tiny: {seeds: 2, steps: 1024, evaluations: 1, episodes: 8, config: tiny.yaml}
"""
COMMANDS = {
    "evaluate": ["evaluate", "--policy", "bearing", "ppo-nav", "--noise", "tutorial", "rough", "--episodes", "600"],
    "train": ["train", "--config", "tiny.yaml", "--steps", "1024", "--evaluations", "1", "--seeds", "2", "--out", "runs"],
    "tune": ["tune", "--config", "tiny.yaml", "--steps", "512", "--trials", "3", "--generation", "2", "--out", "search"],
    "study": ["study", "study.yaml", "--out", "study"],
}


@pytest.fixture
def environment(monkeypatch):
    """What processes need that are started here, with a mark by which they and theirs are found."""
    mark = f"MARK{uuid.uuid4().hex}"
    path = os.pathsep.join([str(HERE), *filter(None, sys.path)])
    monkeypatch.setenv("PYTHONPATH", path)
    return mark, {**os.environ, "TURTLEBOT_GYM_TEST": mark, "PYTHONPATH": path}


def written(command, folder, monkeypatch, *options):
    """Return the file that a command writes, but for its times."""
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(provenance, "_commit", lambda: "one")  # a commit in the middle of the test is no difference
    (folder / "tiny.yaml").write_text(YAML)
    (folder / "study.yaml").write_text(STUDY)
    assert main([*COMMANDS[command], "--json", "out.json", *options]) == 0
    text = (folder / "out.json").read_text()
    content = json.loads(text)
    if "times" in content:
        del content["times"]
        text = json.dumps(content, indent=1)
    return text


@pytest.mark.parametrize("command", COMMANDS)
def test_any_number_of_workers_writes_the_same_file_as_no_ray(command, tmp_path, monkeypatch, capsys):
    expected = written(command, tmp_path / "plain", monkeypatch)
    for workers in (1, 2, 4):
        found = written(command, tmp_path / str(workers), monkeypatch, "--cluster", "local", "--workers", str(workers))
        assert found == expected, workers


class Counting(Store):
    """A store that counts what is put into it."""

    def __init__(self, folder):
        super().__init__(folder)
        self.counts = {}

    def put(self, key, result):
        self.counts[key] = self.counts.get(key, 0) + 1
        super().put(key, result)


def test_a_killed_worker_costs_its_unit_alone(tmp_path, environment):
    """In each of 20 runs a worker is killed in the middle of a unit."""
    random.seed(7)
    with ray_workers("local", workers=2) as workers:
        for number in range(KILLS):
            folder = tmp_path / str(number)
            store, gone = Counting(folder / "store"), []
            folder.mkdir(exist_ok=True)
            units = [killed.Logged(number=each, folder=str(folder), holds=each == 7) for each in range(8)]
            after = random.randrange(1, 6)

            def kill(done, folder=folder, gone=gone, after=after, store=store):
                if done < after or gone:
                    return
                stored, running = set(store.counts), []
                while not running:  # the last unit runs until a worker is killed
                    log = killed.read(folder)
                    ended = {one for what, one, _ in log if what == "end"}
                    running = [(one, process) for what, one, process in log if what == "begin" and one not in ended]
                os.kill(running[0][1], signal.SIGKILL)
                gone.append((running[0], stored))
                (folder / "go").touch()

            results = complete(units, workers=workers, store=store, progress=kill)
            assert gone, "no worker was killed"
            (victim, _), stored = gone[0]
            assert [result.facts["number"] for result in results] == list(range(8))  # nothing lost
            assert list(store.counts.values()) == [1] * 8  # nothing stored twice
            begun = [one for what, one, _ in killed.read(folder) if what == "begin"]
            again = {one for one in begun if begun.count(one) > 1}
            assert again <= {victim}, killed.read(folder)  # nothing else was done twice
            assert not {key(units[one]) for one in again} & stored
            assert len(begun) == 8 + len(again)


def test_a_worker_killed_in_an_evaluation_changes_no_number(environment):
    units = drives("bearing", env="turtlebot_gym/TurtleBotNav-v0", episodes=3000, seed=0)
    expected = complete(units)
    seen = []

    def kill(done):
        if done and not seen:
            seen.append(os.kill(pid[0], signal.SIGKILL))

    with ray_workers("local", workers=2) as workers:
        pid = [complete(units[:1], workers=workers)[0].times["process"]]
        found = complete(units, workers=workers, progress=kill)
    assert seen
    for one, other in zip(found, expected, strict=True):
        assert {name: value.tobytes() for name, value in one.arrays.items()} == {
            name: value.tobytes() for name, value in other.arrays.items()
        }


def command(*arguments):
    return [sys.executable, "-m", "turtlebot_gym_agents", *arguments]


def test_an_interrupt_ends_all_and_the_work_goes_on_later(tmp_path, environment):
    mark, variables = environment
    store = tmp_path / "store"
    asked = ["evaluate", "--policy", "bearing", "--episodes", "20000", "--json", str(tmp_path / "out.json")]
    asked += ["--cluster", "local", "--workers", "2", "--store", str(store)]
    process = subprocess.Popen(command(*asked), env=variables, stderr=subprocess.PIPE, text=True)
    assert processes.wait_until(lambda: len([*store.glob("*.npz")]) >= 2)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert not err.strip()
    assert processes.wait_until(lambda: not processes.marked(mark), 20.0), processes.marked(mark)
    assert not (tmp_path / "out.json").exists()
    before = {path: path.stat().st_mtime_ns for path in store.glob("[0-9a-f]*.npz")}
    assert 2 <= len(before) < 80
    done = subprocess.run(command(*asked), env=variables, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())  # none was done again
    plain = tmp_path / "plain.json"
    assert main(["evaluate", "--policy", "bearing", "--episodes", "20000", "--json", str(plain)]) == 0
    assert plain.read_bytes() == (tmp_path / "out.json").read_bytes()


def test_it_listens_on_localhost_alone(environment, monkeypatch):
    mark, _ = environment
    monkeypatch.setenv("TURTLEBOT_GYM_TEST", mark)
    before = processes.addresses([os.getpid()])
    with ray_workers("local", workers=1) as workers:
        complete(drives("bearing", env="turtlebot_gym/TurtleBotNav-v0", episodes=4, seed=0), workers=workers)
        family = processes.marked(mark)
        assert len(family) > 3  # GCS, raylet, worker
        found = processes.addresses(family)
        assert len(found) > 3
        assert set(found) <= LOOPBACK
        assert set(processes.addresses([os.getpid()])) <= LOOPBACK | set(before)
    assert processes.wait_until(lambda: not processes.marked(mark), 20.0)


def test_localhost_would_be_noticed():
    with socket.create_server(("0.0.0.0", 0)):
        assert not set(processes.addresses([os.getpid()])) <= LOOPBACK


def refused(*arguments):
    """Return the line in which a command says that it cannot be done, and how long that took."""
    begun = time.monotonic()
    asked = ["evaluate", "--policy", "bearing", "--episodes", "500", "--cluster", *arguments]
    done = subprocess.run(command(*asked), capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert not done.stdout
    return line, time.monotonic() - begun


def test_a_wrong_address_is_told_in_a_line(environment, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    line, seconds = refused(f"127.0.0.1:{port}")
    assert f"There is no cluster at 127.0.0.1:{port}" in line
    assert seconds < 15.0
    for address in ("everywhere", "ray://10.0.0.1:10001", ":6379"):
        assert "cluster must be 'local', 'auto' or HOST:PORT" in refused(address)[0]
    assert "workers is for the cluster 'local'" in refused("auto", "--workers", "2")[0]


def test_something_else_at_the_address_is_told_in_a_line(environment):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        line, seconds = refused(address)
    assert f"There is no cluster at {address}: nothing answers." in line
    assert seconds < 15.0


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
        """Start the first node, and wait until it says its address."""
        self.start("--head", "--port", str(self.port), "--include-dashboard", "false", *options, **variables)
        log = self._folder / "node-0"
        assert processes.wait_until(lambda: "ray start --address=" in log.read_text()), log.read_text()
        self.address = log.read_text().partition("ray start --address='")[2].partition("'")[0]

    def stop(self):
        for node in reversed(self._nodes):
            processes.end(node)


@pytest.fixture
def cluster(environment, tmp_path, monkeypatch):
    mark, variables = environment
    token = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": uuid.uuid4().hex * 2}  # as the page has it
    for name, value in token.items():
        monkeypatch.setenv(name, value)
    made = Cluster({**variables, **token}, tmp_path)
    yield made
    made.stop()
    assert processes.wait_until(lambda: not processes.marked(mark), 30.0), processes.marked(mark)


def test_a_cluster_of_two_nodes_does_the_same(cluster, tmp_path):
    cluster.head("--num-cpus", "1")
    cluster.start("--address", cluster.address, "--num-cpus", "1")
    second = tmp_path / "node-1"
    assert processes.wait_until(lambda: "Ray runtime started" in second.read_text()), second.read_text()
    paths = tmp_path / "cluster.json", tmp_path / "plain.json"
    asked = ["evaluate", "--policy", "bearing", "--episodes", "5000", "--json"]
    there = command(*asked, str(paths[0]), "--cluster", cluster.address, "--store", str(tmp_path / "store"))
    done = subprocess.run(there, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert main([*asked, str(paths[1])]) == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    store = Store(tmp_path / "store")
    times = [store.get(path.stem).times for path in (tmp_path / "store").iterdir()]
    assert len({one["process"] for one in times}) == 2  # one core on each node


def test_too_little_memory_is_told_in_a_line(cluster):
    cluster.head("--num-cpus", "1", "--memory", "100000000")
    line, seconds = refused(cluster.address)
    assert "has too little memory: a worker needs 524 MB, and its largest node gives 100 MB." in line
    assert seconds < 15.0


BLOCKER = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "turtlebot_gym_agents":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
"""


def test_a_cluster_without_the_package_is_told_in_a_line(cluster, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(BLOCKER)
    cluster.head("--num-cpus", "1", PYTHONPATH=f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}")
    line, seconds = refused(cluster.address)
    assert "lacks the module turtlebot_gym_agents: install turtlebot-gym[cluster]" in line
    assert seconds < 15.0


def test_other_code_on_a_node_is_told_in_a_line(cluster, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import numpy\nimport importlib.metadata as m\nv = m.version\n"
        "m.version = lambda name: '1.0' if name == 'numpy' else v(name)\n"
    )
    cluster.head("--num-cpus", "1", PYTHONPATH=f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}")
    line, _ = refused(cluster.address)
    assert f"has numpy 1.0, here it is {np.__version__}: results could differ." in line
