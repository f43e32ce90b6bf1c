"""Studies: each cell has its setting, results follow from the evaluations, and an interrupted study resumes."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster import ledger as ledger_module
from turtlebot_gym_agents.cluster.grid import StudyGrid, read_grid
from turtlebot_gym_agents.cluster.ledger import Ledger, difference, files_in, origin
from turtlebot_gym_agents.cluster.study import study
from turtlebot_gym_agents.cluster.workers import results
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate, paired
from turtlebot_gym_agents.policies.bundle import BundlePolicy

pytestmark = pytest.mark.touched("agents/turtlebot_gym_agents/cluster", "tests/agents/cluster")

NAV = "turtlebot_gym/TurtleBotNav-v0"
HYPER = """default:
  n_envs: 32
  n_timesteps: 512
  policy: MlpPolicy
  n_steps: 16
  batch_size: 512
"""


def test_cells_are_all_combinations():
    grid = StudyGrid(policies=("bearing",), grid={"noise": ["clean", "rough"], "delay": [0, 2], "robot": "waffle"})
    cells = grid.cells()
    assert len(cells) == 4
    assert cells[1] == {"env": NAV, "noise": "clean", "delay": 2, "robot": "waffle"}
    assert grid.compare_with == "bearing"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policies: []", "policies must be names, at least one"),
        ("episodes: 5", "needs policies"),
        ("policies: bearing\ncompare_with: corner", "compare_with must be one of 'bearing', got 'corner'"),
        ("policies: bearing\nepisodes: 1", "episodes must be a whole number from 2 to 10*, got 1"),
        ("policies: bearing\ngrid: {colour: red}", "grid must be one of 'env', .* got 'colour'"),
        ("policies: bearing\ngrid: {env: CartPole-v1}", "env must be one of"),
        ("policies: bearing\ntrainings: {ppo: {colour: red}}", "training 'ppo': TrainingConfig has no colour; it has "),
        ("policies: bearing\ntrainings: {ppo: {seeds: 0}}", "seeds of training 'ppo' must be"),
        ("policy: bearing", "a study: StudyGrid has no policy"),
        ("- bearing", "a study must be a StudyGrid or a mapping of its fields"),
        ("policies: [", "study.yaml( is not YAML)?: "),
    ],
)
def test_an_invalid_study_is_refused_with_the_files_name(text, message, tmp_path):
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(ValueError, match=message) as refusal:
        read_grid(tmp_path / "study.yaml")
    assert str(tmp_path / "study.yaml") in str(refusal.value)


@pytest.mark.nightly
def test_the_command_reports_the_evaluations_and_resumes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hyper.yaml").write_text(HYPER)
    (tmp_path / "study.yaml").write_text(
        "episodes: 30\nseed: 9\npolicies: [bearing, proportional]\ngrid: {noise: rough}\n"
        "trainings:\n  tiny: {seeds: 2, steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml}\n"
        "  single: {steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml, overrides: {gamma: 0.9}}\n"
    )
    assert main(["study", "study.yaml", "--out", "out", "--json", "one.json"]) == 0
    printed = capsys.readouterr().out
    assert "tiny, 2 trainings" in printed
    assert "minus bearing, s" in printed

    content = json.loads((tmp_path / "one.json").read_text())
    (cell,), common = content["cells"], {"episodes": 30, "seed": 9, "noise": "rough"}
    bearing, other = evaluate("bearing", **common), evaluate("proportional", **common)
    assert cell["policies"]["proportional"]["time"]["value"] == np.mean(other.times())
    assert cell["policies"]["proportional"]["difference"]["low"] == paired(other, bearing).low
    assert set(cell["policies"]) == {"bearing", "proportional", "single"}
    bundles = sorted((tmp_path / "out" / "policies").glob("tiny seed *.onnx"))
    learned = [PairedOutcome.of(evaluate(BundlePolicy(bundle), **common)) for bundle in bundles]
    expected = compare(learned, PairedOutcome.of(bearing))
    assert cell["trainings"]["tiny"]["time"]["value"] == expected["time"].value
    assert cell["trainings"]["tiny"]["difference"]["high"] == expected["difference"].high
    assert cell["trainings"]["tiny"]["p_holm"] >= cell["trainings"]["tiny"]["p"]

    finished = tmp_path / "out" / "finished.jsonl"
    *lines, last = finished.read_text().splitlines(keepends=True)
    assert len(lines) == 4
    finished.write_text("".join(lines) + last[: len(last) // 2])  # as if killed while it wrote
    assert main(["study", "study.yaml", "--out", "out", "--json", "two.json"]) == 0
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
    assert finished.read_text() == "".join([*lines, last])


class Counted:
    """Runs jobs here, counts them, and is interrupted after a number of them."""

    def __init__(self, limit=99):
        self.done, self._limit = [], limit

    def __call__(self, jobs):
        for name, result in results(jobs):
            if len(self.done) == self._limit:
                raise KeyboardInterrupt
            self.done.append(name)
            yield name, result


def test_a_study_repeats_nothing_that_is_finished_and_grows(tmp_path):
    grid = StudyGrid(
        policies=("bearing", "proportional"), compare_with="proportional", grid={"noise": ["clean", "rough"]}, episodes=9
    )
    expected = study(grid, tmp_path / "whole")
    first, second, third, counts = Counted(3), Counted(), Counted(), []
    with pytest.raises(KeyboardInterrupt):
        study(grid, tmp_path / "parts", run=first)
    assert study(grid, tmp_path / "parts", run=second, progress=lambda *done: counts.append(done)) == expected
    assert (len(first.done), len(second.done), counts) == (3, 1, [(3, 4), (4, 4)])
    more = StudyGrid(policies=("bearing", "corner"), grid={"noise": ["rough", "tutorial"]}, episodes=9)
    rows = study(more, tmp_path / "parts", run=third)
    assert len(third.done) == 3
    assert rows[0]["policies"]["bearing"]["path"] == expected[1]["policies"]["bearing"]["path"]
    for row in expected:
        ours = evaluate("bearing", episodes=9, noise=row["setting"]["noise"])
        assert row["policies"]["bearing"]["path"] == ours.summary()["path"]
        assert row["policies"]["proportional"]["difference"].value == 0.0
        assert row["trainings"] == {}


def test_a_changed_file_of_the_study_is_evaluated_anew(tmp_path):
    noise, runs = tmp_path / "mine.yaml", Counted()
    grid = StudyGrid(policies=("bearing",), grid={"noise": str(noise)}, episodes=9)
    for error in ("0.0009", "0.09", "0.0009"):
        noise.write_text(f"odometry: {{R: [{error}, {error}, 0.0025]}}\n")
        study(grid, tmp_path / "out", run=runs)
    assert len(runs.done) == 2


def test_files_are_found_in_options_with_what_they_refer_to(tmp_path, monkeypatch):
    (tmp_path / "floor.yaml").write_text("image: floor.pgm\nresolution: 0.05\n")
    (tmp_path / "floor.pgm").write_bytes(b"P5 1 1 255 0")
    (tmp_path / "mine_alone.py").write_text("def drive(observations): ...\n")
    (tmp_path / "tuned.json").write_text("{}")
    monkeypatch.syspath_prepend(tmp_path)
    names = [f"{tmp_path}/floor.yaml", ["mine_alone:drive", f"{tmp_path}/tuned.json+safety"], "bearing", 3, None, "no.onnx"]
    found = {path.rpartition("/")[2] for path in files_in(names)}
    assert found == {"floor.yaml", "floor.pgm", "mine_alone.py", "tuned.json"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"numpy": "1.0"}, "another numpy, '.*', here it is '1.0'"),
        ({"code": "0"}, "another code, '.*', here it is '0'"),
        ({"new": "1.0"}, "another new, None, here it is '1.0'"),
    ],
)
def test_work_of_other_code_is_refused(change, message, tmp_path, monkeypatch):
    Ledger(tmp_path, {"seed": 1})
    Ledger(tmp_path, {"seed": 1})
    with pytest.raises(ValueError, match=f"{tmp_path} holds work with another seed, 1, here it is 2: choose another folder"):
        Ledger(tmp_path, {"seed": 2})
    here = origin() | change
    monkeypatch.setattr(ledger_module, "origin", lambda: here)
    with pytest.raises(ValueError, match=message):
        Ledger(tmp_path, {"seed": 1})
    assert difference({}, {}) == ""


def test_a_ledger_returns_what_was_added_to_the_bit_and_reports_damage(tmp_path):
    value = {"numbers": [0.1, 1e-300, -0.0, float("inf")], "nothing": None}
    Ledger(tmp_path, {}).add("a job, é", value)
    assert repr(Ledger(tmp_path, {}).results) == repr({"a job, é": value})
    (tmp_path / "finished.jsonl").write_text('{"job": "a"}\n')
    with pytest.raises(ValueError, match=r"finished.jsonl, line 1 is damaged: remove it to repeat its job\."):
        Ledger(tmp_path, {})


HELD = """
import time
from pathlib import Path
import numpy as np

