"""A robot that does not know where it is looks for its scan in the whole map, and follows the places that explain it."""

import math

import numpy as np
import pytest
from localization_rooms import empty_hall, hall, make_room, nonsense, off, scan_of, sight

from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.bank import COLUMNS, LOG_WEIGHT, MOST, NONE, ROWS, exp
from turtlebot_gym.localization.hypotheses import CYCLE, look, nowhere
from turtlebot_gym.localization.localizer import LOST, SURE, TRACKING, locate, move, state_of
from turtlebot_gym.localization.seek import seek
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.values import STOP, Pose

Q = LocalizerTuning()
POSES = [(1.7, 2.1, 0.4), (4.6, 0.8, -2.9), (1.0, 3.9, 1.6), (4.0, 3.0, 3.1)]


def looks(located, room, points, times=CYCLE, bank=None):
    bank = np.zeros((ROWS, COLUMNS)) if bank is None else bank
    for _ in range(times):
        located = look(located, bank, sight(room, points), Pose(0.0, 0.0, 0.0), Q)
    return located


@pytest.mark.sample(3)
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_an_unknown_start_is_found(pose, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    room, points = make_room(hall(), yaw, (2.0, 1.0)), scan_of(make_room(hall()), pose)
    located = nowhere(Q)
    assert state_of(located, Q) == LOST
    located = looks(located, room, points, CYCLE + 1)
    turned = (2.0 + c * pose[0] - s * pose[1], 1.0 + s * pose[0] + c * pose[1], pose[2] + yaw)
    assert max(off(located, turned)) < 0.02
    assert state_of(located, Q) == TRACKING
    assert located.weight == 1.0


@pytest.mark.sample(1)
@pytest.mark.parametrize(("usually", "now", "doubts"), [(0, 0, False), (0, 4, True), (4, 4, False), (4, 24, True)])
def test_more_misfits_than_usual_put_the_place_in_doubt(usually, now, doubts):
    """Of 40 beams so many end short, at what is not on the map; the first doubt of these is confirmed to be none."""
    room, bank, counts = make_room(hall()), np.zeros((ROWS, COLUMNS)), []
    points, located = scan_of(room, POSES[0]), locate(Pose(*POSES[0]), (1e-4, 1e-4, 1e-4), Q)
    for strays, times in ((usually, 100), (now, int(Q.patience))):
        short = points.copy()
        short[np.ix_([0, 1, 4], np.arange(strays) * 40 // max(strays, 1))] *= 0.5
        for _ in range(times):
            located = looks(located, room, short, 1, bank)
            counts.append(located.misfits)
    assert (counts[-1] >= Q.patience) == doubts
    assert (max(counts[:-8]) >= Q.patience) == (usually > 0)
    assert max(off(located, POSES[0])) < 0.03


def test_where_two_places_look_alike_both_stay_and_move_with_the_wheels():
    """The partner of the first test."""
    room, bank, (x, y, theta) = make_room(empty_hall()), np.zeros((ROWS, COLUMNS)), POSES[0]
    located = looks(nowhere(Q), room, scan_of(room, POSES[0]), 10 * CYCLE, bank)
    for step in range(8):
        if step > 0:
            before, now = (Pose(0.1 * at, 0.0, 0.0) for at in (step - 1, step))
            located, x, y = (
                move(located, before, now, STOP, (0.0, 0.0), 0.0, Q),
                x + 0.1 * math.cos(theta),
                y + 0.1 * math.sin(theta),
            )
            located = look(located, bank, sight(room, scan_of(room, (x, y, theta))), now, Q)
        assert state_of(located, Q) == LOST
        assert 0.3 < located.weight < SURE
        assert (bank[:, LOG_WEIGHT] > NONE).sum() == 2
        assert located.belief.covariance.xx > 0.2, "the belief is as wide as the hypotheses are apart"
        mirrored = (112 * 0.05 - x, 92 * 0.05 - y, theta + math.pi)
        assert min(max(off(located, (x, y, theta))), max(off(located, mirrored))) < 0.03


def test_a_scan_that_no_place_explains_leaves_it_lost():
    room, rng, located, bank = make_room(hall()), np.random.default_rng(1), nowhere(Q), np.zeros((ROWS, COLUMNS))
    for _ in range(4 * CYCLE):
        located = looks(located, room, nonsense(rng, 0.4, 3.0), 1, bank)
        assert state_of(located, Q) == LOST


def test_weights_are_exponentials():
    x = np.linspace(-10.0, 0.0, 41)
    np.testing.assert_allclose([exp(number) for number in x], np.exp(x), rtol=0.05)


@pytest.mark.skipif(not HAS_LLVM, reason="needs llvmlite")
def test_the_whole_map_is_searched_the_same_in_loops_and_in_arrays(in_hall):
    from turtlebot_gym.compiled.program import compiled

    room, _, points = in_hall
    room, results = room._replace(field=room.field.copy()), []
    room.field[:20, :20] = np.nan
    for function in (seek, compiled(seek, "the whole map")):
        poses, values = np.empty((MOST, 3)), np.empty(MOST)
        results.append((function(sight(room, points), poses, values), poses.tolist(), values.tolist()))
    assert results[0] == results[1]
