"""What no beam has seen is not free: with a LiDAR that sees a part of the circle a robot turns and looks, or stands."""

import math

import numpy as np
import pytest

from turtlebot_gym import ROBOTS
from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import STOP, Command
from turtlebot_gym_agents import Deployment
from turtlebot_gym_agents.policies.seen_space import LASTS, LOOK, PATIENCE, SeenSpace

VIEWS = {
    "all around": (0.0, 360.0),
    "blind behind": (-120.0, 240.0),
    "blind left": (150.0, 240.0),
    "blind right": (-30.0, 240.0),
    "ahead 60": (-30.0, 60.0),
    "behind 120": (120.0, 120.0),
}
"""First direction that a LiDAR sees, and the angle from there, degrees."""
ROBOT, PERIOD = ROBOTS["burger"], 0.1
AHEAD, BACK = Command(0.2, 0.0), Command(-0.2, 0.0)
FAR = np.full(SECTORS, 3.5)
ANGLES = 2.0 * np.pi * (np.arange(SECTORS) / SECTORS)


def seeing(view, ranges=FAR):
    """Return the ranges of the sectors in a view, m, and 0 elsewhere."""
    first, width = np.radians(VIEWS[view])
    return np.where((ANGLES - first) % (2.0 * np.pi) <= width, ranges, 0.0)


def asked(seen, wishes, *, space=None, now=0.0):
    """Return the commands for wishes, one after the other, of a robot that stands."""
    space = space or SeenSpace(ROBOT, PERIOD)
    return [space.limit(wish, STOP, seen, 0.0, now + PERIOD * at) for at, wish in enumerate(wishes)]


def moved(space, v, omega, duration, seen, now=0.0):
    """Let a robot move at constant speeds, and return the time at which it stands again."""
    times = now + PERIOD * np.arange(round(duration / PERIOD) + 1)
    for time in times:
        space.limit(STOP, Command(v, omega) if time < times[-1] - 1e-6 else STOP, seen, 0.0, time)
    return float(times[-1])


def test_a_lidar_that_looks_all_around_changes_nothing():
    close = np.full(SECTORS, 0.13)
    assert asked(close, [AHEAD, BACK, Command(0.1, 1.0)]) == [AHEAD, BACK, Command(0.1, 1.0)]


@pytest.mark.parametrize("view", [view for view in VIEWS if view != "all around"])
def test_a_robot_drives_only_where_a_beam_has_looked_and_may_turn_anywhere(view):
    """The first direction of travel counts from the robot's edge: at 90 degrees to it, a rim touches nothing new."""
    for wish, middle in ((AHEAD, 0.0), (BACK, math.pi)):
        sees = all(seeing(view)[np.cos(ANGLES - middle) > -0.01])
        (command,) = asked(seeing(view), [wish])
        assert command == (wish if sees else Command(0.0, 0.0))
    assert asked(seeing(view), [Command(0.0, 1.0)]) == [Command(0.0, 1.0)]


def test_it_does_not_reach_an_obstacle_either_where_the_lidar_sees_a_part():
    """Without unknown directions an obstacle is the policy's business."""
    for distance, least, most in ((0.5, 0.2, 0.2), (0.2, 0.01, 0.15), (0.15, 0.0, 0.0)):
        (command,) = asked(seeing("blind behind", np.full(SECTORS, distance)), [AHEAD])
        assert least <= command.v <= most


def test_what_was_seen_before_counts_for_a_while():
    """A robot that has turned its back on what it has seen may drive there for `LASTS` seconds."""
    for later, speed in ((0.5, -0.2), (LASTS + 0.2, 0.0)):
        space = SeenSpace(ROBOT, PERIOD)
        now = moved(space, 0.0, math.pi / 2.0, 2.0, seeing("blind behind", 1.0))
        now = moved(space, 0.0, 0.0, later, seeing("ahead 60", 0.15), now)
        (command,) = asked(seeing("ahead 60"), [BACK], space=space, now=now + PERIOD)
        assert command.v == speed


def test_a_newer_scan_counts_more_than_an_older_one():
    """Somebody has stepped to where the way was free."""
    space = SeenSpace(ROBOT, PERIOD)
    assert asked(seeing("blind behind"), [AHEAD], space=space) == [AHEAD]
    (command,) = asked(seeing("blind behind", np.full(SECTORS, 0.15)), [AHEAD], space=space, now=1.0)
    assert command.v == 0.0


def test_after_a_gap_nobody_knows_how_the_robot_has_moved():
    for gap, speed in ((0.5, 0.2), (1.5, 0.0)):
        space = SeenSpace(ROBOT, PERIOD)
        asked(seeing("blind behind"), [AHEAD], space=space)
        assert asked(seeing("behind 120"), [AHEAD], space=space, now=gap)[0].v == speed


