"""The collision monitor's mathematics against an oracle of its own, and its laws over drawn scans and commands."""

import math

import numpy as np
import pytest
from guard_scans import (
    AHEAD,
    BACK,
    BODY,
    LIMITS,
    MOUNT,
    T,
    hall,
    measured_anew,
    narrow_gap,
    points,
    scan,
    seen_by,
    standing,
    with_gap,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from cmd_vel_guard import collision
from cmd_vel_guard.collision import SLOWEST, Footprint, gaps, limited, read, times_to_contact, view_of
from cmd_vel_guard.values import STOP, Command, Mount
from turtlebot_gym.beams import beams_of, gaps_of
from turtlebot_gym.motion import into, moved

# When a circle on an arc touches a point.


def touches(point, command, center_x):
    """The same by search: where the circle's centre is, by the rotation about the arc's centre, and bisection."""
    (x, y, radius), (v, omega) = point, command
    end = 2.0 * math.pi / abs(omega) if omega else 1000.0
    times = np.linspace(0.0, end, 50_001)

    def gap(t):
        theta = omega * t
        forward, aside = (v * np.sin(theta) / omega, v * (1.0 - np.cos(theta)) / omega) if omega else (v * t, 0.0 * t)
        return np.hypot(forward + center_x * np.cos(theta) - x, aside + center_x * np.sin(theta) - y) - radius

    (first,) = np.nonzero(gap(times) <= 0.0)
    if not first.size:
        return math.inf
    low, high = times[first[0] - 1], times[first[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if gap(middle) <= 0.0 else (middle, high)
    return high


def test_the_time_to_contact_is_that_of_a_search_along_the_arc():
    rng, met = np.random.default_rng(0), 0
    for case in range(300):
        command = Command(rng.uniform(-0.3, 0.3) * rng.integers(0, 2), rng.uniform(-3.0, 3.0) * 10.0 ** -rng.integers(0, 4))
        center_x, radius = rng.uniform(-0.2, 0.1), rng.uniform(0.05, 0.25)
        away, direction = radius + rng.uniform(0.001, 0.4), rng.uniform(-math.pi, math.pi)
        point = (center_x + away * math.cos(direction), away * math.sin(direction), radius)
        if case % 3 == 0:  # exactly abeam, where the distance has an extremum
            center_x, point = 0.0, (0.0, math.copysign(away, direction), radius)
        (found,), expected = times_to_contact(points(point), command, center_x), touches(point, command, center_x)
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6), (point, command, center_x)
        met += math.isfinite(expected)
    assert 40 < met < 260


@pytest.mark.parametrize("omega", [0.0, 1e-300, 1e-12, 1.9e-9, 2.1e-9, 1e-7, 1e-5])
def test_an_arc_may_be_as_straight_as_it_likes_and_what_moves_across_or_not_at_all_meets_nothing(omega):
    near = points((1.0, 0.0, 0.2), (1.0, 0.1, 0.2), (1.0, 0.3, 0.2), (-1.0, 0.0, 0.2), (0.0, 1.0, 0.2))
    for sign in (1.0, -1.0):
        ahead = times_to_contact(near, Command(0.2, sign * omega), -0.05)
        assert ahead[:2] == pytest.approx([4.25, (1.05 - math.sqrt(0.03)) / 0.2], rel=1e-4)
        assert (ahead[2:] > 1e4).all()
        back = times_to_contact(near, Command(-0.2, sign * omega), 0.0)
        assert back[3] == pytest.approx(4.0, rel=1e-4)
        assert times_to_contact(points((0.0, 0.3, 0.15)), Command(sign * 0.2, 0.0), 0.0) == [math.inf]
    outside = points((0.3, 0.0, 0.15), (0.0, 0.3, 0.15), (-0.2, -0.2, 0.15))
    assert (times_to_contact(outside, STOP, 0.0) == math.inf).all()
    assert (times_to_contact(outside, Command(0.0, 1.0), 0.0) == math.inf).all()


# What a scan says.


BAD = [
    (scan([np.nan, -1.0, 0.1] * 4), "none of the scan's 12 beams says anything"),
    (scan([1.0] * 12, angle_increment=math.nan), "angle_increment must be"),
    (scan([1.0] * 12, angle_min=math.inf), "angle_min must be finite"),
    (scan([1.0] * 12, range_min=4.0), r"range_min must be in \[0, range_max\)"),
    (scan([1.0] * 12, frame="rplidar_link"), "its frame is 'rplidar_link', not 'base_scan'"),
]


@pytest.mark.parametrize(("bad", "why"), BAD)
def test_a_scan_that_cannot_be_read_is_refused_in_one_line_and_stops_until_a_good_one_comes(bad, why):
    with pytest.raises(ValueError, match=why) as error:
        seen_by(bad)
    assert "\n" not in str(error.value)
    monitor = standing()
    monitor.hear(hall(), sent=T)
    assert monitor.limit(Command(0.1, 0.2), T) == Command(0.1, 0.2)
    monitor.hear(bad, sent=T + 0.01)
    assert monitor.limit(Command(0.1, 0.2), T + 0.02) == STOP
    assert monitor.state == f"a scan was refused: {error.value}"
    monitor.hear(hall(), sent=T + 0.03)
    assert monitor.limit(Command(0.1, 0.2), T + 0.04) == Command(0.1, 0.2)
    assert monitor.state == ""


def test_a_lidar_that_is_blind_beyond_the_stop_zone_is_refused():
    """0.1 m and a margin of 0.05 m: less the error, 0.149 m are in the stop zone, 0.151 m are not."""
    for body in (
        BODY,
        BODY._replace(scan=MOUNT._replace(x=-0.03)),
        BODY._replace(scan=MOUNT._replace(y=0.03)),
        BODY._replace(center_x=0.03),
    ):
        away = math.hypot(body.scan.x - body.center_x, body.scan.y)
        seen_by(scan([1.0] * 12, range_min=(0.149 - away) / 0.9), body)
        with pytest.raises(ValueError, match=r"sees nothing below range_min, 0.* so the margin must be at least 0.051 m"):
            seen_by(scan([1.0] * 12, range_min=(0.151 - away) / 0.9), body)


# Where a scan says nothing.


@pytest.mark.parametrize(
    ("there", "ahead", "back"),
    [
        (scan([2.0, np.nan] * 180), 0.2, -0.2),
        (with_gap(20.0, 0.0), 0.2, -0.2),  # as wide as the robot further away
        (with_gap(20.0, 0.0, around=0.165), 0.0, 0.0),
        (with_gap(60.0, 0.0), 0.04, -0.2),
        (with_gap(60.0, 180.0), 0.2, -0.04),
        (scan([2.0] * 361, angle_increment=math.radians(1.0)), 0.2, -0.2),  # closes the circle
    ],
)
def test_a_wide_gap_slows_down_what_drives_into_it_and_nothing_else(there, ahead, back):
    for command, passes in ((AHEAD, ahead), (BACK, back)):
        monitor = standing()
        monitor.hear(there, sent=T)
        assert monitor.limit(command, T).v == pytest.approx(passes, rel=0.05)


def test_unknown_space_is_entered_slowly_and_then_no_more_until_the_robot_has_moved_where_it_sees():
    monitor, way, now = standing(), 0.0, T
    for k in range(200):
        monitor.hear(measured_anew(with_gap(60.0, 0.0), k), sent=now)
        allowed = monitor.limit(AHEAD, now)
        assert allowed.v <= LIMITS.escape_speed * 1.02
        monitor.track.add(allowed, now)
        way, now = way + 0.02 * allowed.v, now + 0.02
    assert 0.5 < way / (LIMITS.escape_speed * LIMITS.time) < 1.0
    assert monitor.state == "stopped: the scan says nothing about what is ahead"
    for command in (BACK, AHEAD):
        assert monitor.limit(command, now).v * command.v >= 0.0
        monitor.track.add(monitor.limit(command, now), now)
        now += 0.2
        monitor.hear(with_gap(60.0, 0.0), sent=now)
        monitor.limit(STOP, now)
    assert monitor.limit(AHEAD, now).v > 0.0


# How much of a command passes.

COMMANDS = st.builds(Command, st.floats(-0.3, 0.3), st.floats(-3.0, 3.0))
PLACES = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.05, 0.3))
CENTERS = st.sampled_from([0.0, -0.05, 0.1])
ESCAPES = st.sampled_from([0.0, 0.04])
ROUNDING = 1e-15
"""Rounding of gaps below a few metres, m; it counts where a robot hardly moves."""
GRAZED = 1e-7
"""Relative error of the time to a contact that only grazes: about the root of the rounding, as two solutions meet there."""


