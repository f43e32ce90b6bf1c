"""The tracker: what moves becomes a track with its velocity, what stands does not, however the robot drives."""

import math
import sys

import numpy as np
import pytest

from turtlebot_gym import Episode
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.observations import NEAREST
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.systems import Options
from turtlebot_gym.tracking import tracker
from turtlebot_gym.tracking.bodies import AT, RADIUS
from turtlebot_gym.tracking.sweep import Sweep
from turtlebot_gym.tracking.tracker import MOVES, STATE, TIME, begin, look, make_memory, memory_at, on_odometry, on_scan
from turtlebot_gym.values import Command, Pose

BEAMS, REVOLUTION, DT = 360, 0.2, 0.05
LIDAR, SCALE = Lidar(range_min=0.12, range_max=8.0, deviation=0.005, deviation_share=0.0175), 0.03
SWEEP = Sweep(LIDAR, BEAMS, 0.0, math.tau / BEAMS, 0.0, REVOLUTION / BEAMS, -0.03, 0.0, 8.0)
HALL = 3.0
"""Half the side of a square hall, m."""


def ranges_at(poses, circles_at, times, rng):
    """Return the range of each beam, measured at its own pose and time among round things."""
    x, y, theta = poses.T
    at_x, at_y = x + SWEEP.x * np.cos(theta), y + SWEEP.x * np.sin(theta)
    angles = theta + SWEEP.first + SWEEP.step * np.arange(BEAMS) + 1e-9
    dx, dy = np.cos(angles), np.sin(angles)
    lengths = np.minimum((HALL - np.sign(dx) * at_x) / abs(dx), (HALL - np.sign(dy) * at_y) / abs(dy))
    for beam, time in enumerate(times):
        for cx, cy, radius in circles_at(time):
            along = (cx - at_x[beam]) * dx[beam] + (cy - at_y[beam]) * dy[beam]
            across = (cx - at_x[beam]) * dy[beam] - (cy - at_y[beam]) * dx[beam]
            if along > 0.0 and abs(across) < radius:
                lengths[beam] = min(lengths[beam], along - math.sqrt(radius**2 - across**2))
    lengths += rng.normal(size=BEAMS) * np.maximum(LIDAR.deviation, LIDAR.deviation_share * lengths)
    return np.where(lengths < LIDAR.range_min, math.inf, lengths)


def drive(circles_at, seconds, *, v=0.0, omega=0.0, seed=0):
    """Yield the time, the tracker and the robot's pose after each scan of a drive with constant speeds."""
    memory = memory_at(make_memory(1, beams=BEAMS, poses=tracker.poses_for(REVOLUTION, DT)), 0)
    rng = np.random.default_rng(seed)

    def poses(times):
        turn = omega * times
        if omega == 0.0:
            return np.stack((v * times, 0.0 * times, turn), 1)
        return np.stack((v / omega * np.sin(turn), v / omega * (1.0 - np.cos(turn)), turn), 1)

    def pose(time):
        return Pose(*poses(np.array([time]))[0].tolist())

    begin(memory, 0.0, pose(0.0))
    for step in range(1, round(seconds / DT) + 1):
        time = step * DT
        on_odometry(memory, time, pose(time))
        if step % round(REVOLUTION / DT) == 0:
            times = time - SWEEP.interval * np.arange(BEAMS - 1, -1, -1)
            on_scan(memory, ranges_at(poses(times), circles_at, times, rng), SWEEP._replace(last=time))
            look(memory.tracks, memory.seen, time, pose(time), Command(v, omega), SCALE)
            yield time, memory, pose(time)


def rows_of(memory):
    """Return the tracks of what moves that a policy sees, shape (n, 8)."""
    rows = memory.seen.reshape(NEAREST, 8)
    return rows[rows[:, -1] == 1.0]


@pytest.mark.parametrize(("v", "omega"), [(0.0, 0.0), (0.2, 0.8)])
@pytest.mark.parametrize("legs", [False, True])
def test_who_walks_is_one_track_with_its_velocity(v, omega, legs):
    velocity, errors, off = np.array([-0.2, 0.9]), [], []

    def person(time):
        x, y = 1.6 + velocity[0] * time, -2.2 + velocity[1] * time
        if not legs:
            return [(x, y, 0.25)]
        swing = 0.15 * math.sin(math.tau * time)  # along the way; the legs are beside each other
        return [(x - 0.12, y + swing, 0.06), (x + 0.12, y - swing, 0.06)]

    for time, memory, pose in drive(person, 4.0, v=v, omega=omega):
        if time > 1.5:
            (row,), turn = rows_of(memory), complex(math.cos(pose.theta), math.sin(pose.theta))
            errors.append(abs(complex(row[2], row[3]) * turn - complex(*velocity)))
            off.append(abs(complex(row[0], row[1]) * turn - complex(*(np.array([1.6, -2.2]) + velocity * time - pose[:2]))))
    assert math.sqrt(np.mean(np.square(off))) < (0.2 if legs else 0.12)
    assert math.sqrt(np.mean(np.square(errors))) < (0.45 if legs else 0.15)


PILLARS = [(1.5, 0.8, 0.15), (-1.2, 1.0, 0.1), (0.4, -1.4, 0.25), (2.4, -2.0, 0.08), (-2.0, -1.5, 0.2)]


