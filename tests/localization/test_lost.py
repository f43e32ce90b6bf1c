"""A robot that is lost looks for its scan in the whole map; one that is carried off or leaves the map knows that it is lost."""

import math

import numpy as np
import pytest
from localization_rooms import corridor, empty_hall, hall, make_room, off, scan_of, sight

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.bank import COLUMNS, LOG_WEIGHT, NONE, ROWS, exp, insert
from turtlebot_gym.localization.descent import SILENT_BEAMS, agreeing, verdict
from turtlebot_gym.localization.hypotheses import CYCLE, ENOUGH, look, nowhere
from turtlebot_gym.localization.information import Guess
from turtlebot_gym.localization.localizer import LOST, SURE, TRACKING, locate, move, scan, state_of
from turtlebot_gym.localization.tuning import ROBOT, LocalizerTuning
from turtlebot_gym.values import STOP, Pose

Q = LocalizerTuning()
HERE, THERE = (1.7, 2.1, 0.4), (4.6, 0.8, -2.9)
CLOSE, REST, NO_DRIFT = (1e-4, 1e-4, 1e-4), Pose(0.0, 0.0, 0.0), (0.0, 0.0)


def empty():
    return np.zeros((ROWS, COLUMNS))


@pytest.fixture(scope="module")
def room():
    return make_room(hall())


@pytest.fixture(scope="module")
def in_machine_code():
    if not HAS_LLVM:
        pytest.skip("takes minutes in plain Python")
    q = as_tuple(ROBOT)
    function = compiled(lambda located, bank, seen, wheels, q: look(located, bank, seen, wheels, q), "look at a scan")
    return lambda located, bank, seen, wheels=REST: function(located, bank, seen, wheels, q)


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


@pytest.mark.parametrize("known", [1.5, 3.0, 4.5])
def test_beams_that_end_in_the_unknown_say_nothing_for_or_against_any_pose(room, known):
    """Without them the others say the same, until so many are silent that the pose is not confirmed."""
    field, rng, silent_shares = room.field.copy(), np.random.default_rng(0), []
    field[:, int(known / 0.05) :] = np.nan
    half = room._replace(field=field)
    for _ in range(20):
        points = scan_of(room, (rng.uniform(0.5, 2.8), rng.uniform(0.5, 2.8), rng.uniform(-3.0, 3.0)), 60)
        at = Guess(rng.uniform(0.5, known), rng.uniform(0.5, 3.5), rng.uniform(-3.0, 3.0), 0.0)
        speaks = np.array([verdict(sight(half, points[:, [k]]), at, ROBOT)[2] == 0.0 for k in range(points.shape[1])])
        silent = 1.0 - speaks.mean()
        silent_shares.append(silent)
        if speaks.any() and silent <= SILENT_BEAMS:
            alone = agreeing(sight(half, np.ascontiguousarray(points[:, speaks])), at, ROBOT)
            assert agreeing(sight(half, points), at, ROBOT) == pytest.approx(alone)
        else:
            assert agreeing(sight(half, points), at, ROBOT) <= (1.0 - silent) / (1.0 - SILENT_BEAMS) + 1e-9
    assert min(silent_shares) <= SILENT_BEAMS < max(silent_shares)


def test_people_hardly_move_the_belief_and_do_not_put_it_in_doubt(room):
    """The partner: what passes through walls does, by as many beams."""
    points, rng, errors = scan_of(room, HERE, 60), np.random.default_rng(0), []
    located, bank = locate(Pose(*HERE), CLOSE, ROBOT), empty()
    for _ in range(40):
        located = look(located, bank, sight(room, crowded(points, rng, 0.25)), REST, ROBOT)
        errors.append(max(off(located, HERE)))
        assert state_of(located, ROBOT) == TRACKING
    assert max(errors) < 0.02
    for _ in range(int(ROBOT.patience)):
        located = scan(located, sight(room, ended(points, np.arange(0, 60, 2), 1.7)), ROBOT)
    assert state_of(located, ROBOT) == LOST


@pytest.mark.parametrize("start", [(500.0, 500.0, 0.0), (-3.0, 2.0, 1.0)])
def test_a_belief_outside_of_the_map_is_lost_after_its_patience_and_found_by_its_evidence(room, start, in_machine_code):
    points, bank, states = scan_of(room, HERE, 60), empty(), []
    located = locate(Pose(*start), (0.02, 0.02, 0.02), ROBOT)
    for _ in range(int(ROBOT.patience + ROBOT.evidence) + CYCLE):
        located = in_machine_code(located, bank, sight(room, points))
        states.append(state_of(located, ROBOT))
    assert TRACKING not in states[: int(ROBOT.patience)]
    assert states[int(ROBOT.patience) - 1] == LOST
    assert states[-1] == TRACKING
    assert max(off(located, HERE)) < 0.02


