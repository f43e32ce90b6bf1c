"""Workers of this machine: the same files with any number of them, and nothing lost or repeated when they are killed."""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # helpers, which workers import too
import killed
import processes

from turtlebot_gym_agents import provenance
from turtlebot_gym_agents.cluster.drives import drives
from turtlebot_gym_agents.cluster.units import Store, complete
from turtlebot_gym_agents.cluster.workers import workers_on
from turtlebot_gym_agents.commands.cli import main

NAV = "turtlebot_gym/TurtleBotNav-v0"
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


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    """Let workers import what this process can, and return a mark that identifies them and their children."""
    mark = f"MARK{uuid.uuid4().hex}"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), *filter(None, sys.path)]))
    return mark


def written(command, folder, monkeypatch, *options):
    """Return the file that a command writes, except its times."""
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(provenance, "_commit", lambda: "one")  # a commit in the middle of the test is no difference
    (folder / "tiny.yaml").write_text(YAML)
    (folder / "study.yaml").write_text(STUDY)
    assert main([*COMMANDS[command], "--json", "out.json", *options]) == 0
    content = json.loads((folder / "out.json").read_text())
    content.pop("times", None)
    return json.dumps(content, indent=1)


@pytest.mark.parametrize(
    ("command", "counts"),
    [("evaluate", (2,)), *(pytest.param(name, (1, 2, 4), marks=pytest.mark.nightly) for name in COMMANDS)],
)
def test_any_number_of_workers_writes_the_same_file_as_none(command, counts, tmp_path, monkeypatch):
    expected = written(command, tmp_path / "plain", monkeypatch)
    for workers in counts:
        content = written(command, tmp_path / str(workers), monkeypatch, "--cluster", "local", "--workers", str(workers))
        assert content == expected, workers


class Counting(Store):
    """A store that counts what is put into it."""

    def __init__(self, folder):
        super().__init__(folder)
        self.counts = {}

    def put(self, key, result):
        self.counts[key] = self.counts.get(key, 0) + 1
        super().put(key, result)


@pytest.mark.parametrize("kills", [1, pytest.param(20, marks=pytest.mark.nightly)])
def test_a_killed_worker_repeats_only_running_units(kills, tmp_path):
    """In each run one of two workers is killed in the middle of a unit, and the other one is in the middle of one, too."""
    random.seed(7)
    with workers_on("local", workers=2) as workers:
        for number in range(kills):
            folder, after = tmp_path / str(number), random.randrange(1, 6)
            store, running = Counting(folder / "store"), {}
            units = [killed.Logged(number=unit, folder=str(folder), holds=unit >= after) for unit in range(8)]

            def kill(done, folder=folder, running=running, after=after):
                if done < after or running:
                    return
                while len(running) < 2:  # these units do not end
                    log = killed.read(folder)
                    ended = {unit for event, unit, _ in log if event == "end"}
                    running |= {unit: process for event, unit, process in log if event == "begin" and unit not in ended}
                (folder / "go").touch()
                os.kill(running[random.choice(sorted(running))], signal.SIGKILL)

            results = complete(units, workers=workers, store=store, progress=kill)
            assert [result.facts["number"] for result in results] == list(range(8))  # nothing lost
            assert list(store.counts.values()) == [1] * 8  # nothing stored twice
            begun = [unit for event, unit, _ in killed.read(folder) if event == "begin"]
            assert sorted(begun) == sorted([*range(8), *running])


def test_workers_that_die_again_and_again_end_the_work(tmp_path):
    with workers_on("local", workers=2) as workers, pytest.raises(OSError, match="Workers have died 4 times: "):
        complete([killed.Deadly(folder=str(tmp_path))], workers=workers)
    assert len(killed.read(tmp_path)) == 4


