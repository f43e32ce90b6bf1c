"""Lost means lost: who has left the map, and who is carried off among people; what beams of people say about a place."""

import math

import numpy as np
import pytest
from localization_rooms import hall, make_room, scan_of, sight

from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.bank import COLUMNS, ROWS
from turtlebot_gym.localization.hypotheses import CYCLE, ENOUGH, look, nowhere
from turtlebot_gym.localization.information import Guess
from turtlebot_gym.localization.localizer import LOST, TRACKING, locate, move, scan, state_of
from turtlebot_gym.localization.passing import agreeing
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.values import STOP, Pose

HERE, THERE = (1.7, 2.1, 0.4), (4.6, 0.8, -2.9)
SURE, REST, NO_DRIFT = (1e-4, 1e-4, 1e-4), Pose(0.0, 0.0, 0.0), (0.0, 0.0)


@pytest.fixture(scope="module")
def room():
    return make_room(hall())


def ended(points, at, share):
    """Return a scan of which some beams end at a share of their range."""
    changed = points.copy()
    changed[np.ix_([0, 1, 4], at)] *= share
    return changed


def crowded(points, rng, share):
    """Return a scan of which a share of the beams, in blocks of four, ends at people."""
    blocks = points.shape[1] // 4
    hidden = np.repeat(rng.permutation(blocks) < share * blocks, 4)
    return ended(points, np.flatnonzero(hidden), np.repeat(rng.uniform(0.1, 0.9, blocks), 4)[: hidden.sum()])


def off(located, pose):
    mean = located.belief.mean
    return max(math.hypot(mean.x - pose[0], mean.y - pose[1]), abs(math.remainder(mean.theta - pose[2], 2.0 * math.pi)))


@pytest.mark.parametrize(("share", "agrees"), [(1.0, 1.0), (0.4, 30.0 / (30.0 + 10.0 * ROBOT.short)), (1.7, 30.0 / 40.0)])
def test_a_beam_that_ends_short_says_less_than_one_that_goes_through_a_wall(room, share, agrees):
    """10 of 40 beams: where nothing stands near, and to behind the walls."""
    points = scan_of(room, (3.0, 1.6, 0.0))
    at = np.argsort(points[4])[-10:]
    seen = ended(points, at, share)
    ends = np.array([agreeing(sight(room, seen[:, [k]]), Guess(3.0, 1.6, 0.0, 0.0), ROBOT) for k in at])
    if share != 1.0:
        seen = seen[:, np.concatenate((np.setdiff1d(np.arange(40), at), at[ends < 0.5]))]
        agrees = 30.0 / (30.0 + (30.0 / agrees - 30.0) * (ends < 0.5).mean())
    assert agreeing(sight(room, seen), Guess(3.0, 1.6, 0.0, 0.0), ROBOT) == pytest.approx(agrees)


def test_beams_that_end_in_the_unknown_contradict(room):
    points, field = scan_of(room, HERE), room.field.copy()
    field[:, :40] = np.nan
    x = HERE[0] + math.cos(HERE[2]) * points[0] - math.sin(HERE[2]) * points[1]
    share = agreeing(sight(room._replace(field=field), points), Guess(*HERE, 0.0), ROBOT)
    assert share == pytest.approx(np.mean(x > 2.0), abs=0.05)


def test_people_hardly_move_the_belief_and_do_not_put_it_in_doubt(room):
    """The partner: what passes through walls does, by as many beams."""
    points, rng, errors = scan_of(room, HERE, 60), np.random.default_rng(0), []
    located, bank = locate(Pose(*HERE), SURE, ROBOT), np.zeros((ROWS, COLUMNS))
    for _ in range(40):
        located = look(located, bank, sight(room, crowded(points, rng, 0.25)), REST, ROBOT)
        errors.append(off(located, HERE))
        assert state_of(located, ROBOT) == TRACKING
    assert max(errors) < 0.02
    for _ in range(int(ROBOT.patience)):
        located = scan(located, sight(room, ended(points, np.arange(0, 60, 2), 1.7)), ROBOT)
    assert state_of(located, ROBOT) == LOST


@pytest.mark.parametrize("start", [(500.0, 500.0, 0.0), (-3.0, 2.0, 1.0)])
def test_a_belief_that_has_left_the_map_is_lost_after_its_patience_and_found_by_a_few_scans(room, start):
    points, bank, states = scan_of(room, HERE, 60), np.zeros((ROWS, COLUMNS)), []
    located = locate(Pose(*start), (0.02, 0.02, 0.02), ROBOT)
    for _ in range(int(ROBOT.patience) + 2 * CYCLE):
        located = look(located, bank, sight(room, points), REST, ROBOT)
        states.append(state_of(located, ROBOT))
    assert TRACKING not in states[: int(ROBOT.patience)]
    assert states[int(ROBOT.patience) - 1] == LOST
    assert states[-1] == TRACKING
    assert off(located, HERE) < 0.02


@pytest.mark.skipif(not HAS_LLVM, reason="takes a minute in plain Python")
@pytest.mark.parametrize("unknown", [True, False])
def test_among_people_a_robot_is_found_and_its_own_place_not_given_up_before(room, unknown, in_machine_code):
    """Without a place of its own it may take one that nearly all beams of a scan fit by luck."""
    points, rng, bank = scan_of(room, THERE, 60), np.random.default_rng(1), np.zeros((ROWS, COLUMNS))
    located, since = nowhere(ROBOT) if unknown else locate(Pose(*HERE), SURE, ROBOT), None
    for number in range(int(ENOUGH) + int(ROBOT.patience) + 30):
        located = in_machine_code(located, bank, sight(room, crowded(points, rng, 0.25)))
        if since is None and state_of(located, ROBOT) == TRACKING and number > ROBOT.patience:
            since = number
    assert since is not None
    assert unknown or since >= ENOUGH - 1
    assert off(located, THERE) < 0.05


@pytest.fixture(scope="module")
def in_machine_code():
    from turtlebot_gym.compiled.cache import compiled
    from turtlebot_gym.compiled.packing import as_tuple

    q = as_tuple(ROBOT)
    function = compiled(lambda located, bank, seen, wheels, q: look(located, bank, seen, wheels, q), "look at a scan")
    return lambda located, bank, seen: function(located, bank, seen, REST, q)


def test_in_a_long_corridor_a_place_that_looks_like_all_others_is_not_believed():
    """Its partner: an end that is in sight tells them apart."""
    occupied = np.zeros((60, 800), np.bool_)
    occupied[:10], occupied[50:] = True, True
    open_room, states = make_room(occupied), []
    for x, ends in ((20.0, False), (2.5, True)):
        occupied[:, :10], occupied[:, 20:24] = ends, False
        occupied[30:50, 40:44] = ends
        room, bank, located = make_room(occupied), np.zeros((ROWS, COLUMNS)), nowhere(ROBOT)
        points = scan_of(room if ends else open_room, (x, 1.5, 0.1), 60)
        for _ in range(3 * CYCLE):
            located = look(located, bank, sight(room, points), REST, ROBOT)
        states.append(state_of(located, ROBOT))
    assert states == [LOST, TRACKING]


def test_time_passes_by_moving():
    located = locate(Pose(0.0, 0.0, 0.0), SURE, ROBOT)
    for _ in range(3):
        located = move(located, REST, REST, STOP, NO_DRIFT, 0.25, ROBOT)
    assert located.silent == 0.75
