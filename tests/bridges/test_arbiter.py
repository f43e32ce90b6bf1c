"""What the guard decides, exhaustively and without ROS: each protection is a law, with a sabotage that the law notices."""

import math

import pytest

from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.robot.arbiter import Arbiter, Parameters

TICK = 0.02
AHEAD = Command(0.1, 0.2)


def new(**parameters):
    return Arbiter(Parameters(**parameters), now=0.0)


def drive(arbiter, start, duration, command=None, source="program", every=5):
    """Tick the arbiter at 50 Hz while a source commands at 10 Hz; return what was published."""
    published = []
    for k in range(round(start / TICK), round((start + duration) / TICK)):
        if command is not None and k % every == 0:
            arbiter.hear(source, command, k * TICK)
            published.append(arbiter.step(k * TICK))
        published.append(arbiter.step(k * TICK))
    return [each for each in published if each is not None]


# A law is a protection; beside it stands the sabotage that switches the protection off, which the law must notice.


def starts_with_zeros(arbiter):
    published = drive(arbiter, 0.0, 3.0)
    assert set(published) == {STOP}
    assert drive(arbiter, 3.0, 1.0) == []


def old_commands_stop(arbiter):
    assert drive(arbiter, 0.0, 1.0, AHEAD)[-1] == AHEAD
    silence = drive(arbiter, 1.0, 0.3)  # the last command came at 0.9 s
    assert set(silence) <= {AHEAD}
    after = drive(arbiter, 1.32, 3.0)
    assert after
    assert set(after) == {STOP}