def test_an_error_of_a_unit_is_that_of_the_command(capsys):
    assert main(["evaluate", "--policy", "nobody", "--episodes", "20", "--cluster", "local", "--workers", "2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "policy must be one of" in line


@pytest.mark.parametrize(
    "group", [pytest.param(False, marks=pytest.mark.nightly, id="one process"), pytest.param(True, id="all")]
)
def test_an_interrupt_ends_all_processes_and_the_work_resumes(group, tmp_path, environment):
    store, out = tmp_path / "store", tmp_path / "out.json"
    arguments = ["evaluate", "--policy", "bearing", "--episodes", "8000", "--json", str(out)]
    command = [sys.executable, "-m", "turtlebot_gym_agents", *arguments, "--cluster", "local", "--workers", "2"]
    command += ["--store", str(store)]
    variables = {**os.environ, "TURTLEBOT_GYM_TEST": environment}
    interruptible = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731  # a shell's background job ignores it
    process = subprocess.Popen(
        command, env=variables, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=interruptible
    )
    assert processes.wait_until(lambda: len([*store.glob("*.npz")]) >= 2)
    (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.strip() == f"turtlebot-gym: interrupted. The same command continues: finished episodes are in {store}."
    assert processes.wait_until(lambda: not processes.marked(environment), 20.0), processes.marked(environment)
    assert not out.exists()
    before = {path: path.stat().st_mtime_ns for path in store.glob("[0-9a-f]*.npz")}
    assert 2 <= len(before) < 32
    done = subprocess.run(command, env=variables, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(path.stat().st_mtime_ns == changed for path, changed in before.items())  # none was run again
    plain = tmp_path / "plain.json"
    assert main([*arguments[:-1], str(plain)]) == 0
    assert plain.read_bytes() == out.read_bytes()


def test_an_interrupted_pool_ends_without_a_traceback(tmp_path, monkeypatch):
    """Here, while the pool's thread, slowed down, has a unit to put into its pipe."""
    from joblib.externals.loky import process_executor

    thread, failures = process_executor._ExecutorManagerThread, []
    fast = thread.process_result_item
    monkeypatch.setattr(thread, "process_result_item", lambda self, item: (fast(self, item), time.sleep(0.2)))
    monkeypatch.setattr(threading, "excepthook", failures.append)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    with workers_on("local", workers=2) as workers:
        results = workers([(str(unit), killed.Logged(number=unit, folder=str(tmp_path))) for unit in range(8)])
        next(results)
        threading.Timer(0.1, signal.pthread_kill, [threading.get_ident(), signal.SIGINT]).start()
        with pytest.raises(KeyboardInterrupt):
            list(results)
    signal.signal(signal.SIGINT, before)
    assert not failures


def test_an_interrupt_reaches_no_worker_not_even_one_that_starts(tmp_path, environment, monkeypatch, capfd):
    monkeypatch.setenv("TURTLEBOT_GYM_TEST", environment)
    done = threading.Event()

    def interrupt():
        while not done.wait(0.01):
            for process in processes.marked(environment):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    units = [(str(unit), killed.Logged(number=unit, folder=str(tmp_path))) for unit in range(4)]
    with workers_on("local", workers=2) as workers:
        assert sorted(name for name, _ in workers(units)) == ["0", "1", "2", "3"]
    done.set()
    thread.join()
    assert capfd.readouterr().err == ""


FIRST = """
import killed
from turtlebot_gym_agents.cluster.workers import workers_on

with workers_on("local", workers=2) as workers:
    units = [(str(unit), killed.Logged(number=unit, folder=".")) for unit in range(4)]
    print({result.facts["hears"] for _, result in workers(units)})
"""


def test_the_first_workers_of_a_process_hear_no_interrupt_either(tmp_path):
    """With them starts the tracker of multiprocessing, which unblocks the signal."""
    done = subprocess.run([sys.executable, "-c", FIRST], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("{False}\n", "")


def test_workers_listen_nowhere(environment, monkeypatch):
    monkeypatch.setenv("TURTLEBOT_GYM_TEST", environment)
    before = processes.addresses([os.getpid()])
    with workers_on("local", workers=2) as workers:
        for _ in workers(
            [(str(seed), unit) for seed in range(2) for unit in drives("bearing", env=NAV, episodes=4, seed=seed)]
        ):
            family = processes.marked(environment)
            assert len(family) >= 1
            assert processes.addresses(family) == []
            assert processes.addresses([os.getpid()]) == before