def drive(observations):
    while Path("hold").exists():
        time.sleep(0.01)
    return np.zeros((*observations.shape[:-1], 2), np.float32)
"""


@pytest.mark.nightly
@pytest.mark.parametrize(
    "group", [pytest.param(False, marks=pytest.mark.nightly, id="one process"), pytest.param(True, id="all")]
)
def test_an_interrupt_ends_all_processes_and_the_study_resumes(group, tmp_path, monkeypatch):
    """Of four jobs, two never end while there is a file ``hold``: the interrupt comes in the middle of the work."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "held.py").write_text(HELD)
    (tmp_path / "hold").touch()
    (tmp_path / "study.yaml").write_text("policies: [bearing, 'held:drive']\nepisodes: 2\ngrid: {noise: [clean, rough]}\n")
    command, finished = ["study", "study.yaml", "--json", "out.json"], tmp_path / "out" / "finished.jsonl"
    process = subprocess.Popen(
        [sys.executable, "-m", "turtlebot_gym_agents", *command, "--out", "out", "--cluster", "local", "--workers", "2"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    )
    while not finished.exists():
        assert process.poll() is None
        time.sleep(0.01)
    (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)  # also the workers have closed their end
    assert process.returncode == 130
    assert err.strip() == "turtlebot-gym: interrupted. The same command continues: finished jobs are in out."
    before = finished.read_text()
    assert 1 <= before.count("\n") < 4
    (tmp_path / "hold").unlink()
    for folder in ("out", "plain"):
        assert main([*command, "--out", folder, "--json", f"{folder}.json"]) == 0
    assert finished.read_text().startswith(before)
    assert (tmp_path / "out.json").read_bytes() == (tmp_path / "plain.json").read_bytes()


@pytest.mark.nightly
def test_trainings_of_several_seeds_are_kept_and_unfinished_ones_begin_anew(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hyper.yaml").write_text(HYPER)
    command = ["train", "--config", "hyper.yaml", "--evaluations", "1", "--cluster", "local", "--workers", "2"]
    assert main([*command, "--seeds", "2", "--out", "run", "--json", "one.json"]) == 0
    first = tmp_path / "run" / "seed-0" / "policy.onnx"
    before = first.stat().st_mtime_ns
    (tmp_path / "run" / "seed-1").rename(tmp_path / "run" / "seed-1.unfinished")
    assert main([*command, "--seeds", "2", "--out", "run", "--json", "two.json"]) == 0
    one, two = (json.loads((tmp_path / f"{name}.json").read_text())["runs"] for name in ("one", "two"))
    assert one == two
    assert first.stat().st_mtime_ns == before
    assert not (tmp_path / "run" / "seed-1.unfinished").exists()
    capsys.readouterr()
    for options, message in (
        (["--seeds", "2", "--noise", "rough", "--out", "run"], "run holds work with another noise, "),
        (["--seeds", "1", "--out", "other"], "cluster trains several seeds at once"),
    ):
        assert main([*command, *options]) == 2
        assert message in capsys.readouterr().err
