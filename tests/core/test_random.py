"""The counter-based draws: their distributions, and their bits."""

import math

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.models import random
from turtlebot_gym.models.random import _log_unit, episode_key, normals, uniforms

N = 20_000
FALSE_ALARM = 1e-6
"""Of each test, for perfect random numbers; the draws are fixed, so a pass stays one."""
KEY = episode_key(0, 0)


def along(what, draw=uniforms):
    """Return N draws (N, 2) that follow each other in one counter, all else being the same."""
    draws = {
        "seeds": lambda i: draw(episode_key(i, 0), 3, 1),
        "episodes": lambda i: draw(episode_key(0, i), 3, 1),
        "steps": lambda i: draw(KEY, i, 1),
        "streams": lambda i: draw(episode_key(0, i // 7), 3, i % 7),
    }
    return np.array([draws[what](i) for i in range(N)])


@pytest.mark.parametrize("counter", ["seeds", "episodes", "steps", "streams"])
def test_uniforms_are_uniform_and_normals_normal(counter):
    for column in along(counter).T:
        assert 0.0 < column.min() < column.max() < 1.0
        assert stats.kstest(column, "uniform").pvalue > FALSE_ALARM
    for column in along(counter, normals).T:
        assert stats.kstest(column, "norm").pvalue > FALSE_ALARM
        tail = stats.binomtest(int((np.abs(column) > 3.0).sum()), N, 2.0 * stats.norm.sf(3.0))
        assert tail.pvalue > FALSE_ALARM


def test_log_unit_is_accurate():
    rng = np.random.default_rng(0)
    numbers = [*(2.0 ** rng.uniform(-63.0, 0.0, 20_000)).tolist(), *(1.0 - 2.0 ** rng.uniform(-52.0, 0.0, 5000)).tolist()]
    edges = [1.0, 0.5, 0.25, 2.0**-31, 2.0**-32, 2.0**-33, 2.0**-62, 0.7071067811865476, 0.7071067811865475]
    numbers += [min(math.nextafter(x, to), 1.0) for x in edges for to in (0.0, x, 1.0)]  # where it halves
    np.testing.assert_allclose([_log_unit(x) for x in numbers], np.log(numbers), rtol=1e-15, atol=0.0)


# The draws are frozen: a seed gives the same episode in every later version. Rollouts: tests/golden.


def test_the_first_draws_of_all_and_the_streams_are_frozen():
    assert uniforms(4258668631600825077, 0, 0) == (0.16548430838156492, 0.8458544864552096)
    names = "PROCESS POSITION HEADING EVENTS SLIP START GOAL LEAP COUNT ROOM SCAN FIX SENSOR GYRO GOALS"
    assert [getattr(random, name) for name in names.split()] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 1, 2, 3, 4, 5, 7]
    assert KEY == 4258668631600825077
