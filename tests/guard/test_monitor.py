"""The collision monitor: where the robot is in a scan, which scan counts, and the monitor in the guard."""

import math
from functools import partial

import numpy as np
import pytest
from burger import Parameters
from guard_scans import AHEAD, BACK, BODY, LIMITS, TIMING, T, hall, scan, standing, wall, with_gap

from cmd_vel_guard import collision
from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import Footprint, Limits, gaps, read, view_of
from cmd_vel_guard.monitor import ScanTiming
from cmd_vel_guard.values import STOP, Command, Mount
from turtlebot_gym import beams
from turtlebot_gym.motion import into


def test_a_turn_since_the_scan_turns_what_was_seen():
    timing = TIMING._replace(period=0.0, reaction=0.0)
    monitor = standing(limits=LIMITS._replace(error=0.0), timing=timing)
    monitor.hear(wall(0.25), sent=T)
    assert monitor.limit(Command(0.2, 0.0), T).v == pytest.approx(0.1, rel=1e-3)
    monitor.track.add(Command(0.0, 10.0), T)
    monitor.track.add(STOP, T + math.pi / 20.0)
    now = T + 0.2
    assert monitor.limit(Command(0.2, 0.0), now) == Command(0.2, 0.0)
    assert monitor.limit(Command(-0.2, 0.0), now) == Command(-0.2, 0.0)
    monitor.track.add(Command(0.0, 10.0), now)
    monitor.track.add(STOP, now + math.pi / 20.0)
    assert monitor.limit(Command(-0.2, 0.0), T + 0.39).v == pytest.approx(-0.1, rel=1e-3)