@settings(max_examples=400)
@given(st.lists(PLACES, max_size=8), PLACES, COMMANDS, CENTERS, ESCAPES)
def test_the_arc_is_kept_and_nothing_is_faster_with_or_without_another_point(places, another, command, center_x, escape):
    limits = LIMITS._replace(escape_speed=escape)
    slowed = limited(points(*places), command, center_x, limits)
    two = limited(points(*places, another), command, center_x, limits)
    assert abs(two.v) <= abs(slowed.v) <= abs(command.v)
    assert abs(two.omega) <= abs(slowed.omega) <= abs(command.omega)
    assert slowed.v * command.omega == pytest.approx(slowed.omega * command.v, rel=1e-9, abs=1e-300)
    assert slowed.v * command.v >= 0.0
    assert slowed.omega * command.omega >= 0.0
    assert limited(points(*places), STOP, center_x, limits) == STOP
    # A circle about the axle is moved nowhere by turning on the spot.
    assert limited(points(*places), Command(0.0, command.omega), 0.0, limits) == Command(0.0, command.omega)


@settings(max_examples=400)
@given(st.lists(PLACES, min_size=1, max_size=8), COMMANDS, CENTERS, ESCAPES)
def test_what_passes_is_the_time_limit_away_from_every_stop_zone_and_leads_out_of_those_around(
    places, command, center_x, escape
):
    limits = LIMITS._replace(escape_speed=escape)
    allowed = limited(points(*places), command, center_x, limits)
    speed = math.hypot(allowed.v, allowed.omega * center_x)
    if speed == 0.0:
        return
    assert times_to_contact(points(*places), allowed, center_x).min() >= limits.time * (1.0 - GRAZED)
    if (gaps(points(*places), center_x) <= 0.0).any():
        assert speed <= escape * (1.0 + 1e-9)
        before = points(*places)
        later = into(moved((0.0, 0.0, 0.0), allowed, 1e-4), before)
        there = gaps(before, center_x) <= 0.0
        assert (gaps(later, center_x)[there] >= gaps(before, center_x)[there] - 1e-6 * speed - ROUNDING).all()


