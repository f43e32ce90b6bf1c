"""Studies and workers: each cell has its setting, results follow from the evaluations, and finished jobs are not repeated."""

import importlib.util
import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents import compare, provenance
from turtlebot_gym_agents.cluster import study as module
from turtlebot_gym_agents.cluster import workers
from turtlebot_gym_agents.cluster.study import StudyGrid, read_grid, results_of
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome
from turtlebot_gym_agents.evaluation.comparison import compare as compare_trainings
from turtlebot_gym_agents.evaluation.evaluate import evaluate, paired
from turtlebot_gym_agents.front import comparing
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.provenance import plain

pytestmark = pytest.mark.slow

NAV, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Rooms"))
HYPER = """default:
  n_envs: 32
  n_timesteps: 512
  policy: MlpPolicy
  n_steps: 16
  batch_size: 512
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policies: []", "policies must be names, at least one"),
        ("policies: bearing\ncompare_with: corner", "compare_with must be one of 'bearing', got 'corner'"),
        ("policies: bearing\nepisodes: 1", "episodes must be a whole number from 2 to 10*, got 1"),
        ("policies: bearing\ntrainings: {ppo: {colour: red}}", "training 'ppo': TrainingConfig has no colour; it has "),
        ("policies: [", "study.yaml( is not YAML)?: "),
    ],
)
def test_an_invalid_study_is_refused_with_the_files_name(text, message, tmp_path):
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(ValueError, match=message) as refusal:
        read_grid(tmp_path / "study.yaml")
    assert str(tmp_path / "study.yaml") in str(refusal.value)


@pytest.mark.parametrize("options", [[], ["--cluster", "local", "--workers", "2"]], ids=["here", "two workers"])
def test_the_command_reports_the_evaluations(options, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hyper.yaml").write_text(HYPER)
    (tmp_path / "study.yaml").write_text(
        "episodes: 30\nseed: 9\npolicies: [bearing, proportional]\ngrid: {noise: rough}\n"
        "trainings:\n  tiny: {seeds: 2, steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml}\n"
        "  single: {steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml, overrides: {gamma: 0.9}}\n"
    )
    assert main(["study", "study.yaml", "--out", "out", "--json", "one.json", *options]) == 0
    printed = capsys.readouterr().out
    assert "tiny, 2 trainings" in printed
    assert "minus bearing, s" in printed
    content = json.loads((tmp_path / "one.json").read_text())
    (cell,), common = content["cells"], {"episodes": 30, "seed": 9, "noise": "rough"}
    bearing, other = evaluate("bearing", **common), evaluate("proportional", **common)
    assert cell["policies"]["proportional"]["time"]["value"] == np.mean(other.times())
    assert cell["policies"]["proportional"]["difference"]["low"] == paired(other, bearing).low
    assert set(cell["policies"]) == {"bearing", "proportional", "single"}
    bundles = sorted((tmp_path / "out" / "policies").glob("*tiny, seed *.onnx"))
    learned = [PairedOutcome.of(evaluate(BundlePolicy(bundle), **common)) for bundle in bundles]
    expected = compare_trainings(learned, PairedOutcome.of(bearing))
    assert cell["trainings"]["tiny"]["time"]["value"] == expected["time"].value
    assert cell["trainings"]["tiny"]["difference"]["high"] == expected["difference"].high
    assert cell["trainings"]["tiny"]["p_holm"] >= cell["trainings"]["tiny"]["p"]


@pytest.fixture
def driven(monkeypatch):
    """Return the list of the episodes' noises that a study drives; it is interrupted by "stop"."""
    noises, right = [], module.evaluate

    def counted(**request):
        if request["noise"] == "tutorial" and "stop" in noises:
            raise KeyboardInterrupt
        noises.append(request["noise"])
        return right(**request)

    monkeypatch.setattr(module, "evaluate", counted)
    monkeypatch.setattr(provenance, "_commit", lambda: "one")  # a commit in the middle of the test is no difference
    return noises


def test_an_interrupted_study_repeats_nothing_that_is_finished_and_grows(tmp_path, driven):
    grid = StudyGrid(policies=("bearing", "proportional"), grid={"noise": ["clean", "tutorial"]}, episodes=9)
    driven.append("stop")
    with pytest.raises(KeyboardInterrupt):
        results_of(grid, tmp_path / "parts")
    assert driven == ["stop", "clean", "clean"]
    driven.clear()
    rows = results_of(grid, tmp_path / "parts")
    assert driven == ["tutorial", "tutorial"]
    assert plain(rows) == plain(results_of(grid, tmp_path / "whole"))
    driven.clear()
    more = StudyGrid(policies=("bearing", "corner"), grid={"noise": ["clean", "rough"]}, episodes=9)
    results_of(more, tmp_path / "parts")
    assert driven == ["clean", "rough", "rough"]


def test_a_changed_file_and_another_commit_are_evaluated_anew(tmp_path, driven, monkeypatch):
    noise = tmp_path / "mine.yaml"
    grid = StudyGrid(policies=("bearing",), grid={"noise": str(noise)}, episodes=9)
    for error in ("0.0009", "0.09", "0.0009"):
        noise.write_text(f"odometry: {{R: [{error}, {error}, 0.0025]}}\n")
        results_of(grid, tmp_path / "out")
    assert len(driven) == 2
    monkeypatch.setattr(module, "provenance", lambda: {"commit": "two"})
    results_of(grid, tmp_path / "out")
    assert len(driven) == 3


@pytest.mark.parametrize(
    "request_",
    [
        {"policy": "ppo-nav", "env": NAV, "episodes": 50, "seed": 7, "noise": "documented"},
        {"policy": "vfh", "env": ROOMS, "episodes": 9, "seed": 0, "world": "clutter"},
    ],
    ids=["bundle", "room"],
)
def test_an_evaluation_does_not_depend_on_how_it_is_split(request_, monkeypatch):
    expected = evaluate(**request_)
    monkeypatch.setattr(comparing, "CHUNK", 4)
    monkeypatch.setattr(workers, "run", lambda jobs, *where: [job() for job in jobs])
    (split,) = compare(request_.pop("policy"), **request_, cluster="local").evaluations.values()
    assert plain(split.summary()) == plain(expected.summary())
    assert split.times().tobytes() == expected.times().tobytes()
    assert split.trajectory.true_state.tobytes() == expected.trajectory.true_state.tobytes()


@pytest.mark.filterwarnings("ignore")  # Ray's own, of sockets and processes that it leaves to the collector
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="needs ray")
def test_a_study_on_ray_equals_one_process(tmp_path):
    import ray

    address = ray.init(num_cpus=2, include_dashboard=False)["address"]
    try:
        grid = StudyGrid(policies=("bearing", "proportional"), grid={"noise": ["clean", "rough"]}, episodes=9)
        assert plain(results_of(grid, tmp_path / "ray", cluster=address)) == plain(results_of(grid, tmp_path / "here"))
    finally:
        ray.shutdown()
