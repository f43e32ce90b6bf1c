"""What the guard decides, exhaustively and without ROS: each protection is a law, with a sabotage that the law notices."""

import math
from itertools import pairwise

import pytest

from turtlebot_gym.robots import Robot
from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.robot.arbiter import Arbiter, Parameters, _Heard

TICK = 0.02
T = 100.0
"""When all begins: not at 0."""
AHEAD = Command(0.1, 0.2)


def new(**parameters):
    return Arbiter(Parameters(**parameters), now=T)


def drive(arbiter, start, duration, command=None, source="program", every=5):
    """Tick the arbiter at 50 Hz while a source commands at 10 Hz; return what was published."""
    published = []
    for k in range(round(start / TICK), round((start + duration) / TICK)):
        if command is not None and k % every == 0:
            arbiter.hear(source, command, T + k * TICK)
            published.append(arbiter.step(T + k * TICK))
        published.append(arbiter.step(T + k * TICK))
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
    start = 0.0
    for bad in (math.nan, math.inf, -math.inf):
        for command in (Command(bad, 0.1), Command(0.1, bad), Command(bad, -bad)):
            drive(arbiter, start, 0.2, AHEAD)
            after = drive(arbiter, start + 0.2, 0.3, command)
            assert after
            assert set(after) == {STOP}
            start += 0.5
    assert arbiter.refused == {"not finite": 27, "too old": 0, "undated after a gap": 0}


def limits_hold(arbiter):
    """The burger's: 0.2108 m/s, 2.635 rad/s, 0.2097 m/s at a wheel 0.08 m from the middle."""
    start = 0.0
    for v in (-9.0, -0.21, 0.0, 0.2, 1e300):
        for omega in (-99.0, -2.7, 0.0, 2.7, 1e300):
            for out in drive(arbiter, start, 1.0, Command(v, omega)):
                assert abs(out.v) <= 0.2108001
                assert abs(out.omega) <= 2.6350001
                assert abs(out.v) + abs(out.omega) * 0.08 <= 0.2097001
            start += 1.0
    assert arbiter.refused["not finite"] == 0  # too fast is limited


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
    arbiter.hear("teleop", Command(-0.05, 0.0), T + 1.0)
    assert drive(arbiter, 1.0, 0.38, AHEAD)[-1] == Command(-0.05, 0.0)
    assert drive(arbiter, 1.42, 1.0, AHEAD)[-1] == AHEAD  # and hands back when fresh no longer


def buttons(arbiter, start, duration, pressed=False, number=1):
    """Let a button speak at 10 Hz while a program commands; return what was published."""
    published = []
    for k in range(round(duration / 0.1)):
        arbiter.hear_emergency(pressed, T + start + 0.1 * k, number=number + k)
        published += drive(arbiter, start + 0.1 * k, 0.1, AHEAD)
    return published


def emergency_stops_and_stays(arbiter):
    assert buttons(arbiter, 0.0, 1.0)[-1] == AHEAD
    assert set(buttons(arbiter, 1.0, 0.2, pressed=True, number=11)) == {STOP}  # last pressed at 1.1 s
    assert set(buttons(arbiter, 1.2, 0.4, number=13)) == {STOP}  # released, but not enabled again
    assert arbiter.enable(True, T + 1.59) == "the emergency stop is pressed"
    assert arbiter.enable(True, T + 1.61) == ""
    assert buttons(arbiter, 1.62, 0.4, number=17)[-1] == AHEAD


def a_press_that_is_released_at_once_counts(arbiter):
    assert buttons(arbiter, 0.0, 1.0)[-1] == AHEAD
    arbiter.hear_emergency(True, T + 1.0, number=11)
    arbiter.hear_emergency(False, T + 1.0, number=12)
    assert set(buttons(arbiter, 1.0, 3.0, number=13)) == {STOP}


