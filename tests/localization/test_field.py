"""Distance fields against brute force."""

import math

import numpy as np
import pytest

from turtlebot_gym.localization.descent import distance_at
from turtlebot_gym.rooms.field import REACH, field_of_cells, field_of_hits, sample

SIDE = 0.1


@pytest.fixture(params=range(4))
def occupied(request):
    rng = np.random.default_rng(request.param)
    return rng.random(rng.integers(3, 30, 2)) < rng.choice([0.02, 0.2, 0.6])


def nearest(marked, what):
    """Return the distance in cells from each cell to the nearest marked one, by comparing all pairs."""
    places = np.argwhere(marked)
    if not len(places):
        return np.full(what.shape, np.inf)
    cells = np.argwhere(np.ones_like(what))
    return np.sqrt(((cells[:, None] - places[None]) ** 2).sum(2).min(1)).reshape(what.shape)


def test_cells_and_hits_are_as_far_as_brute_force_says(occupied):
    cells, hits = np.empty(occupied.shape, np.float32), np.empty(occupied.shape, np.float32)
    field_of_cells(occupied, SIDE, cells)
    field_of_hits(occupied, SIDE, hits)
    to_occupied = nearest(occupied, occupied)
    expected = np.where(occupied, 0.5 - nearest(~occupied, occupied), to_occupied - 0.5) * SIDE
    np.testing.assert_allclose(cells, np.clip(expected, -REACH, REACH), atol=1e-6)
    np.testing.assert_allclose(hits, np.minimum(to_occupied * SIDE, REACH), atol=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.4])
def test_between_the_centres_a_field_is_bilinear_with_its_own_gradient(yaw):
    rng = np.random.default_rng(5)
    field, frame = rng.random((8, 9)).astype(np.float32), np.array([1.0, -2.0, math.cos(yaw), math.sin(yaw), SIDE])

    def at(column, row):
        """Return the world's coordinates of a place in cells."""
        x, y = column * SIDE, row * SIDE
        return frame[0] + math.cos(yaw) * x - math.sin(yaw) * y, frame[1] + math.sin(yaw) * x + math.cos(yaw) * y

    for place, cells in (((3.5, 4.5), field[4, 3]), ((4.0, 4.5), field[4, 3:5]), ((4.0, 5.0), field[4:6, 3:5])):
        assert sample(field, frame, *at(*place)).distance == pytest.approx(cells.mean())
    (x, y), h = at(3.8, 4.6), 1e-6
    known, _, *gradient = sample(field, frame, x, y)
    assert known
    for derivative, (dx, dy) in zip(gradient, ((h, 0.0), (0.0, h)), strict=True):
        change = sample(field, frame, x + dx, y + dy).distance - sample(field, frame, x - dx, y - dy).distance
        assert derivative == pytest.approx(change / (2.0 * h), rel=1e-5)


def test_in_or_beside_an_unknown_cell_and_outside_of_the_map_nothing_is_known():
    field, frame = np.zeros((6, 6), np.float32), np.array([0.0, 0.0, 1.0, 0.0, SIDE])
    field[2, 2] = np.nan
    assert sample(field, frame, 0.42, 0.42).known
    assert not any(sample(field, frame, *at).known for at in ((0.24, 0.24), (-0.1, 0.3), (0.3, 0.7), (0.02, 0.3), (1e9, 0.0)))
    for x, y, known in ((0.01, 0.3, True), (0.3, 0.01, True), (0.59, 0.59, True), (-0.01, 0.3, False), (0.24, 0.24, False)):
        assert math.isnan(distance_at(field, frame, x, y)) != known