def border_of(gap, bodies, limits, room):
    """The range from which a gap counts as solid, at each missing beam."""
    beams = beams_of(gap.ranges, first=0.0, increment=gap.angle_increment, range_min=0.0, range_max=9.0)
    border = np.full(len(gap.ranges), np.nan)
    for first, last, width, shorter in gaps_of(beams):
        inside = (beams.directions - first + 1e-9) % (2.0 * math.pi) <= last - first + 2e-9
        narrow = width <= narrow_gap(bodies, limits, 0.3)
        border[inside] = shorter if narrow else collision._edge(beams.directions[inside], bodies, limits, room)
    return border


def through(scan, command, body, limits, room):
    """The command that passes by a scan."""
    view = view_of(read(scan, body, limits), body, limits, reach=9.0, narrow=narrow_gap(body, limits, 0.3), room=room)
    return limited(view.unknown, limited(view.seen, command, body.center_x, limits), body.center_x, limits)


def is_slower_than_with_the_missing_beams(draw, command, room, body, limits):
    """Whether no more passes than if the missing beams had returned anything from the borders of their gaps on."""
    beams = int(draw.integers(24, 200))
    ranges = draw.uniform(0.2, 1.5, beams).astype(np.float32)
    start, width = draw.integers(0, beams), draw.integers(0, beams // 2)
    missing = (draw.random(beams) < draw.choice([0.05, 0.3, 0.7])) | ((np.arange(beams) - start) % beams < width)
    missing[start - 1] = False
    gap = scan(np.where(missing, np.nan, ranges), range_min=0.0, range_max=9.0)
    border = border_of(gap, body, limits, room)
    behind = border + draw.choice([0.0, 0.05, 1.0]) * draw.random(beams) * (draw.random(beams) < 0.8)
    full = scan(np.where(missing, np.minimum(behind, 8.9) * (1.0 + 1e-6), ranges), range_min=0.0, range_max=9.0)
    least, most = through(gap, command, body, limits, room), through(full, command, body, limits, room)
    return abs(least.v) <= abs(most.v) * (1.0 + GRAZED) and abs(least.omega) <= abs(most.omega) * (1.0 + GRAZED)


STILL = LIMITS._replace(escape_speed=0.0)
"""Inside of a stop zone the robot stands."""


@settings(max_examples=400)
@given(st.integers(0, 2**32), COMMANDS, st.floats(0.0, 0.1), st.sampled_from([0.0, -0.05, 0.1]), st.sampled_from([0.0, -0.04]))
def test_missing_beams_never_let_more_pass_than_any_ranges_behind_the_gaps_border(seed, command, room, center_x, y):
    body = Footprint(0.1, center_x, MOUNT._replace(x=0.02, y=y, yaw=0.5))
    assert is_slower_than_with_the_missing_beams(np.random.default_rng(seed), command, room, body, STILL)


def test_the_speed_falls_with_the_distance_and_ends_at_the_slowest():
    def at(gap, command=(0.2, 0.0), **changes):
        return limited(points((0.15 + gap, 0.0, 0.15)), Command(*command), 0.0, LIMITS._replace(**changes))

    assert at(0.2001) == Command(0.2, 0.0)
    assert at(0.1) == pytest.approx((0.1, 0.0))
    assert at(0.1, time=2.0) == pytest.approx((0.05, 0.0))
    assert at(SLOWEST + 1e-6).v == pytest.approx(0.01, abs=1e-5)
    assert at(SLOWEST - 1e-6) == STOP
    assert at(0.001, Command(0.0005, 0.0)) == Command(0.0005, 0.0)  # what is slow enough need not slow down
    beside = points((0.0, 0.1504, 0.15))
    assert limited(beside, Command(0.0005, 0.0), 0.0, LIMITS) == Command(0.0005, 0.0)  # nor is it for what it passes
    assert at(-0.01) == STOP
    assert at(-0.01, Command(-0.2, 0.0)) == pytest.approx((-0.04, 0.0))
    assert at(-0.01, Command(-0.2, 1.0)) == pytest.approx((-0.04, 0.2))
    assert at(-0.01, Command(-0.03, 0.0)) == Command(-0.03, 0.0)
    assert at(-0.01, Command(-0.2, 0.0), escape_speed=0.0) == STOP
    assert at(0.01, Command(-0.2, 0.0)) == Command(-0.2, 0.0)


# What a scan says, as stop zones.


def test_the_border_of_a_wide_gap_is_a_circle_about_the_footprint_whose_stop_zone_is_its_room_away():
    mount, angles = Mount("base_scan", 0.04, -0.02, 0.7), np.linspace(-math.pi, math.pi, 50)
    body = Footprint(0.1, -0.03, mount)
    ranges = collision._edge(angles, body, LIMITS, 0.04)
    x, y = mount.x + ranges * np.cos(angles + 0.7) - body.center_x, mount.y + ranges * np.sin(angles + 0.7)
    away = np.hypot(x, y)
    assert away == pytest.approx(away[0])
    assert 0.04 <= (away - body.radius - LIMITS.margin - LIMITS.error * ranges).min() < 0.06


def test_points_are_where_the_mount_puts_them_and_grow_with_their_range():
    body = Footprint(0.1, -0.05, Mount("base_scan", 0.2, -0.1, math.pi / 2.0))
    expected = [(0.2, 0.9, 0.25), (-1.8, -0.1, 0.35), (0.2, -0.6, 0.2)]
    seen = seen_by(scan([1.0, 2.0, 0.5, np.inf], range_min=0.0), body)
    np.testing.assert_allclose(seen, points(*expected), atol=1e-7)
    turned = scan([1.0, 2.0, 0.5, np.inf], angle_min=0.3, angle_increment=-math.pi / 2.0)
    x, y, _ = seen_by(turned)
    np.testing.assert_allclose(np.arctan2(y, x), [0.3, 0.3 - math.pi / 2.0, 0.3 - math.pi], atol=1e-7)