@pytest.mark.parametrize("unknown", [True, False])
def test_among_people_a_robot_is_found_and_its_own_place_not_given_up_before(room, unknown, in_machine_code):
    """Without a place of its own it may take one that nearly all beams of a scan fit by luck."""
    points, rng, bank = scan_of(room, THERE, 60), np.random.default_rng(1), empty()
    located, since = nowhere(ROBOT) if unknown else locate(Pose(*HERE), CLOSE, ROBOT), None
    for number in range(int(ENOUGH) + int(ROBOT.patience) + 30):
        located = in_machine_code(located, bank, sight(room, crowded(points, rng, 0.25)))
        if since is None and state_of(located, ROBOT) == TRACKING and number > ROBOT.patience:
            since = number
    assert since is not None
    assert unknown or since >= ENOUGH - 1
    assert max(off(located, THERE)) < 0.05


def driven(room, half, way, wheels, in_machine_code):
    """Return states and errors of a robot that drives through a room, and localizes itself in a part of its map."""
    located, bank, results = locate(way[0], CLOSE, ROBOT), empty(), []
    for k, at in enumerate(way):
        if k > 0:
            located = move(located, wheels[k - 1], wheels[k], STOP, NO_DRIFT, 0.2, ROBOT)
        located = in_machine_code(located, bank, sight(half, scan_of(room, at, 60)), wheels[k])
        results.append((state_of(located, ROBOT), max(off(located, at))))
    return tuple(map(np.array, zip(*results, strict=True)))


@pytest.mark.parametrize("known", [3.0, 4.0])
def test_a_belief_that_leaves_its_map_is_not_driven_by_for_long_and_right_again_inside(room, known, in_machine_code):
    """Its partner: a belief in the whole map, which is never lost on the same way."""
    field, x = room.field.copy(), np.concatenate((np.full(10, 0.8), np.linspace(0.8, 4.8, 60), np.linspace(4.8, 0.8, 60)))
    field[:, int(known / 0.05) :] = np.nan
    way, wheels = [Pose(at, 2.75, 0.2) for at in x], [Pose(1.03 * at, 2.75, 0.2) for at in x]
    states, errors = driven(room, room._replace(field=field), way, wheels, in_machine_code)
    outside, wrong = np.flatnonzero(x > known + 0.5), (states == TRACKING) & (errors > 0.5)
    assert all(wrong[k : k + 15].sum() < 15 for k in range(len(wrong)))
    assert (states[outside[15:]] == LOST).all()
    assert TRACKING in states[outside[-1] : outside[-1] + 50]
    states, errors = driven(room, room, way, wheels, in_machine_code)
    assert (states == TRACKING).all()
    assert errors.max() < 0.1


@pytest.mark.parametrize("spike", [(0.0, -0.6, 0.0), (0.3, 0.3, -0.35)])
def test_a_robot_whose_scans_fit_is_not_lost_by_a_leap_of_its_odometry(room, spike, in_machine_code):
    way = [Pose(0.8 + 0.02 * k, 2.75, 0.2) for k in range(40)]
    leapt = [Pose(*(a + b for a, b in zip(at, spike, strict=True))) if k % 20 == 10 else at for k, at in enumerate(way)]
    states, errors = driven(room, room, way, leapt, in_machine_code)
    assert LOST not in states
    assert errors.max() < 0.1


@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (0.25, 0.25), (0.0, 0.25), (0.1, 0.3)])
def test_a_place_believed_anew_is_left_if_more_beams_end_short_than_before(room, before, after, in_machine_code):
    """Its partner: the same beams do not move a robot whose place was never in doubt."""
    points, rng, located = scan_of(room, HERE, 60), np.random.default_rng(0), nowhere(ROBOT)
    bank, other = empty(), empty()
    while state_of(located, ROBOT) != TRACKING:
        located = in_machine_code(located, bank, sight(room, crowded(points, rng, before)))
    undoubted, states = locate(Pose(*HERE), CLOSE, ROBOT), []
    for _ in range(40):
        seen = sight(room, crowded(points, rng, after))
        located, undoubted = in_machine_code(located, bank, seen), in_machine_code(undoubted, other, seen)
        states.append((state_of(located, ROBOT), state_of(undoubted, ROBOT)))
    anew, kept = zip(*states, strict=True)
    assert LOST not in kept
    assert (LOST in anew) == (after > before)


