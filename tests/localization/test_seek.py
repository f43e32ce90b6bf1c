"""A robot that does not know where it is looks for its scan in the whole map."""

from __future__ import annotations

import math

import numpy as np
import pytest
from localization_rooms import corridor, hall, make_room, scan_of

from turtlebot_gym.localization.localizer import LOST, TRACKING, locate, state_of
from turtlebot_gym.localization.seek import HYPOTHESES, look, nowhere, seek
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.values import Pose

Q = LocalizerTuning()
POSES = [(1.7, 2.1, 0.4), (4.6, 0.8, -2.9), (1.0, 3.9, 1.6), (4.0, 3.0, 3.1)]


def looks(located, room, points, times=3):
    for _ in range(times):
        located = look(located, room.field, room.frame, points, points.shape[1], Q)
    return located


def off(located, pose):
    mean = located.belief.mean
    return math.hypot(mean.x - pose[0], mean.y - pose[1]), abs(math.remainder(mean.theta - pose[2], 2.0 * math.pi))


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_an_unknown_start_is_found(pose, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    room, points = make_room(hall(), yaw, (2.0, 1.0)), scan_of(make_room(hall()), pose)
    located = nowhere(Pose(0.0, 0.0, 0.0), Q)
    assert state_of(located, Q) == LOST
    located = looks(located, room, points)
    turned = (2.0 + c * pose[0] - s * pose[1], 1.0 + s * pose[0] + c * pose[1], pose[2] + yaw)
    assert max(off(located, turned)) < 0.02
    assert state_of(located, Q) == TRACKING


def test_a_kidnapped_robot_is_found_after_its_patience():
    room = make_room(hall())
    points, located = scan_of(room, POSES[1]), locate(Pose(*POSES[0]), (1e-4, 1e-4, 1e-4), Q)
    located = looks(located, room, points, int(Q.patience) + 4)
    assert max(off(located, POSES[1])) < 0.03


def test_where_several_places_look_alike_it_stays_lost():
    """The partner of the first test: in a corridor without ends each place explains the scan."""
    room = make_room(corridor())
    points = scan_of(room, (10.0, 1.6, 0.3))
    poses, values = np.empty((HYPOTHESES, 3)), np.zeros(HYPOTHESES)
    assert seek(room.field, room.frame, points, points.shape[1], poses, values) == HYPOTHESES
    assert (np.diff(values) <= 0.0).all()
    located = looks(nowhere(Pose(0.0, 0.0, 0.0), Q), room, points, 9)
    assert state_of(located, Q) == LOST
