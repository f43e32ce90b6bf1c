"""Workers: the same results with any number of them, and nothing is lost when one is killed or the command is interrupted."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

pytestmark = pytest.mark.touched("agents/turtlebot_gym_agents/cluster", "tests/agents/cluster")

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # helpers, which workers import too
import jobs

from turtlebot_gym.extras import installing
from turtlebot_gym_agents import provenance
from turtlebot_gym_agents.cluster.drives import evaluate_all
from turtlebot_gym_agents.cluster.workers import RETRIES, results
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.provenance import plain

NAV, SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))
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
    "study": ["study", "study.yaml", "--out", "study"],
}


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


@pytest.mark.nightly
@pytest.mark.parametrize("command", ["evaluate", *(pytest.param(name, marks=pytest.mark.nightly) for name in COMMANDS)])
def test_two_workers_write_the_same_file_as_none(command, tmp_path, monkeypatch):
    expected = written(command, tmp_path / "plain", monkeypatch)
    assert written(command, tmp_path / "two", monkeypatch, "--cluster", "local", "--workers", "2") == expected


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "request_",
    [
        {"policy": "bearing", "env": NAV, "episodes": 51, "seed": 7},
        {"policy": "ppo-nav", "env": NAV, "episodes": 50, "seed": 0, "noise": "documented"},
        {"policy": "corner", "env": SQUARE, "episodes": 11, "seed": 0, "arrival": "belief"},
        {"policy": "vfh", "env": ROOMS, "episodes": 9, "seed": 0, "world": "clutter"},
    ],
    ids=["bearing", "bundle", "with memory of the course", "room"],
)
@pytest.mark.parametrize("chunk", [25, 2])
def test_an_evaluation_does_not_depend_on_how_it_is_split(request_, chunk):
    expected, counts = evaluate(**request_), []
    (split,) = evaluate_all([request_], chunk=chunk, progress=counts.append)
    assert counts[-1] == request_["episodes"]
    assert plain({"config": split.config, "summary": split.summary()}) == plain(
        {"config": expected.config, "summary": expected.summary()}
    )
    assert split.times().tobytes() == expected.times().tobytes()
    assert split.episodes.path.tobytes() == expected.episodes.path.tobytes()
    assert split.trajectory.true_state.tobytes() == expected.trajectory.true_state.tobytes()


def test_a_killed_worker_loses_no_job(tmp_path):
    """Of two workers that are in the middle of a job, one is killed."""

    def kill():
        while len(jobs.begun(tmp_path)) < 5:
            time.sleep(0.01)
        os.kill(dict(jobs.begun(tmp_path))[4], signal.SIGKILL)
        (tmp_path / "go").touch()

    thread = threading.Thread(target=kill)
    thread.start()
    work = {str(number): partial(jobs.logged, number, str(tmp_path), holds=number >= 3) for number in range(8)}
    assert sorted(results(work, cluster="local", workers=2)) == [(str(number), number) for number in range(8)]
    thread.join()
    again = [number for number, _ in jobs.begun(tmp_path)]
    assert set(again) == set(range(8))
    assert again.count(4) == 2  # the killed one


def test_workers_that_die_again_and_again_end_the_work(tmp_path):
    with pytest.raises(OSError, match=f"Workers have died {1 + RETRIES} times: "):
        list(results({"deadly": partial(jobs.deadly, str(tmp_path))}, cluster="local", workers=2))
    assert len(jobs.begun(tmp_path)) == 1 + RETRIES


@pytest.mark.parametrize("place", [{}, {"cluster": "local", "workers": 1}], ids=["here", "local"])
@pytest.mark.parametrize(
    ("error", "kind", "message"),
    [
        (ValueError("no good"), ValueError, "the third: no good"),
        (FileNotFoundError(2, "No such file", "a.yaml"), ValueError, "the third: .* No such file: 'a.yaml'"),
        (KeyError("speed"), RuntimeError, "the third: KeyError: 'speed'"),
    ],
)
def test_an_error_names_its_job(error, kind, message, place):
    with pytest.raises(kind, match=message):
        list(results({"the third": partial(jobs.failing, error)}, **place))


def test_a_command_ends_with_the_error_of_a_job_in_one_line(capsys):
    assert main(["evaluate", "--policy", "nobody", "--episodes", "20", "--cluster", "local", "--workers", "2"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("turtlebot-gym: evaluation 1 of 1, nobody, from seed 0: policy must be one of")


@pytest.mark.parametrize("address", ["everywhere", ":6379", "ray://10.0.0.1:10001", "host:port", "127.0.0.1:1"])
def test_an_address_without_a_cluster_is_refused(address, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", type(sys)("ray"))
    errors = type(sys)("ray.exceptions")
    errors.RayError = errors.RayTaskError = Exception
    monkeypatch.setitem(sys.modules, "ray.exceptions", errors)
    with pytest.raises((ValueError, OSError), match=r"cluster must be 'local', 'auto' or HOST:PORT|There is no cluster at"):
        list(results({"a": int}, cluster=address))


@pytest.mark.parametrize(("cluster", "library", "extra"), [("local", "joblib", "agents"), ("auto", "ray", "cluster")])
def test_without_its_library_the_command_says_what_to_install(cluster, library, extra, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, library, None)
    assert main(["evaluate", "--policy", "bearing", "--episodes", "20", "--cluster", cluster]) == 2
    assert f"needs {library}: {installing(extra)}." in capsys.readouterr().err


def test_nothing_of_ray_or_joblib_is_imported_without_a_cluster(tmp_path):
    (tmp_path / "study.yaml").write_text("policies: [bearing]\nepisodes: 2\n")
    script = (
        "import sys; from turtlebot_gym_agents.commands.cli import main; import turtlebot_gym_agents.cluster.workers;"
        "code = main(['study', 'study.yaml', '--out', 'out']);"
        "sys.exit(code or 'ray' in sys.modules or 'joblib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, cwd=tmp_path)