def test_in_a_long_corridor_a_place_that_looks_like_all_others_is_not_believed(in_machine_code):
    """Its partner: an end that is in sight tells them apart."""
    occupied = np.pad(corridor(), ((0, 0), (0, 400)), mode="edge")
    open_room, states = make_room(occupied), []
    for x, ends in ((20.0, False), (2.5, True)):
        occupied[:, :10], occupied[:, 20:24], occupied[30:50, 40:44] = ends, False, ends
        room, bank, located = make_room(occupied), empty(), nowhere(ROBOT)
        points = scan_of(room if ends else open_room, (x, 1.5, 0.1), 60)
        for _ in range(int(ROBOT.evidence) + CYCLE):
            located = in_machine_code(located, bank, sight(room, points))
        states.append(state_of(located, ROBOT))
    assert states == [LOST, TRACKING]


def looks(located, room, points, times, bank):
    for _ in range(times):
        located = look(located, bank, sight(room, points), REST, Q)
    return located


@pytest.mark.parametrize(("pose", "yaw"), [(HERE, 0.0), (THERE, 1.0), ((1.0, 3.9, 1.6), 1.0)])
def test_an_unknown_start_is_found(pose, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    assert state_of(nowhere(Q), Q) == LOST
    points = scan_of(make_room(hall()), pose)
    located = looks(nowhere(Q), make_room(hall(), yaw, (2.0, 1.0)), points, CYCLE + 1, empty())
    turned = (2.0 + c * pose[0] - s * pose[1], 1.0 + s * pose[0] + c * pose[1], pose[2] + yaw)
    assert max(off(located, turned)) < 0.02
    assert state_of(located, Q) == TRACKING
    assert located.weight == 1.0


@pytest.mark.parametrize(("usually", "now", "doubts"), [(0, 4, True), (4, 4, False)])
def test_more_misfits_than_usual_put_the_place_in_doubt(room, usually, now, doubts):
    """Of 40 beams so many end short, at what is not on the map; the first doubt of these is confirmed to be none."""
    bank, counts, points, located = empty(), [], scan_of(room, HERE), locate(Pose(*HERE), CLOSE, Q)
    for strays, times in ((usually, 100), (now, int(Q.patience))):
        short = ended(points, np.arange(strays) * 40 // max(strays, 1), 0.5)
        for _ in range(times):
            located = looks(located, room, short, 1, bank)
            counts.append(located.misfits)
    assert (counts[-1] >= Q.patience) == doubts
    assert (max(counts[:-8]) >= Q.patience) == (usually > 0)
    assert max(off(located, HERE)) < 0.03


def test_where_two_places_look_alike_both_stay_and_move_with_the_wheels():
    room, bank, (x, y, theta) = make_room(empty_hall()), empty(), HERE
    located = looks(nowhere(Q), room, scan_of(room, HERE), 10 * CYCLE, bank)
    for step in range(8):
        if step > 0:
            before, now = (Pose(0.1 * at, 0.0, 0.0) for at in (step - 1, step))
            x, y = x + 0.1 * math.cos(theta), y + 0.1 * math.sin(theta)
            located = move(located, before, now, STOP, NO_DRIFT, 0.0, Q)
            located = look(located, bank, sight(room, scan_of(room, (x, y, theta))), now, Q)
        assert state_of(located, Q) == LOST
        assert 0.3 < located.weight < SURE
        assert (bank[:, LOG_WEIGHT] > NONE).sum() == 2
        assert located.belief.covariance.xx > 0.2, "the belief is as wide as the hypotheses are apart"
        mirrored = (112 * 0.05 - x, 92 * 0.05 - y, theta + math.pi)
        assert min(max(off(located, (x, y, theta))), max(off(located, mirrored))) < 0.03


def test_only_a_hypothesis_keeps_another_from_its_place():
    bank = empty()
    bank[:, LOG_WEIGHT] = NONE
    for count, x in ((1, 0.0), (1, 0.01), (2, 3.0)):
        insert(bank, Pose(x, 0.0, 0.0), REST, -1.0)
        assert (bank[:, LOG_WEIGHT] > NONE).sum() == count


def test_weights_are_exponentials():
    x = np.linspace(-10.0, 0.0, 41)
    np.testing.assert_allclose([exp(number) for number in x], np.exp(x), rtol=0.05)
