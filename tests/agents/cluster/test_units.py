"""Units of work: results do not depend on how work is split; a key depends on all that a result depends on."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster import units as module
from turtlebot_gym_agents.cluster.attachments import attach, placed, unpacked
from turtlebot_gym_agents.cluster.drives import DriveUnit, _columns, drives, evaluate_all, evaluation
from turtlebot_gym_agents.cluster.trainings import Training
from turtlebot_gym_agents.cluster.units import key, run
from turtlebot_gym_agents.evaluation.evaluate import batches, evaluate
from turtlebot_gym_agents.provenance import plain
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.hyperparameters import configs_folder

NAV, SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))


def text(evaluation):
    """Return an evaluation as text, with all digits of all numbers."""
    summary = plain({"config": evaluation.config, "summary": evaluation.summary()})
    numbers = {name: values.tobytes().hex() for name, values in _columns(evaluation.episodes)}
    return json.dumps({**summary, "episodes": numbers, "path": evaluation.trajectory.true_state.tobytes().hex()})


@pytest.mark.parametrize(
    "arguments",
    [
        {"policy": "bearing", "env": NAV, "episodes": 51, "seed": 7},
        {"policy": "ppo-nav", "env": NAV, "episodes": 50, "noise": "documented"},
        {"policy": "corner", "env": SQUARE, "episodes": 11, "arrival": "belief"},
        {"policy": "gap", "env": ROOMS, "episodes": 9, "world": "clutter"},
    ],
    ids=["bearing", "bundle", "with memory of the course", "room"],
)
@pytest.mark.parametrize("chunk", [1000, 25, 2])
def test_an_evaluation_does_not_depend_on_how_it_is_split(arguments, chunk, monkeypatch):
    expected = text(evaluate(**arguments))
    monkeypatch.setattr(drives, "__kwdefaults__", {**drives.__kwdefaults__, "chunk": chunk})
    (split,) = evaluate_all([arguments])
    assert text(split) == expected


def test_no_batch_has_a_single_episode_unless_there_is_no_other():
    expected = {1: [(0, 1)], 10: [(0, 5), (5, 5)], 11: [(0, 5), (5, 6)], 12: [(0, 5), (5, 5), (10, 2)]}
    assert {episodes: batches(episodes, 5) for episodes in expected} == expected
    assert all(sum(size for _, size in batches(n, k)) == n for n in range(1, 40) for k in range(1, 40))


def test_a_pickled_unit_gives_the_same_result():
    (unit,) = drives("ppo-nav", env=NAV, episodes=8, seed=3, noise="rough")
    again = pickle.loads(pickle.dumps(unit))
    assert key(again) == key(unit)
    for first, second in zip(run(unit).arrays.values(), run(again).arrays.values(), strict=True):
        np.testing.assert_array_equal(first, second)
    config = Training.of(TrainingConfig(steps=64))
    assert key(pickle.loads(pickle.dumps(config))) == key(config)


UNIT = DriveUnit(policy="bearing", env=NAV, seed=0, episodes=4, options={"noise": "clean"})


def test_a_key_depends_on_all_that_a_result_depends_on(monkeypatch):
    changes = {"policy": "proportional", "env": SQUARE, "seed": 1, "episodes": 5, "options": {"noise": "rough"}}
    changes |= {"trajectory": True, "files": {"bearing": {"bearing": b"1"}}}
    keys = [key(UNIT), *(key(replace(UNIT, **{name: value})) for name, value in changes.items())]
    here = module.origin()
    for change in ({"code": "other"}, {"libraries": {**here["libraries"], "numpy": "1.0"}}):
        monkeypatch.setattr(module, "origin", lambda change=change: here | change)
        keys.append(key(UNIT))
    assert len(set(keys)) == len(keys) == 10


def test_a_key_of_a_training_has_its_hyperparameters_and_no_path(tmp_path):
    shipped = TrainingConfig(steps=64)
    (tmp_path / "same.yaml").write_text((configs_folder() / "ppo.yaml").read_text())

    def key_of(**changes):
        return key(Training.of(replace(shipped, **changes)))

    assert key_of(config=tmp_path / "same.yaml", checkpoint_seconds=1.0) == key_of(config=shipped.hyper) == key_of()
    assert len({key_of(), key_of(config={**shipped.hyper, "gamma": 0.5}), key_of(seed=1)}) == 3
    assert Training.of(shipped).size == 1  # progress counts trainings


def test_files_that_options_name_travel_with_the_unit(tmp_path, monkeypatch):
    noise = tmp_path / "mine.yaml"
    noise.write_text("odometry: {R: [0.0009, 0.0009, 0.0025]}\n")
    arguments = {"policy": "bearing", "env": NAV, "episodes": 6, "seed": 0, "noise": str(noise)}
    expected = evaluate(**arguments).episodes
    (unit,) = drives(**arguments)
    noise.write_text("odometry: {R: [0.09, 0.09, 0.25]}\n")
    (changed,) = drives(**arguments)
    assert key(changed) != key(unit)
    noise.unlink()
    np.testing.assert_array_equal(evaluation([run(unit)], {}).episodes.path, expected.path)
    assert (evaluation([run(changed)], {}).episodes.path != expected.path).all()


def test_a_map_travels_with_its_image_and_a_users_policy_as_its_source(tmp_path, monkeypatch):
    (tmp_path / "floor.yaml").write_text("image: floor.pgm\nresolution: 0.05\n")
    (tmp_path / "floor.pgm").write_bytes(b"P5 1 1 255 0")
    (tmp_path / "mine_alone.py").write_text("def drive(observations): ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    world = str(tmp_path / "floor.yaml")
    attachments = attach(world, "mine_alone:drive", "bearing", 3, None, "json:loads", "nowhere.onnx")
    assert {name: set(files) for name, files in attachments.items()} == {
        world: {"floor.yaml", "floor.pgm"},
        "module mine_alone": {"mine_alone.py"},
    }
    with unpacked(attachments) as places:
        there = placed(world, places)
        assert there != world
        assert sorted(path.name for path in type(tmp_path)(there).parent.iterdir()) == ["floor.pgm", "floor.yaml"]
        assert placed("vfh", places) == "vfh"
        assert placed(f"{world}+safety", places) == f"{there}+safety"
    assert not type(tmp_path)(there).exists()