def a_silent_emergency_stop_is_a_stop(arbiter):
    arbiter.hear_emergency(False, T)
    assert drive(arbiter, 0.0, 0.5, AHEAD)[-1] == AHEAD
    after = drive(arbiter, 0.52, 5.0, AHEAD)
    assert set(after) == {STOP}
    assert arbiter.enable(True, T + 5.52) == "the emergency stop is silent"
    assert set(drive(arbiter, 5.52, 1.0, AHEAD)) == {STOP}


def a_pressed_emergency_stop_refuses(arbiter):
    arbiter.hear_emergency(True, T)
    assert arbiter.enable(True, T + 0.1) == "the emergency stop is pressed"


def disabling_is_never_refused(arbiter):
    buttons(arbiter, 0.0, 1.0, pressed=True)
    assert arbiter.enable(False, T + 1.0) == ""
    assert not arbiter.enabled
    assert arbiter.emergency  # and forgets no emergency stop
    buttons(arbiter, 1.0, 1.0, number=11)
    assert arbiter.enable(True, T + 2.0) == ""
    assert buttons(arbiter, 2.0, 0.5, number=21)[-1] == AHEAD


def a_start_after_a_stop_is_as_gentle_as_the_first(arbiter):
    assert drive(arbiter, 0.0, 1.0, Command(0.2, 0.0))[-1].v == 0.2
    assert drive(arbiter, 1.0, 1.0)[-1] == STOP
    again = drive(arbiter, 2.0, 0.2, Command(0.2, 0.0))
    assert again[0].v == pytest.approx(0.05)  # 2.5 m/s^2 for the 20 ms since the last zero
    assert [round(out.v, 6) for out in again[:4]] == [0.05, 0.1, 0.15, 0.2]


def what_was_sent_before_it_was_enabled_does_not_count(arbiter):
    arbiter.enable(False, T)
    arbiter.enable(True, T + 0.1)
    arbiter.hear("program", AHEAD, T + 0.15, sent=T + 0.09)
    assert set(drive(arbiter, 0.16, 0.3)) == {STOP}
    arbiter.hear("program", AHEAD, T + 0.46, sent=T + 0.45)
    assert drive(arbiter, 0.46, 0.3)[-2:] != [STOP, STOP]


def age_is_that_of_what_was_sent(arbiter):
    arbiter.hear("program", AHEAD, T + 0.01, sent=T - 60.0)
    assert set(drive(arbiter, 0.02, 0.2)) == {STOP}
    assert arbiter.refused["too old"] == 1
    drive(arbiter, 0.22, 0.4, AHEAD)
    arbiter.hear("program", Command(0.2, 0.0), T + 0.62, sent=T + 0.3)  # older than what is in force
    assert set(drive(arbiter, 0.62, 0.2)) <= {AHEAD}


def output_is_bounded(arbiter):
    """400 messages a second for a second, each another one: 50 of them go out, and one at either end."""
    published = 0
    for k in range(400):
        arbiter.hear("program", Command(0.1 + 1e-5 * k, 0.0), T + k * 0.0025)
        published += arbiter.step(T + k * 0.0025) is not None
    assert 45 <= published <= 52


