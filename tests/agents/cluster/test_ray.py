"""Ray: the same results on a cluster as without it, also when a worker is killed, and one line where it cannot do the work."""

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

if importlib.util.find_spec("ray") is None:
    pytest.skip("needs the extra [cluster]", allow_module_level=True)

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # helpers, which workers import too
import jobs

from turtlebot_gym_agents.cluster import workers
from turtlebot_gym_agents.cluster.workers import results

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.filterwarnings("ignore"),  # Ray's own, of sockets and processes that it leaves to the collector
]
COMMAND = [sys.executable, "-m", "turtlebot_gym_agents", "evaluate", "--policy", "bearing", "--episodes", "1000"]
RAY = [sys.executable, "-m", "ray.scripts.scripts"]


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Return the address of a cluster of one node with two cores, as `ray start` starts it."""
    log = tmp_path_factory.mktemp("ray") / "log"
    path = os.pathsep.join([str(HERE), *filter(None, sys.path)])
    options = ["--head", "--port", "0", "--num-cpus", "2", "--include-dashboard", "false", "--block", "--disable-usage-stats"]
    with log.open("w") as file:
        environment = {**os.environ, "PYTHONPATH": path}
        node = subprocess.Popen([*RAY, "start", *options], env=environment, stdout=file, stderr=file)
    while "ray start --address='" not in log.read_text():
        assert node.poll() is None, log.read_text()
        time.sleep(0.1)
    yield log.read_text().partition("ray start --address='")[2].partition("'")[0]
    node.send_signal(signal.SIGTERM)
    node.wait(60)


def test_without_a_cluster_there_is_one_line(tmp_path):
    """Ray notes the machine's cluster in its temporary folder, which is another one here."""
    variables = {**os.environ, "RAY_TMPDIR": str(tmp_path)}
    done = subprocess.run([*COMMAND, "--cluster", "auto"], env=variables, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith("turtlebot-gym: ")
    assert done.stderr.count("\n") == 1


def test_a_cluster_writes_the_same_file(address, tmp_path):
    for name, options in (("plain", []), ("cluster", ["--cluster", address])):
        done = subprocess.run([*COMMAND, "--json", str(tmp_path / f"{name}.json"), *options], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "plain.json").read_bytes() == (tmp_path / "cluster.json").read_bytes()


def test_a_killed_worker_loses_no_job(address, tmp_path):
    def kill():
        while not jobs.begun(tmp_path):
            time.sleep(0.01)
        os.kill(jobs.begun(tmp_path)[0][1], signal.SIGKILL)
        (tmp_path / "go").touch()

    thread = threading.Thread(target=kill)
    thread.start()
    work = {str(number): partial(jobs.logged, number, str(tmp_path), holds=True) for number in range(4)}
    assert sorted(results(work, cluster=address)) == [(str(number), number) for number in range(4)]
    thread.join()


@pytest.mark.parametrize(
    ("job", "message"),
    [(partial(jobs.failing, ValueError("no good")), "a: no good"), (partial(jobs.deadly, "/tmp"), "has failed: ")],
    ids=["error", "death"],
)
def test_a_failure_is_one_line(address, job, message, tmp_path):
    with pytest.raises((ValueError, OSError), match=message) as failure:
        list(results({"a": job}, cluster=address))
    assert "\n" not in str(failure.value)


def test_a_node_with_other_code_is_refused(address, monkeypatch):
    monkeypatch.setattr(workers, "origin", lambda: {"numpy": "1.0"})
    with pytest.raises(OSError, match=r"The node .* has another .*: results could differ\."):
        list(results({"a": int}, cluster=address))
