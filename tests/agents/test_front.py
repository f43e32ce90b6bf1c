"""What a person imports: the commands as functions with the same defaults; results print, show, plot and can be written."""

import csv
import json
import re
import sys

import numpy as np
import own_parts
import pytest
from matplotlib.figure import Figure

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym.drive import position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym_agents import compare, drive, evaluate, export, make_policy, replay, train, watch
from turtlebot_gym_agents.front import satellites

SMALL = {"n_envs": 16, "n_timesteps": 1024, "policy": "MlpPolicy", "n_steps": 16, "batch_size": 128, "n_epochs": 1}
QUICK = {"config": SMALL, "evaluations": 2, "episodes": 4, "progress": False}


@pytest.fixture(scope="module")
def compared():
    return compare("proportional", "bearing", episodes=12, noise=["tutorial", "clean"])


@pytest.fixture(scope="module")
def in_a_room():
    return drive("vfh", env="rooms", world="office", lidar="ideal", seed=3)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Two seeds in a folder that is given as text, as everybody gives it."""
    return train("nav", str(tmp_path_factory.mktemp("trained") / "run"), seeds=2, **QUICK)


@pytest.fixture(params=["evaluation", "compared", "in_a_room", "trained"])
def result(request, compared):
    return compared["bearing, clean"] if request.param == "evaluation" else request.getfixturevalue(request.param)


def test_a_notebook_shows_a_table_and_a_figure(result):
    html = result._repr_html_()
    assert html.startswith("<pre>")
    assert '<img alt="the figure of plot()" src="data:image/png;base64,iVBOR' in html
    assert len(html) < 150_000


def test_its_arrays_are_those_of_its_csv(result, tmp_path):
    result.to_csv(tmp_path / "result.csv")
    with (tmp_path / "result.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    columns = result.rows()
    assert list(rows[0]) == list(columns)
    for name, column in columns.items():
        written = [row[name] for row in rows]
        if np.asarray(column).dtype.kind in "US":
            assert written == list(column)
        else:
            np.testing.assert_array_equal(np.array(written, float), np.asarray(column, float))


def test_a_comparison_is_of_each_policy_in_each_setting(compared):
    assert [*compared.evaluations] == ["proportional, tutorial", "proportional, clean", "bearing, tutorial", "bearing, clean"]
    alone = evaluate("bearing", env="Nav", episodes=12, noise="clean")
    np.testing.assert_array_equal(compared["bearing, clean"]["time"], alone["time"])
    np.testing.assert_array_equal(compared["success"][3], alone["success"])
    assert "bearing, clean is" in compared.verdict() or "bearing, clean reaches" in compared.verdict()


def test_objects_of_ones_own_have_a_label_each():
    def stand(observations):
        return np.zeros((*observations.shape[:-1], 2), np.float32)

    labels = [*compare(stand, lambda observations: stand(observations), episodes=1).evaluations]
    assert labels == ["stand", "<lambda>"]
    labels = [*compare("bearing", filter=["matched", own_parts.Extended, own_parts.Extended], episodes=1).evaluations]
    assert labels == ["matched", "Extended", "Extended (2)"]
    with pytest.raises(ValueError, match="noise must name at least one value"):
        compare("bearing", noise=[])


def test_a_drive_is_the_first_episode_of_an_evaluation(in_a_room):
    evaluation = evaluate("vfh", env="rooms", world="office", lidar="ideal", seed=3, episodes=2)
    trajectory = evaluation.trajectory
    for name in ("true_state", "odometry", "estimate", "covariance", "reference", "command"):
        np.testing.assert_array_equal(in_a_room[name], getattr(trajectory, name))
    steps = np.diff(trajectory.true_state[:, :2], axis=0)
    assert evaluation["path"][0] == pytest.approx(np.hypot(*steps.T).sum())
    expected = nees(trajectory.estimate, trajectory.true_state, trajectory.covariance)
    np.testing.assert_array_equal(in_a_room["nees"], expected)
    assert f"{position_error(trajectory.estimate, trajectory.true_state).mean():.3f}" in str(in_a_room)


def test_a_drive_in_a_room_has_its_walls_in_arrays_and_in_its_plot(in_a_room, tmp_path):
    in_a_room.to_npz(tmp_path / "drive.npz")
    with np.load(tmp_path / "drive.npz") as file:
        assert {*file} == {*in_a_room.arrays}
        x, y, length, width = file["walls"]
        boxes = len(file["boxes"])
    axes = in_a_room.plot(Figure().subplots())
    limits = [*axes.get_xlim(), *axes.get_ylim()]
    assert limits[0] <= x - length < x + length <= limits[1]
    assert limits[2] <= y - width < y + width <= limits[3]
    assert len(axes.patches) >= 1 + boxes


def test_trainings_have_their_learning_curves_and_an_interval(trained):
    assert trained["success"].shape == (2, 2)
    assert trained["steps"].tolist() == [512.0, 1024.0]
    axes = trained.plot(Figure().subplots(), name="return")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        *("mean of 2 seeds", "95 % interval of the mean"),
    ]
    with pytest.raises(ValueError, match="name must be one of 'success', 'return', 'steps_to_end'"):
        trained.plot(name="reward")


def test_a_training_drives_in_a_comparison_and_by_its_file(trained):
    assert trained.policy.parent in trained.folders.values()
    assert trained.folders[0].name == "seed-0"
    (label, first), _ = compare(trained, "bearing", episodes=3).evaluations.items()
    assert label == str(trained.folders[0].parent)
    np.testing.assert_array_equal(first["time"], evaluate(trained.policy, episodes=3)["time"])
    assert make_policy(trained.policy)(np.zeros(13, np.float32)).shape == (2,)


def test_a_training_replaces_a_run_by_force_only(tmp_path):
    for seed in (1, 2):
        again = train("nav", tmp_path / "run", seed=seed, force=True, **QUICK)
        assert [*again.folders] == [seed]
    assert json.loads((tmp_path / "run" / "config.json").read_text())["config"]["seed"] == 2
    assert len([*(tmp_path / "run").rglob("events.*")]) == 1
    with pytest.raises(ValueError, match="holds a run already: choose another folder"):
        train("nav", tmp_path / "run", **QUICK)


@pytest.mark.slow
def test_a_model_of_another_library_becomes_a_bundle(tmp_path):
    import torch

    model = torch.nn.Sequential(torch.nn.Linear(14, 2), torch.nn.Tanh())
    own = {"observation": ("ekf", own_parts.SPEEDOMETER), "filter": own_parts.Extended, "reward": {own_parts.SPIN: 1.0}}
    exported = export(model, str(tmp_path / "own.onnx"), env="pose", noise="clean", steps=20, **own)
    assert exported.card.env == "turtlebot_gym/TurtleBotPose-v0"
    assert exported.card.terms[-1]["source"] == "own_parts:SPEEDOMETER"
    assert re.fullmatch(rf"{re.escape(str(exported.policy))}: .* bytes, for .*Pose-v0; its actions differ .*", str(exported))
    del own["reward"]  # which no number of an evaluation depends on
    assert evaluate(exported, env="pose", noise="clean", episodes=2, **own).label == str(exported.policy)


@pytest.mark.parametrize("function", [watch, replay])
def test_a_satellite_that_is_missing_is_named_with_its_extra(function, monkeypatch):
    monkeypatch.setitem(sys.modules, satellites.SATELLITES[function.__name__], None)
    with pytest.raises(ImportError, match=rf"^{function.__name__} needs the extra \[agents\]: pip install [^\n]*$"):
        function("bearing")


def test_watch_hands_policies_or_drives_to_the_viewer(in_a_room, monkeypatch):
    viewer = {
        "episodes": lambda policies, **options: (policies, options),
        "page_of": lambda drives, **options: (drives, options),
    }
    monkeypatch.setattr(satellites, "satellite", lambda name, attribute: viewer[attribute])
    assert watch("bearing", "ppo-nav", seed=3) == (("bearing", "ppo-nav"), {"env": None, "seed": 3})
    assert watch(in_a_room) == ([in_a_room.record], {"title": "vfh"})
    with pytest.raises(ValueError, match="watch shows policies or drives, got both"):
        watch("bearing", in_a_room)