def stops_are_not_delayed_by_the_rate(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear("program", Command(0.12, 0.2), T + 1.0)
    assert arbiter.step(T + 1.0) is not None
    arbiter.hear("program", STOP, T + 1.0001)
    assert arbiter.step(T + 1.0001) == STOP


def disabled_it_stops(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    assert arbiter.enable(False, T + 1.0) == ""
    assert set(drive(arbiter, 1.0, 0.9, AHEAD)) == {STOP}
    assert drive(arbiter, 2.1, 1.0, AHEAD) == []
    arbiter.enable(True, T + 4.0)
    assert drive(arbiter, 4.0, 1.0, AHEAD)[-1] == AHEAD


def enabling_forgets_what_was_said_before(arbiter):
    arbiter.enable(False, T + 0.0)
    arbiter.hear("program", AHEAD, T + 0.0)
    arbiter.enable(True, T + 0.1)
    assert set(drive(arbiter, 0.1, 1.0)) == {STOP}


def outside_the_fence_only_a_person_drives(arbiter):
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}  # no pose yet
    arbiter.locate(1.0, 1.0, T + 1.0)
    assert drive(arbiter, 1.0, 0.4, AHEAD)[-1] == AHEAD
    arbiter.locate(1.5, 1.5, T + 1.4)
    assert set(drive(arbiter, 1.4, 0.4, AHEAD)) == {STOP}
    assert drive(arbiter, 1.8, 0.2, AHEAD, "teleop")[-1] == AHEAD
    arbiter.locate(math.nan, 0.0, T + 3.0)
    assert set(drive(arbiter, 3.0, 0.2, AHEAD)) == {STOP}


def a_stale_pose_is_outside(arbiter):
    arbiter.locate(0.0, 0.0, T + 0.0)
    assert drive(arbiter, 0.0, 0.5, AHEAD)[-1] == AHEAD
    assert set(drive(arbiter, 0.54, 1.0, AHEAD)) == {STOP}


def speed_is_scaled(arbiter):
    assert drive(arbiter, 0.0, 1.0, Command(0.5, 0.0))[-1].v == pytest.approx(0.10485)  # half of 0.2097
    assert drive(arbiter, 1.0, 1.0, Command(0.0, 1.0))[-1].omega == pytest.approx(0.5)


def a_suspended_process_does_not_leap(arbiter):
    arbiter.step(T)
    arbiter.hear("program", Command(0.2, 0.0), T + 0.3)
    assert arbiter.step(T + 0.3).v == pytest.approx(0.1)  # 2.5 m/s^2 for 40 ms, however long it was


def a_process_that_was_suspended_for_long_stops_first(arbiter):
    assert drive(arbiter, 0.0, 1.0, AHEAD)[-1] == AHEAD  # which the wheels hold from then on
    arbiter.hear("program", AHEAD, T + 10.0, sent=T + 9.99)  # young enough, as it proves
    assert arbiter.step(T + 10.0) == STOP
    assert drive(arbiter, 10.02, 0.2)[-1] == AHEAD


def what_waited_meanwhile_is_not_obeyed(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    for sent, dated in ((T + 8.0, True), (T + 10.0, False)):
        arbiter.hear("program", AHEAD, T + 10.0, sent=sent, dated=dated)
        arbiter.hear("teleop", AHEAD, T + 10.001, sent=sent, dated=dated)
        assert arbiter.step(T + 10.001) in (STOP, None)
    assert set(drive(arbiter, 10.02, 0.4)) == {STOP}
    assert arbiter.refused == {"not finite": 0, "too old": 2, "undated after a gap": 2}
    arbiter.hear("program", AHEAD, T + 10.45, dated=False)
    assert arbiter.refused["undated after a gap"] == 3
    drive(arbiter, 10.46, 0.1)
    arbiter.hear("program", AHEAD, T + 10.55, dated=False)  # 0.5 s after the gap that counts again
    assert drive(arbiter, 10.56, 0.2)[-1] == AHEAD


def after_a_gap_every_button_is_heard_first(arbiter):
    assert buttons(arbiter, 0.0, 1.0)[-1] == AHEAD
    arbiter.hear("program", AHEAD, T + 1.25)  # 0.27 s without a look: a press may be on its way
    assert arbiter.step(T + 1.25) == STOP
    arbiter.hear_emergency(False, T + 1.26, sent=T + 1.24, number=11)
    assert arbiter.step(T + 1.26) in (STOP, None)
    arbiter.hear_emergency(False, T + 1.3, sent=T + 1.27, number=12)
    assert arbiter.step(T + 1.3) != STOP
    assert not arbiter.emergency


def silence_is_not_judged_by_one_who_did_not_listen(arbiter):
    buttons(arbiter, 0.0, 1.0)  # the last command and message came at 0.9 s
    assert arbiter.step(T + 1.45) == STOP  # it was suspended itself, for 0.47 s
    arbiter.hear_emergency(False, T + 1.46, number=11)
    assert not arbiter.emergency
    arbiter.step(T + 1.5)
    assert buttons(arbiter, 1.54, 0.4, number=12)[-1] == AHEAD


def one_who_did_not_listen_for_long_may_have_missed_a_press(arbiter):
    buttons(arbiter, 0.0, 1.0)
    arbiter.step(T + 1.6)
    assert set(buttons(arbiter, 1.6, 2.0, number=11)) == {STOP}
    assert arbiter.enable(True, T + 3.6) == ""


def a_required_button_must_be_heard_to_start(arbiter):
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}
    assert "no emergency stop is heard" in arbiter.enable(True, T + 1.0)
    assert set(buttons(arbiter, 1.02, 0.3)) <= {STOP}
    assert arbiter.enable(True, T + 1.33) == ""
    assert buttons(arbiter, 1.34, 0.3, number=4)[-1] == AHEAD


def without_a_required_standby_the_robot_stands(arbiter):
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}
    arbiter.hear_standby(T + 1.02, sent=T + 1.0)
    assert drive(arbiter, 1.02, 0.46, AHEAD)[-1] == AHEAD
    assert set(drive(arbiter, 1.52, 1.0, AHEAD)) == {STOP}
    assert not arbiter.emergency