@pytest.mark.parametrize(
    ("things", "v", "omega"),
    [
        (lambda time: PILLARS, 0.2, 0.0),
        (lambda time: PILLARS, 0.1, 1.5),
        (lambda time: PILLARS, 0.2, -0.7),
        (lambda time: [(1.0 + 0.1 * math.sin(3.0 * time), 0.8, 0.06)], 0.0, 0.0),
    ],
    ids=["stands", "stands, turning", "stands, on an arc", "back and forth"],
)
def test_what_stands_or_only_moves_back_and_forth_is_no_track(things, v, omega):
    assert not any(rows_of(memory).size for _, memory, _ in drive(things, 8.0, v=v, omega=omega))


def test_who_stops_is_forgotten_and_who_was_hidden_is_not_there():
    seen = [len(rows_of(memory)) for _, memory, _ in drive(lambda time: [(2.0 - 0.8 * min(time, 2.0), 1.0, 0.25)], 13.0)]
    assert seen[8] == 1
    assert seen[20] == 1
    assert seen[-1] == 0


@pytest.mark.parametrize("direction", np.arange(0.0, math.tau, 0.25 * math.pi))
def test_who_comes_up_to_the_robot_is_still_a_track_where_a_part_is_too_near_to_be_measured(direction):
    touching = 0.105 + 0.28

    def person(time):
        far = max(2.0 - 0.7 * time, touching)
        return [(far * math.cos(direction), far * math.sin(direction), 0.28)]

    for time, memory, _ in drive(person, 6.0):
        if time > 1.5:
            rows = rows_of(memory)
            assert len(rows) == 1, time
            far = math.hypot(rows[0, 0], rows[0, 1])
            assert abs(far - max(2.0 - 0.7 * time, touching)) < 0.25, time


@pytest.mark.parametrize("omega", [0.0, 0.3, -1.0])
@pytest.mark.parametrize("ahead", [-0.1, -0.05, 0.0, 0.05])
def test_who_comes_where_a_revolution_begins_and_ends_is_tracked_by_that_revolution(omega, ahead):
    def person(time):  # always where the LiDAR begins and ends
        away, at = 2.5 - 0.6 * time, omega * time + ahead
        return [(away * math.cos(at), away * math.sin(at), 0.25)]

    seen, ages = [], []
    for time, memory, _ in drive(person, 3.0, omega=omega):
        seen += [len(rows_of(memory))] if time > 1.2 else []
        ages += [time - track[TIME] for track in memory.tracks if track[STATE] == MOVES]
    assert np.mean(seen) >= 0.9
    assert max(ages) < 0.5 * REVOLUTION or omega != 0.0 or ahead > 0.0


def test_who_stands_behind_a_post_beside_the_lidar_is_one_body(monkeypatch):
    post = np.abs(np.arange(BEAMS) - 45) <= 3
    monkeypatch.setattr(sys.modules[__name__], "ranges_at", lambda *given, of=ranges_at: np.where(post, math.nan, of(*given)))

    for time, memory, _ in drive(lambda time: [(0.8, 0.8, 0.25)], 2.0):
        bodies = memory.bodies[memory.bodies[:, AT] > time - REVOLUTION]
        bodies = bodies[np.hypot(*(bodies[:, :2] - (0.8, 0.8)).T) < 0.5]
        assert len(bodies) == 1
        assert bodies[0, RADIUS] == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("behind", [0.05, 0.2])
def test_two_side_by_side_are_two_bodies_and_a_wide_one_is_not_cut(behind):
    def people(time):
        return [(1.6 - 0.4 * time, -0.22, 0.25), (1.6 - 0.4 * time + behind, 0.26, 0.25)]

    assert min(len(rows_of(memory)) for time, memory, _ in drive(people, 2.6) if time > 1.9) == 2
    for time, memory, _ in drive(lambda time: [(0.9, 0.7, 0.4)], 2.0):
        bodies = memory.bodies[memory.bodies[:, AT] > time - REVOLUTION]
        assert sum(np.hypot(*(bodies[:, :2] - (0.9, 0.7)).T) < 0.5) == 1


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_who_steps_out_from_behind_something_is_seen_at_once(side):
    wall = [(1.0, side * y, 0.06) for y in np.arange(0.0, 1.2, 0.1)]

    def people(time):
        return [*wall, (1.4, side * (1.0 - 0.8 * max(time - 1.0, 0.0)), 0.25)]

    first = next(time for time, memory, _ in drive(people, 4.0) if memory.seen[7] > 0.0)
    assert people(first)[-1][1] * side > -0.45  # not all of the body is out


@pytest.mark.parametrize("lidar", ["lds01", pytest.param("a1", marks=pytest.mark.slow)])
def test_it_is_the_same_compiled_and_in_plain_python(lidar, in_step):
    options = Options(world="people", lidar=lidar, noise="wheel", observation="ekf,tracks")
    p, waypoints, plan, system = options.setup()
    batch = Batch(35, p, waypoints, system=system, plan=plan)
    plain = {i: Episode(p, waypoints, seed=i, system=system, plan=plan) for i in (0, 33)}
    for _ in in_step(batch, plain, [0.0, -0.5], [1.0, 0.5], 50):
        pass
    for i, episode in plain.items():
        assert (episode.scene.tracker.tracks[:, STATE] == MOVES).any()
        for part, other in zip(batch.system.surroundings.at(batch.scenes, i).tracker, episode.scene.tracker, strict=True):
            np.testing.assert_array_equal(part, other)
