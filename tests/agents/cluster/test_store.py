"""The store: results come back as they were stored, and finished units are not run again."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster.drives import DriveUnit
from turtlebot_gym_agents.cluster.units import Result, Store, complete, in_turn, key

RESULT = Result(
    facts={"value": 0.1, "nothing": None, "all": [1, float("inf")]},
    arrays={"numbers": np.array([np.nan, 0.1, -0.0]), "flags": np.array([True, False]), "whole": np.array([2**60])},
    files={"policy.onnx": b"\x00\x01\xff", "empty": b""},
    times={"seconds": 1.5, "host": "here"},
)


def require_same(result, expected):
    assert (result.facts, result.files, result.times) == (expected.facts, expected.files, expected.times)
    assert {name: (value.dtype, value.tobytes()) for name, value in result.arrays.items()} == {
        name: (value.dtype, value.tobytes()) for name, value in expected.arrays.items()
    }


def test_a_result_is_returned_as_stored_and_never_overwritten(tmp_path):
    store = Store(tmp_path / "deep" / "store")
    assert "a" not in store
    for result in (RESULT, RESULT._replace(facts={})):
        store.put("a", result)
        assert "a" in store
        require_same(store.get("a"), RESULT)
    assert [path.name for path in (tmp_path / "deep" / "store").iterdir()] == ["a.npz"]


def test_a_failed_write_leaves_nothing_and_damage_is_reported(tmp_path):
    with pytest.raises(TypeError):
        Store(tmp_path).put("a", RESULT._replace(facts={"value": object()}))
    assert not [*tmp_path.iterdir()]
    (tmp_path / "b.npz").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(ValueError, match=r"b\.npz is damaged"):
        Store(tmp_path).get("b")


UNITS = [DriveUnit(policy="bearing", env="turtlebot_gym/TurtleBotNav-v0", seed=seed, episodes=1) for seed in (0, 1, 2, 1)]


class Counted:
    """Workers for which the result of a unit is its seed; they stop after a number of units."""

    def __init__(self, limit=99):
        self.done, self._limit = [], limit

    def __call__(self, units):
        for name, unit in reversed(list(units)):
            if len(self.done) == self._limit:
                raise KeyboardInterrupt
            self.done.append(unit.seed)
            yield name, Result({"seed": unit.seed}, {}, {}, {})


def test_results_are_in_the_order_of_the_units_and_equal_units_run_once():
    workers, counts = Counted(), []
    results = complete(UNITS, workers=workers, progress=counts.append)
    assert [result.facts["seed"] for result in results] == [0, 1, 2, 1]
    assert workers.done == [2, 1, 0]
    assert counts == [0, 1, 3, 4]


def test_interrupted_work_resumes(tmp_path):
    store, first, second, third = Store(tmp_path), Counted(2), Counted(), Counted()
    with pytest.raises(KeyboardInterrupt):
        complete(UNITS, workers=first, store=store)
    assert first.done == [2, 1]
    results = complete(UNITS, workers=second, store=store)
    assert second.done == [0]
    assert [result.facts["seed"] for result in results] == [0, 1, 2, 1]
    complete(UNITS, workers=third, store=store)
    assert third.done == []
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted({key(unit) for unit in UNITS})


def test_an_error_of_a_unit_ends_the_work():
    with pytest.raises(ValueError, match="policy must be one of"):
        complete([DriveUnit(policy="nobody", env=UNITS[0].env, seed=0, episodes=1)], workers=in_turn)