def test_what_was_seen_is_as_far_as_the_robot_has_not_driven():
    """It drives half a metre by what it saw ahead, and then only as far as that was free."""
    for free, speed in ((1.0, 0.2), (0.6, 0.0)):
        space = SeenSpace(ROBOT, PERIOD)
        now = moved(space, 0.2, 0.0, PERIOD, seeing("all around", free))
        now = moved(space, 0.2, 0.0, 2.5 - PERIOD, seeing("behind 120"), now)
        assert asked(seeing("behind 120"), [AHEAD], space=space, now=now + PERIOD)[0].v == speed


def test_who_insists_makes_the_robot_look_around_once():
    """It turns by a whole circle, and then has seen the way."""
    space, driven = SeenSpace(ROBOT, PERIOD), [STOP]
    for at in range(round((PATIENCE + 2.0 * math.pi / LOOK + 2.0) / PERIOD)):
        driven.append(space.limit(AHEAD, driven[-1], seeing("behind 120"), 0.0, PERIOD * at))
    turns = sum(command.omega for command in driven) * PERIOD
    assert turns == pytest.approx(2.0 * math.pi)
    first = next(at for at, command in enumerate(driven) if command.v > 0.0)
    assert not any(command.omega for command in driven[first:])


WALL = 0.8
"""Distance of a wall ahead of a robot that stands in the open, m."""


@pytest.mark.parametrize("margin", [0.0, pytest.param(0.08, marks=pytest.mark.slow)])
@pytest.mark.parametrize("policy", ["vfh", "planner", "ppo-rooms"])
@pytest.mark.parametrize("view", [view for view in VIEWS if view != "all around"])
def test_no_policy_touches_a_wall_before_its_goal(view, policy, margin):
    """The goal is behind the wall. Poses are exact, ranges too; a command acts one interval late."""
    robot, directions = Deployment(policy, safety_margin=margin), np.radians(np.arange(0.0, 360.0, 2.0))
    first, width = np.radians(VIEWS[view])
    sees = (directions - first) % (2.0 * np.pi) <= width
    x, y, theta, before = 0.0, 0.0, 0.0, Command(0.0, 0.0)
    for _ in range(60):
        ahead = np.cos(theta + directions)
        with np.errstate(divide="ignore"):
            ranges = np.where(ahead > 1e-6, (WALL - x + 0.032 * math.cos(theta)) / ahead, np.inf)
        ranges = np.where(ranges > 3.5, np.inf, ranges)
        scan = Scan(np.where(sees, ranges, np.nan).astype(np.float32), 0.0, math.radians(2.0), 0.12, 3.5)
        try:
            command = robot.act((x, y, theta), np.zeros(3), before, scan, (2.0, 0.0, 0.0))
        except ValueError as why:  # it sees no wall, and may be covered
            command = STOP if "fewer than 2% of the beams return anything" in str(why) else before
        x, y = x + before.v * PERIOD * math.cos(theta), y + before.v * PERIOD * math.sin(theta)
        theta += before.omega * PERIOD
        before = command
        assert x + robot.robot.radius < WALL


def followed(x, y, theta, away, rng):
    """Return a scan in a room of 4 m by 3 m, with somebody behind the robot at a distance, m, in the world's frame."""
    directions = np.radians(np.arange(360.0))
    east, north = np.cos(theta + directions), np.sin(theta + directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = np.minimum((2.0 * np.sign(east) - x) / east, (1.5 * np.sign(north) - y) / north)
        body = -away * east - np.sqrt(0.2**2 - (away * north) ** 2)
    ranges = np.where((east < 0.0) & (body < ranges), body, ranges)
    return np.round(ranges + rng.normal(0.0, 0.008, 360), 3).astype(np.float32)


@pytest.mark.parametrize("is_frozen", [False, True])
def test_a_robot_turns_to_tell_who_walks_and_waits_behind_it_from_a_frozen_part(is_frozen):
    robot, rng = Deployment("vfh"), np.random.default_rng(3)
    behind, first = np.cos(np.radians(np.arange(360.0))) < -0.7, None
    x, y, theta, before, notices, why = -1.2, 0.0, 0.0, STOP, [], ""
    for _ in range(250):
        ranges = followed(x, y, theta, 0.55, rng)
        first = ranges if first is None else first
        if is_frozen:
            ranges = np.where(behind, first + rng.normal(0.0, 0.008, 360).astype(np.float32), ranges)
        scan = Scan(ranges, 0.0, math.radians(1.0), 0.12, 3.5)
        try:
            command = robot.act((x, y, theta), np.zeros(3), before, scan, (1.5, 0.0, 0.0))
        except ValueError as refused:
            command, why = STOP, str(refused)
        notices.append(robot.notice)
        x, y = x + before.v * PERIOD * math.cos(theta), y + before.v * PERIOD * math.sin(theta)
        theta, before = theta + before.omega * PERIOD, command
    assert "the robot turns: a part of its LiDAR seems to be covered or frozen" in notices
    assert ("the LiDAR is frozen there" in why) == is_frozen
    assert (x < -0.5) == is_frozen