def a_flood_is_a_stop(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    for k in range(300):
        arbiter.hear("program", AHEAD, T + 1.0 + k * 0.001)
        out = arbiter.step(T + 1.0 + k * 0.001)
        assert k < 51 or out in (STOP, None)
    assert arbiter.flooded(T + 1.3) == ["program"]
    assert set(drive(arbiter, 1.32, 0.4, AHEAD)) == {STOP}
    assert drive(arbiter, 1.9, 0.4, AHEAD)[-1] == AHEAD


def a_robot_that_joins_at_the_start_stands_first(arbiter):
    arbiter.hear("program", AHEAD, T)
    arbiter.greet(T)
    assert set(drive(arbiter, 0.0, 0.3, AHEAD)) == {STOP}
    assert drive(arbiter, 0.32, 0.3, AHEAD)[-1] == AHEAD


def a_motion_in_force_is_repeated(arbiter):
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear("program", AHEAD, T + 1.0)
    times = [at for k in range(1, 20) if arbiter.step(at := T + 1.0 + TICK * k) == AHEAD]
    assert len(times) > 4
    assert max(b - a for a, b in pairwise(times)) < 0.07


def a_new_robot_is_told_to_stop(arbiter):
    drive(arbiter, 0.0, 3.0)
    arbiter.greet(T + 3.0)
    assert set(drive(arbiter, 3.0, 0.5)) == {STOP}


def sabotage(name, replacement):
    def apply(arbiter):
        setattr(arbiter, name, replacement(arbiter))

    return apply


def parameter(name, value):
    return lambda arbiter: object.__setattr__(arbiter._p, name, value)


def deaf(arbiter):
    return lambda *_, **options: None


def deaf_to_gaps(arbiter):
    arbiter.buttons.wake = lambda gap, now: None


def only_news(arbiter):
    step = arbiter.step
    return lambda now: out if (news := bool(arbiter._news), out := step(now)) and (news or out == STOP) else None


def talks_without_thinking(arbiter):
    def hear(source, command, now):
        arbiter._heard[source] = _Heard(now, command)
        arbiter._news.add(source)

    return hear


def believes_arrival(arbiter):
    return lambda source, command, now, **options: Arbiter.hear(arbiter, source, command, now)


def hears_the_last(arbiter):
    return lambda pressed, now, **options: setattr(arbiter, "emergency", pressed)


def asks_before_disabling(arbiter):
    return lambda on, now: arbiter.buttons.refusal(now, 0) or Arbiter.enable(arbiter, on, now)


def as_fast_as_it_can(arbiter):
    return lambda command, now: command


def slow(arbiter):
    def paced(command, now):
        return None if now < arbiter._due else Arbiter._paced(arbiter, command, now)

    return paced


def remembers_its_speed(arbiter):
    step = arbiter.step

    def remember(now):
        before, out = arbiter._last, step(now)
        arbiter._last = before if out == STOP else arbiter._last
        return out

    return remember


def makes_up_for_it(arbiter):
    return lambda target, dt: Arbiter._ramp(arbiter, target, 0.3)


def never_blind(arbiter):
    def wake(now):
        Arbiter._wake(arbiter, now)
        arbiter._blind_until = now

    return wake


def unlimited(arbiter):
    return Robot(max_linear=1e9, max_angular=1e9)


def nothing_instead_of_stop(arbiter):
    step = arbiter.step
    return lambda now: None if (out := step(now)) == STOP else out


def stop_for_ever(arbiter):
    step = arbiter.step
    return lambda now: step(now) or STOP


def ramps_stops(arbiter):
    return lambda target, dt: Arbiter._ramp(arbiter, Command(target.v + 1e-12, target.omega), dt)


def forget_no_command(arbiter):
    def enable(on, now, **options):
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
    (a_press_that_is_released_at_once_counts, {}, sabotage("hear_emergency", hears_the_last)),
    (disabling_is_never_refused, {}, sabotage("enable", asks_before_disabling)),
    (a_start_after_a_stop_is_as_gentle_as_the_first, {}, sabotage("step", remembers_its_speed)),
    (what_was_sent_before_it_was_enabled_does_not_count, {}, sabotage("hear", believes_arrival)),
    (age_is_that_of_what_was_sent, {}, sabotage("hear", believes_arrival)),
    (output_is_bounded, {}, sabotage("_paced", as_fast_as_it_can)),
    (stops_are_not_delayed_by_the_rate, {}, sabotage("_paced", slow)),
    (what_waited_meanwhile_is_not_obeyed, {}, sabotage("hear", believes_arrival)),
    (after_a_gap_every_button_is_heard_first, {}, sabotage("_wake", never_blind)),
    (silence_is_not_judged_by_one_who_did_not_listen, {}, sabotage("_wake", never_blind)),
    (a_silent_emergency_stop_is_a_stop, {}, sabotage("hear_emergency", deaf)),
    (a_pressed_emergency_stop_refuses, {}, sabotage("enable", forget_no_command)),
    (disabled_it_stops, {}, sabotage("enable", lambda arbiter: lambda on, now, **options: "")),
    (enabling_forgets_what_was_said_before, {}, sabotage("enable", forget_no_command)),
    (outside_the_fence_only_a_person_drives, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (a_stale_pose_is_outside, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (speed_is_scaled, {"speed_scale": 0.5}, parameter("speed_scale", 1.0)),
    (a_suspended_process_does_not_leap, {}, sabotage("_ramp", makes_up_for_it)),
    (a_process_that_was_suspended_for_long_stops_first, {}, parameter("max_age", 1e6)),
    (a_new_robot_is_told_to_stop, {}, sabotage("greet", deaf)),
    (a_robot_that_joins_at_the_start_stands_first, {}, sabotage("greet", deaf)),
    (one_who_did_not_listen_for_long_may_have_missed_a_press, {}, deaf_to_gaps),
    (a_required_button_must_be_heard_to_start, {"require_emergency_stop": True}, sabotage("enable", forget_no_command)),
    (without_a_required_standby_the_robot_stands, {"require_standby": True}, parameter("require_standby", False)),
    (a_flood_is_a_stop, {}, sabotage("_count", deaf)),
    (a_motion_in_force_is_repeated, {}, sabotage("step", only_news)),
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
    arbiter.enable(True, T + 2.0)
    assert drive(arbiter, 2.0, 1.0, AHEAD)[-1] == AHEAD


def test_zeros_keep_the_rate_and_end_after_a_second():
    arbiter = new()
    assert arbiter.state == "stopped"
    assert arbiter.step(T) == STOP
    assert arbiter.step(T + 0.001) is None
    arbiter = new()
    assert drive(arbiter, 0.0, 1.0)[-1] == STOP
    assert arbiter.step(T + 1.0) is None
    assert arbiter.state == "silent"


def test_a_turn_starts_gently_too():
    arbiter = new()
    drive(arbiter, 0.0, 0.5)
    turning = drive(arbiter, 0.5, 0.2, Command(0.0, 2.6))
    assert turning[0] == (0.0, pytest.approx(0.625))  # 2.5 m/s^2 for 20 ms at a wheel 0.08 m from the middle
    assert turning[1] == (0.0, pytest.approx(1.25))


def test_ages_count_with_their_end():
    arbiter = new(max_age=0.5, geofence=0.5)
    arbiter.locate(0.3, 0.4, T)  # on the fence
    arbiter.hear("program", AHEAD, T)
    for k in range(1, 9):
        arbiter.step(T + 0.0625 * k)
        assert arbiter.state == "program"
        assert not arbiter.outside(T + 0.0625 * k)
    assert arbiter.outside(T + 0.5625)
    assert arbiter.step(T + 0.5625) == STOP
    assert arbiter.state == "stopped"


def test_half_a_metre_is_a_fence():
    arbiter = new(geofence=0.5)
    arbiter.locate(0.3, 0.41, T)
    assert arbiter.outside(T)
    assert not new().outside(T)


def test_a_pose_is_as_old_as_what_was_sent():
    arbiter = new(geofence=0.5)
    assert arbiter.outside(T)  # nothing is known
    arbiter.locate(0.0, 0.0, T, sent=T - 0.375)
    assert not arbiter.outside(T + 0.125)
    assert arbiter.outside(T + 0.1875)
    arbiter.locate(0.0, 0.0, T + 1.0, sent=T + 5.0)  # not in the future
    assert arbiter.outside(T + 1.5625)


@pytest.mark.parametrize("speed", [0.1, -0.1])
def test_the_rate_holds_back_everything_but_a_stop(speed):
    arbiter = new()
    drive(arbiter, 0.0, 1.0, Command(speed, 0.0))
    arbiter.hear("program", Command(0.9 * speed, 0.0), T + 1.0)
    assert arbiter.step(T + 1.0) == (0.9 * speed, 0.0)
    arbiter.hear("program", Command(0.8 * speed, 0.0), T + 1.001)
    assert arbiter.step(T + 1.001) is None
    arbiter.hear("program", STOP, T + 1.002)
    assert arbiter.step(T + 1.002) == STOP


def test_a_command_may_come_half_a_period_early():
    arbiter = new(rate=64.0)  # half a period is 1/128 s
    drive(arbiter, 0.0, 1.0, AHEAD)
    for at, passes in ((1.0, True), (1.0077, False), (1.0078125, True)):
        arbiter.hear("program", Command(0.1, 0.2 - 0.1 * at), T + at)
        assert (arbiter.step(T + at) is not None) is passes


def test_of_two_commands_that_were_sent_at_the_same_time_the_later_one_counts():
    arbiter = new(max_age=0.5)
    drive(arbiter, 0.0, 1.0)
    arbiter.hear("program", AHEAD, T + 1.0, sent=T + 0.5)
    assert arbiter.refused["too old"] == 0
    arbiter.hear("program", AHEAD, T + 1.0, sent=T + 0.75)
    assert arbiter.step(T + 1.0).v > 0.0
    arbiter.hear("program", STOP, T + 1.0, sent=T + 0.75)
    assert arbiter.step(T + 1.0) == STOP


@pytest.mark.parametrize(
    "call",
    [
        lambda arbiter, now: arbiter.hear("program", AHEAD, now),
        lambda arbiter, now: arbiter.hear_emergency(False, now),
        lambda arbiter, now: arbiter.locate(0.0, 0.0, now),
        lambda arbiter, now: arbiter.enable(True, now),
        lambda arbiter, now: arbiter.step(now),
    ],
)
def test_whoever_calls_the_guard_is_awake(call):
    arbiter = new()
    call(arbiter, T + 0.0625)
    arbiter.hear("teleop", AHEAD, T + 0.125, dated=False)
    assert arbiter.refused["undated after a gap"] == 0


def test_more_than_a_tenth_of_a_second_without_a_call_is_a_gap():
    arbiter = new()
    arbiter.hear_emergency(False, T + 0.0625, dated=False)  # no gap
    assert arbiter.buttons.trouble(T + 0.0625) == ""
    arbiter = Arbiter(Parameters(), now=0.0)  # the machine has just started
    arbiter.hear_emergency(False, 0.125, dated=False)  # it may have waited, and proves nothing
    assert arbiter.buttons.trouble(0.125) == "the emergency stop is silent"
    arbiter = new()
    arbiter.hear("program", AHEAD, T + 0.125, dated=False)
    assert arbiter.refused["undated after a gap"] == 1


def test_a_gap_is_longer_than_a_tenth_of_a_second_and_one_longer_than_a_commands_age_stops():
    arbiter = Arbiter(Parameters(), now=0.0)
    arbiter.hear("program", AHEAD, 0.1, dated=False)
    assert arbiter.refused["undated after a gap"] == 0
    arbiter = new(max_age=0.5)
    arbiter.hear("program", AHEAD, T)
    assert arbiter.step(T + 0.5).v > 0.0
    assert arbiter.step(T + 1.0625) == STOP


def test_an_undated_message_counts_from_half_a_second_after_a_gap():
    for at, counts in ((10.4375, False), (10.5, True)):
        arbiter = new()
        arbiter.step(T + 10.0)
        for k in range(1, 8):
            arbiter.step(T + 10.0 + 0.0625 * k)
        arbiter.hear("program", AHEAD, T + at, dated=False)
        arbiter.hear_emergency(False, T + at, dated=False)
        assert arbiter.refused["undated after a gap"] == (0 if counts else 1)
        assert (arbiter.buttons.trouble(T + at) == "") is counts


def test_it_says_what_it_does():
    arbiter = new()
    for at, state, act in (
        (0.0, "stopped", lambda: None),
        (0.1, "program", lambda: arbiter.hear("program", AHEAD, T + 0.1)),
        (0.2, "teleop", lambda: arbiter.hear("teleop", AHEAD, T + 0.2)),
        (1.9, "silent", lambda: drive(arbiter, 0.22, 1.68)),
        (2.0, "stopped", lambda: arbiter.enable(False, T + 2.0)),
        (3.1, "disabled", lambda: drive(arbiter, 2.02, 1.08)),
        (3.2, "emergency", lambda: arbiter.hear_emergency(True, T + 3.2)),
    ):
        act()
        arbiter.step(T + at)
        assert arbiter.state == state


def test_the_limits_of_a_robot_in_a_file_hold(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("{max_linear: 0.07, max_angular: 0.5, radius: 0.2}")
    arbiter = new(robot=str(path))
    assert max(drive(arbiter, 0.0, 1.0, Command(1.0, 0.0))) == Command(0.07, 0.0)
    mount = {"collision_monitor": True, "scan_mount": "given", "scan_x": 0.1}
    assert new(robot=str(path), **mount).monitor._body.radius == 0.2
    with pytest.raises(ValueError, match="scan_mount must be 'given' for a robot from a file"):
        new(robot=str(path), collision_monitor=True)
    with pytest.raises(ValueError, match="There is no robot file"):
        new(robot=str(tmp_path / "none.yaml"))
