"""Values in tiles: what is stored is loaded again, and the slices say where it lies."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from turtlebot_gym.compiled.packing import TILE, access, aligned, as_tuple, layout_of, packing
from turtlebot_gym.compiled.program import compiled as compiled_now
from turtlebot_gym.compiled.values import numbers_of
from turtlebot_gym.systems import Parameters, make_parameters, system_of
from turtlebot_gym.values import senses_of


class Inner(NamedTuple):
    a: float
    flag: bool


class Outer(NamedTuple):
    first: Inner
    pair: tuple[float, float]
    nested: tuple[Inner, Inner]
    last: float


@dataclass(frozen=True)
class Data:
    number: float
    numbers: tuple[float, ...]
    inner: Inner


VALUE = Outer(Inner(1.0, True), (2.0, 3.0), (Inner(4.0, False), Inner(5.0, True)), 6.0)


def test_what_is_stored_is_loaded_again_in_order_and_in_every_lane():
    pack, numbers = packing(VALUE), [1.0, 1.0, 2.0, 3.0, 4.0, 0.0, 5.0, 1.0, 6.0]
    (load, store), buffer = access(pack), np.zeros(3 + pack.size * TILE)
    assert ([*map(float, numbers_of(VALUE))], pack.size) == (numbers, 9)
    for lane in range(TILE):
        store(buffer, 3 + lane, VALUE._replace(last=float(lane)))
    for lane in range(TILE):
        loaded = load(buffer, 3 + lane)
        assert loaded == VALUE._replace(last=float(lane))
        assert (type(loaded), type(loaded.nested[1])) == (Outer, Inner)
        assert (loaded.first.flag, loaded.nested[0].flag) == (True, False)


@pytest.mark.parametrize("known", [{}, {5: 5.0}])
def test_equal_numbers_share_a_place_constants_have_none_and_compiled_access_is_the_plain_one(known):
    pack = packing(VALUE._replace(pair=(2, 3)), [0, 6, 1, 2, 3, 4, 1, 5, 7], [known.get(at) for at in range(9)])
    load, store = access(pack)

    def copied(source, target):
        loaded = load(source, 1)
        store(target, 2, loaded)
        return loaded

    source, compiled, plain = np.random.default_rng(0).random(pack.size * TILE), *np.full((2, pack.size * TILE), np.nan)
    value = copied(source, plain)
    assert compiled_now(copied, "values in tests")(source, compiled) == value
    assert value.pair[0] == value.nested[1][0]
    np.testing.assert_array_equal(compiled, plain)
    assert np.flatnonzero(~np.isnan(plain)).tolist() == [2 + k * TILE for k in range(8) if k != 4 or not known]
    assert value.nested[0].flag is True


def test_slices_name_every_tuple_in_the_value():
    places = {"": (0, 9), "first": (0, 2), "pair": (2, 4), "nested": (4, 8), "nested[0]": (4, 6), "nested[1]": (6, 8)}
    assert packing(VALUE).slices == {name: slice(*ends) for name, ends in places.items()}


def test_dataclasses_become_tuples_with_the_same_attributes():
    value = as_tuple((Data(1.0, (2.0, 3.0), Inner(4.0, True)), 5.0))
    assert (value[0].number, value[0].numbers, value[0].inner) == (1.0, (2.0, 3.0), Inner(4.0, True))
    assert [*map(float, numbers_of(value))] == [1.0, 2.0, 3.0, 4.0, 1.0, 5.0]
    assert type(as_tuple(Data(0.0, (), Inner(0.0, False)))) is type(value[0])  # one type for all: the loop is compiled once
    assert senses_of(("odometry", "fix")) is senses_of(("odometry", "fix"))


def test_parameters_and_worlds_have_a_place_each():
    given = make_parameters(noise="rough")
    p, layout = as_tuple(given), layout_of(system_of(given))
    buffer = np.zeros(layout.parameters.size * TILE)
    load, store = access(layout.parameters)
    store(buffer, 0, p)
    assert load(buffer, 0) == p
    assert isinstance(p, Parameters)
    covariance = layout.world.slices["estimate.belief.covariance"]
    assert covariance.stop - covariance.start == 8
    assert layout.world.names[covariance.start] == "estimate.belief.covariance.xx"


@pytest.mark.parametrize("count", [1, 2 * TILE, 5000 * TILE])
def test_an_aligned_copy_begins_a_cache_line(count):
    copy = aligned(np.arange(3.0 * count).reshape(3, count))
    assert (copy.flags.carray, copy.ctypes.data % 64) == (True, 0)
    np.testing.assert_array_equal(copy, np.arange(3.0 * count).reshape(3, count))