def silent_after_zeros(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    assert drive(arbiter, 1.0, 1.5)[-1] == STOP
    assert drive(arbiter, 2.5, 5.0) == []  # zeros until 2.3 s


def not_finite_is_zero(arbiter):
    for bad in (math.nan, math.inf, -math.inf):
        for command in (Command(bad, 0.1), Command(0.1, bad), Command(bad, -bad)):
            drive(arbiter, 0.0, 0.2, AHEAD)
            after = drive(arbiter, 0.2, 0.3, command)
            assert after
            assert set(after) == {STOP}
    assert arbiter.refused == 27


def limits_hold(arbiter):
    robot, start = ROBOTS["burger"], 0.0
    for v in (-9.0, -0.21, 0.0, 0.2, 1e300):
        for omega in (-99.0, -2.7, 0.0, 2.7, 1e300):
            for out in drive(arbiter, start, 1.0, Command(v, omega)):
                assert abs(out.v) <= robot.max_linear * (1 + 1e-12)
                assert abs(out.omega) <= robot.max_angular * (1 + 1e-12)
                assert abs(out.v) + abs(out.omega) * robot.wheel_separation / 2 <= robot.max_wheel * (1 + 1e-12)
            start += 1.0


def wheels_accelerate_gently(arbiter):
    before = STOP
    for k, target in enumerate((Command(0.2, 0.0), Command(-0.2, 0.0), Command(0.0, 2.6), Command(0.1, -1.0))):
        for out in drive(arbiter, float(k), 1.0, target, every=1):
            wheel = abs(out.v - before.v) + abs(out.omega - before.omega) * 0.08
            assert wheel <= 2.5 * TICK * (1 + 1e-9)
            before = out
        assert before == pytest.approx(target)


def a_start_keeps_its_curvature(arbiter):
    steps = drive(arbiter, 0.0, 1.0, Command(0.4, 2.0))  # twice too fast: limits and the ramp both act
    assert len(set(steps)) > 3
    for out in steps:
        assert out.omega == pytest.approx(5.0 * out.v)


def stops_are_not_ramped(arbiter):
    assert drive(arbiter, 0.0, 1.0, Command(0.2, 0.0))[-1].v == 0.2
    assert set(drive(arbiter, 1.0, 0.5, STOP)) == {STOP}


def a_person_wins(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear("teleop", Command(-0.05, 0.0), 1.0)
    assert drive(arbiter, 1.0, 0.38, AHEAD)[-1] == Command(-0.05, 0.0)
    assert drive(arbiter, 1.42, 1.0, AHEAD)[-1] == AHEAD  # and hands back when fresh no longer


def emergency_stops_and_stays(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear_emergency(True, 1.0)
    assert set(drive(arbiter, 1.0, 0.2, AHEAD)) == {STOP}
    arbiter.hear_emergency(False, 1.2)
    assert set(drive(arbiter, 1.2, 0.2, AHEAD)) == {STOP}  # released, but not enabled again
    assert arbiter.enable(True, 1.4) == ""
    arbiter.hear_emergency(False, 1.4)
    assert drive(arbiter, 1.4, 0.4, AHEAD)[-1] == AHEAD


def a_silent_emergency_stop_is_a_stop(arbiter):
    arbiter.hear_emergency(False, 0.0)
    assert drive(arbiter, 0.0, 0.5, AHEAD)[-1] == AHEAD
    after = drive(arbiter, 0.52, 5.0, AHEAD)
    assert set(after) == {STOP}
    assert arbiter.enable(True, 5.52) == "the emergency stop is silent"
    assert set(drive(arbiter, 5.52, 1.0, AHEAD)) == {STOP}


def a_pressed_emergency_stop_refuses(arbiter):
    arbiter.hear_emergency(True, 0.0)
    assert arbiter.enable(True, 0.1) == "the emergency stop is pressed"


def disabled_it_stops(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    assert arbiter.enable(False, 1.0) == ""
    assert set(drive(arbiter, 1.0, 0.9, AHEAD)) == {STOP}
    assert drive(arbiter, 2.1, 1.0, AHEAD) == []
    arbiter.enable(True, 4.0)
    assert drive(arbiter, 4.0, 1.0, AHEAD)[-1] == AHEAD


def enabling_forgets_what_was_said_before(arbiter):
    arbiter.enable(False, 0.0)
    arbiter.hear("program", AHEAD, 0.0)
    arbiter.enable(True, 0.1)
    assert set(drive(arbiter, 0.1, 1.0)) == {STOP}


def outside_the_fence_only_a_person_drives(arbiter):
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}  # no pose yet
    arbiter.locate(1.0, 1.0, 1.0)
    assert drive(arbiter, 1.0, 0.4, AHEAD)[-1] == AHEAD
    arbiter.locate(1.5, 1.5, 1.4)
    assert set(drive(arbiter, 1.4, 0.4, AHEAD)) == {STOP}
    assert drive(arbiter, 1.8, 0.2, AHEAD, "teleop")[-1] == AHEAD
    arbiter.locate(math.nan, 0.0, 3.0)
    assert set(drive(arbiter, 3.0, 0.2, AHEAD)) == {STOP}


def a_stale_pose_is_outside(arbiter):
    arbiter.locate(0.0, 0.0, 0.0)
    assert drive(arbiter, 0.0, 0.5, AHEAD)[-1] == AHEAD
    assert set(drive(arbiter, 0.54, 1.0, AHEAD)) == {STOP}


def speed_is_scaled(arbiter):
    assert drive(arbiter, 0.0, 1.0, Command(0.5, 0.0))[-1].v == pytest.approx(0.5 * 0.2097)


def a_suspended_process_does_not_leap(arbiter):
    arbiter.step(0.0)
    arbiter.hear("program", Command(0.2, 0.0), 0.3)
    assert arbiter.step(0.3).v <= 2.5 * 0.04 + 1e-12


def a_process_that_was_suspended_for_long_sends_zeros(arbiter):
    assert drive(arbiter, 0.0, 1.0, AHEAD)[-1] == AHEAD  # which the wheels hold from then on
    arbiter.hear("program", AHEAD, 10.0)  # was waiting for how long?
    assert arbiter.step(10.0) == STOP
    assert set(drive(arbiter, 10.02, 0.5)) == {STOP}
    assert drive(arbiter, 10.52, 1.0, AHEAD)[-1] == AHEAD


def a_new_robot_is_told_to_stop(arbiter):
    drive(arbiter, 0.0, 3.0)
    arbiter.greet(3.0)
    assert set(drive(arbiter, 3.0, 0.5)) == {STOP}


def sabotage(name, replacement):
    def apply(arbiter):
        setattr(arbiter, name, replacement(arbiter))

    return apply


def parameter(name, value):
    return lambda arbiter: object.__setattr__(arbiter._p, name, value)


def deaf(arbiter):
    return lambda *_: None


def talks_without_thinking(arbiter):
    return lambda source, command, now: arbiter._heard.__setitem__(source, (now, command))


def unlimited(arbiter):
    return Robot(max_linear=1e301, max_angular=1e301)


def nothing_instead_of_stop(arbiter):
    step = arbiter.step
    return lambda now: None if (out := step(now)) == STOP else out


def stop_for_ever(arbiter):
    step = arbiter.step
    return lambda now: step(now) or STOP


def ramps_stops(arbiter):
    return lambda target, dt: Arbiter._ramp(arbiter, Command(target.v + 1e-12, target.omega), dt)


def forget_no_command(arbiter):
    def enable(on, now):
        arbiter.enabled = on
        return ""

    return enable


LAWS = [
    (starts_with_zeros, {}, sabotage("step", nothing_instead_of_stop)),
    (old_commands_stop, {}, parameter("max_age", 1e6)),
    (silent_after_zeros, {}, sabotage("step", stop_for_ever)),
    (not_finite_is_zero, {}, sabotage("hear", talks_without_thinking)),
    (limits_hold, {}, sabotage("_robot", unlimited)),
    (wheels_accelerate_gently, {}, parameter("max_acceleration", math.inf)),
    (a_start_keeps_its_curvature, {}, parameter("max_acceleration", math.inf)),
    (stops_are_not_ramped, {}, sabotage("_ramp", ramps_stops)),
    (a_person_wins, {}, sabotage("hear", lambda arbiter: lambda s, c, t: Arbiter.hear(arbiter, "program", c, t))),
    (emergency_stops_and_stays, {}, sabotage("hear_emergency", deaf)),
    (a_silent_emergency_stop_is_a_stop, {}, sabotage("hear_emergency", deaf)),
    (a_pressed_emergency_stop_refuses, {}, sabotage("enable", forget_no_command)),
    (disabled_it_stops, {}, sabotage("enable", lambda arbiter: lambda on, now: "")),
    (enabling_forgets_what_was_said_before, {}, sabotage("enable", forget_no_command)),
    (outside_the_fence_only_a_person_drives, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (a_stale_pose_is_outside, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (speed_is_scaled, {"speed_scale": 0.5}, parameter("speed_scale", 1.0)),
    (a_suspended_process_does_not_leap, {}, parameter("rate", 1.0)),
    (a_process_that_was_suspended_for_long_sends_zeros, {}, parameter("max_age", 1e6)),
    (a_new_robot_is_told_to_stop, {}, sabotage("greet", deaf)),
]


@pytest.mark.parametrize(("law", "parameters", "sabotage"), LAWS, ids=[law.__name__ for law, *_ in LAWS])
def test_law(law, parameters, sabotage):
    law(new(**parameters))
    broken = new(**parameters)
    sabotage(broken)
    with pytest.raises(AssertionError):
        law(broken)


def test_start_disabled():
    arbiter = new(start_enabled=False)
    assert set(drive(arbiter, 0.0, 2.0, AHEAD)) == {STOP}
    arbiter.enable(True, 2.0)
    assert drive(arbiter, 2.0, 1.0, AHEAD)[-1] == AHEAD
