"""Studies: each cell has its setting, results follow from the evaluations, and an interrupted study resumes."""

import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster.grid import Grid, read_grid, study
from turtlebot_gym_agents.cluster.units import Store
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.comparison import compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate, paired
from turtlebot_gym_agents.policies.bundle import BundlePolicy

NAV = "turtlebot_gym/TurtleBotNav-v0"
HYPER = """default:
  n_envs: 32
  n_timesteps: 512
  policy: MlpPolicy
  n_steps: 16
  batch_size: 512
"""


def test_cells_are_all_combinations():
    grid = Grid(policies=("bearing",), grid={"noise": ["clean", "rough"], "delay": [0, 2], "robot": "waffle"})
    cells = grid.cells()
    assert len(cells) == 4
    assert cells[1] == {"env": NAV, "noise": "clean", "delay": 2, "robot": "waffle"}
    assert grid.baseline == "bearing"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policies: []", "policies must name at least one"),
        ("policies: bearing\ncompare_with: corner", "compare_with must be one of policies, bearing, got 'corner'"),
        ("policies: bearing\nepisodes: 1", "episodes must be a whole number of at least 2, got 1"),
        ("policies: bearing\ngrid: {colour: red}", "grid must hold settings, env, .* got colour"),
        ("policies: bearing\ngrid: {env: CartPole-v1}", "env must be one of"),
        ("policy: bearing", "a study must hold .* got policy"),
        ("- bearing", "a study must hold"),
        ("policies: [", "study.yaml( is not YAML)?: "),
    ],
)
def test_an_invalid_study_is_refused_with_the_files_name(text, message, tmp_path):
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(ValueError, match=message) as refusal:
        read_grid(tmp_path / "study.yaml")
    assert str(tmp_path / "study.yaml") in str(refusal.value)


def test_unknown_options_of_a_training_are_refused():
    grid = Grid(policies=("bearing",), trainings={"ppo": {"colour": "red"}})
    with pytest.raises(ValueError, match="training 'ppo' has no fields colour; known fields are algo, "):
        study(grid)


def test_the_command_reports_the_evaluations_and_resumes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hyper.yaml").write_text(HYPER)
    (tmp_path / "study.yaml").write_text(
        "episodes: 30\nseed: 9\npolicies: [bearing, proportional]\ngrid: {noise: rough}\n"
        "trainings:\n  tiny: {seeds: 2, steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml}\n"
        "  single: {steps: 512, evaluations: 1, episodes: 8, config: hyper.yaml, speed_error: 0.1}\n"
    )
    assert main(["study", "study.yaml", "--out", "out", "--json", "one.json"]) == 0
    printed = capsys.readouterr().out
    assert "tiny, 2 trainings" in printed
    assert "minus bearing, s" in printed
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "units").iterdir()}
    assert len(files) == 3 + 2 + 3  # trainings, drives of two policies, drives of the trained ones

    content = json.loads((tmp_path / "one.json").read_text())
    (cell,), common = content["cells"], {"episodes": 30, "seed": 9, "noise": "rough"}
    bearing, other = evaluate("bearing", **common), evaluate("proportional", **common)
    assert cell["policies"]["proportional"]["time"]["value"] == pytest.approx(np.mean(other.times()))
    assert cell["policies"]["proportional"]["difference"]["low"] == pytest.approx(paired(other, bearing).low)
    assert set(cell["policies"]) == {"bearing", "proportional", "single"}

    store, bundles = Store(tmp_path / "out" / "units"), []
    for path in files:
        result = store.get(path.stem)
        if result.files:
            config = json.loads(result.files["config.json"])["config"]
            assert config["config"] == "hyper.yaml"
            if config["speed_error"] != 0.1:
                bundle = tmp_path / f"{config['seed']}.onnx"
                bundle.write_bytes(result.files["policy.onnx"])
                bundles.append(bundle)
    expected = compare([evaluate(BundlePolicy(bundle), **common) for bundle in sorted(bundles)], bearing)
    assert cell["trainings"]["tiny"]["time"]["value"] == pytest.approx(expected["time"].value)
    assert cell["trainings"]["tiny"]["difference"]["high"] == pytest.approx(expected["difference"].high)
    assert cell["trainings"]["tiny"]["p_holm"] >= cell["trainings"]["tiny"]["p"]

    gone = next(iter(files))
    gone.unlink()
    assert main(["study", "study.yaml", "--out", "out", "--json", "two.json"]) == 0
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
    assert {path: path.stat().st_mtime_ns for path in files if path != gone}.items() <= files.items()


def test_each_cell_has_the_same_episodes_in_its_own_setting():
    grid = Grid(
        policies=("bearing", "proportional"), compare_with="proportional", grid={"noise": ["clean", "rough"]}, episodes=9
    )
    rows = study(grid)
    assert [row["setting"] for row in rows] == [{"env": NAV, "noise": noise} for noise in ("clean", "rough")]
    for row in rows:
        ours = evaluate("bearing", episodes=9, noise=row["setting"]["noise"])
        assert row["policies"]["bearing"]["path"] == ours.summary()["path"]
        assert row["policies"]["proportional"]["difference"].value == 0.0
        assert row["trainings"] == {}
    assert study(Grid(**{**vars(grid), "chunk": 4})) == rows