def test_a_scan_is_laid_out_at_each_tenth_of_a_second_in_doubt():
    monitor = standing()
    monitor.track.add(Command(0.0, 1.0), T - 1.0)
    monitor.hear(scan([0.3] + [np.inf] * 7), sent=T)
    x, y, radius = into(monitor.track.at(T).pose, monitor._points)
    np.testing.assert_allclose(np.sort(np.arctan2(y, x)), [-0.4, -0.3, -0.2, -0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.hypot(x, y), 0.3, rtol=1e-6)
    np.testing.assert_allclose(radius, 0.1 + 0.05 + 0.03, rtol=1e-6)


def test_only_a_fresh_scan_lets_anything_pass_turning_too_and_no_older_one_takes_its_place():
    monitor, command = standing(BODY._replace(center_x=-0.03), timing=TIMING._replace(age=0.5)), Command(0.0, 1.0)
    assert (monitor.state, monitor.remark) == ("", "")
    assert monitor.limit(command, T) == STOP
    assert monitor.state == "no scan has arrived"
    monitor.hear(hall(), sent=T)
    assert monitor.limit(command, T + 0.5) == command
    assert monitor.limit(command, T + 0.501) == STOP
    assert monitor.state == "the last scan is older than 0.5 s"
    near = wall(1.0)._replace(ranges=[-math.inf] * 360)  # something too near, all round
    for blocked, commands in ((near, (AHEAD, BACK, command)), (wall(0.13), (AHEAD,))):
        monitor = standing(body=BODY._replace(center_x=-0.03))
        monitor.hear(blocked, sent=T)
        monitor.hear(hall(), sent=T - 0.1)
        assert {monitor.limit(command, T) for command in commands} == {STOP}
        assert monitor.state == "stopped: an obstacle is in the stop zone"
    monitor.hear(wall(0.27), sent=T)
    assert 0.0 < monitor.limit(AHEAD, T).v < 0.2
    assert monitor.state == "slowed down: an obstacle is ahead"


@pytest.mark.parametrize("center_x", [-0.024, -0.064, 0.05])
def test_a_robot_in_its_stop_zone_may_turn_where_its_footprint_sweeps_nothing_and_drive_nowhere(center_x):
    """Its partner: it may not turn where the sweep reaches something."""
    body, turn = BODY._replace(center_x=center_x), Command(0.0, 2.0)
    for angle in range(0, 360, 10):
        for away, passes in ((body.radius + abs(center_x) + 0.02, True), (body.radius - abs(center_x) + 0.01, False)):
            ranges = np.where(np.arange(360) == angle, away, 5.0)
            monitors = [standing(body=body) for _ in range(2)]
            for monitor in monitors:
                monitor.hear(scan(ranges, range_min=0.02), sent=T)
            if passes:
                assert monitors[0].limit(turn, T) == turn
            else:
                back = Command(0.0, -2.0)
                assert monitors[0].limit(turn, T) != turn or monitors[1].limit(back, T) != back


def test_the_parameters_are_those_of_the_monitor():
    body = {"max_linear": 0.26, "max_angular": 1.82, "radius": 0.22, "footprint_x": -0.064}
    mount = {"scan_x": 0.1, "scan_y": 0.2, "scan_yaw": 0.3, "scan_frame": "front", "scan_mount": "given"}
    kept = {"collision_margin": 0.01, "scan_error": 0.02, "collision_time": 3.0, "escape_speed": 0.03}
    times = {"scan_age": 0.1, "scan_period": 0.3, "reaction": 0.15}
    monitor = Arbiter(Parameters(collision_monitor=True, **body, **mount, **kept, **times), T).monitor
    assert monitor._body == Footprint(0.22, -0.064, Mount("front", 0.1, 0.2, 0.3))
    assert monitor._limits == Limits(margin=0.01, error=0.02, time=3.0, escape_speed=0.03)
    assert monitor._timing == ScanTiming(age=0.1, period=0.3, reaction=0.15, returns=0.02)
    assert monitor._reach == pytest.approx((0.26 + 1.82 * 0.064) * 3.55)
    assert monitor._narrow == beams.narrow_gap(0.22, 0.01 + 0.26 * 3.0)
    monitor._walk(T + 1.0)
    assert monitor._room == pytest.approx(0.03 * 3.0)


def test_undated_scans_after_a_gap_of_the_guard_do_not_count():
    arbiter = Arbiter(Parameters(collision_monitor=True), T)
    now = T + 1.5
    arbiter.step(T)
    arbiter.hear_scan(hall(), now, dated=False)
    assert arbiter.refused["undated after a gap"] == 1
    arbiter.hear("program", Command(0.2, 0.0), now + 0.01)
    for k in range(5):
        assert arbiter.step(now + 0.01 + 0.02 * k) in (None, STOP)
    assert arbiter.monitor.state == "no scan has arrived"
    arbiter.hear_scan(hall(), now + 0.11, sent=now + 0.1, dated=True)
    assert arbiter.step(now + 0.12).v > 0.0


def test_the_monitor_knows_what_the_wheels_are_told_and_has_nothing_to_say_of_a_robot_that_is_disabled():
    arbiter = Arbiter(Parameters(collision_monitor=True), T)
    arbiter.hear("program", AHEAD, T)
    assert arbiter.step(T) in (None, STOP)
    assert arbiter.monitor.state == "no scan has arrived"
    arbiter.enable(False, T + 0.02)
    arbiter.step(T + 0.02)
    assert arbiter.monitor.state == ""
    arbiter.enable(True, T + 0.04)
    arbiter.hear_scan(hall(), T + 0.04)
    for now in (T + 0.04, T + 0.06):
        arbiter.hear("program", AHEAD, now)
        told = arbiter.step(now)
        assert told.v > 0.0
        assert arbiter.monitor.track.command == told


# Which stop zones are kept.


@pytest.mark.parametrize("body", [BODY, Footprint(0.1, -0.05, Mount("base_scan", 0.02, -0.04, 0.5))])
def test_a_reach_leaves_out_what_is_beyond_it_and_nothing_else(body):
    for width in (20.0, 60.0):
        gap = read(with_gap(width, 0.0, around=0.4), body, LIMITS)
        every, near = (view_of(gap, body, LIMITS, reach=reach, narrow=0.6, room=0.0) for reach in (9.0, 0.5))
        for there, kept in zip(every, near, strict=True):
            np.testing.assert_array_equal(kept, there[:, gaps(there, body.center_x) <= 0.5])


def test_the_zones_along_the_edges_of_a_gap_hold_those_of_all_places_between_them():
    border = partial(np.full_like, fill_value=0.5)
    x, y, radius = collision._solid(-0.3, 0.3, border, spacing=0.02, far=1.0, body=BODY, limits=LIMITS)[..., None]
    for edge in (-0.3, 0.3):
        place = collision._points(np.full(500, edge), np.linspace(0.5, 1.0, 500), BODY, LIMITS)
        assert (np.hypot(x - place[0], y - place[1]) + place[2] <= radius).any(axis=0).all()
