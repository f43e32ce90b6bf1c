"""What the guard decides, without ROS, beyond the law of `test_law`."""

import math

import numpy as np
import pytest
from burger import Parameters
from guard_scans import hall

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.values import STOP, Command, Pose

TICK, T, AHEAD = 0.02, 100.0, Command(0.1, 0.2)  # all begins at T, not at 0


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
    return [command for command in published if command is not None]


def test_a_start_keeps_its_curvature():
    arbiter = new()
    steps = drive(arbiter, 0.0, 1.0, Command(0.4, 2.0))  # twice too fast: limits and the ramp both act
    assert len(set(steps)) > 3
    for out in steps:
        assert out.omega == pytest.approx(5.0 * out.v)


def test_a_person_wins():
    arbiter = new()
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


def test_outside_the_fence_only_a_person_drives():
    arbiter = new(geofence=2.0)
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}  # no pose yet
    arbiter.locate(1.0, 1.0, T + 1.0)
    assert drive(arbiter, 1.0, 0.4, AHEAD)[-1] == AHEAD
    arbiter.locate(1.5, 1.5, T + 1.4)
    assert set(drive(arbiter, 1.4, 0.4, AHEAD)) == {STOP}
    assert drive(arbiter, 1.8, 0.2, AHEAD, "teleop")[-1] == AHEAD
    arbiter.locate(math.nan, 0.0, T + 3.0)
    assert set(drive(arbiter, 3.0, 0.2, AHEAD)) == {STOP}


def test_speed_is_scaled():
    arbiter = new(speed_scale=0.5)
    assert drive(arbiter, 0.0, 1.0, Command(0.5, 0.0))[-1].v == pytest.approx(0.10485)  # half of 0.2097
    assert drive(arbiter, 1.0, 1.0, Command(0.0, 1.0))[-1].omega == pytest.approx(0.5)


def test_a_process_that_was_suspended_for_long_stops_first():
    arbiter = new()
    assert drive(arbiter, 0.0, 1.0, AHEAD)[-1] == AHEAD  # which the wheels hold from then on
    arbiter.hear("program", AHEAD, T + 10.0, sent=T + 9.99)  # young enough, as it proves
    assert arbiter.step(T + 10.0) == STOP
    assert drive(arbiter, 10.02, 0.2)[-1] == AHEAD


def test_after_a_gap_every_button_is_heard_first():
    arbiter = new()
    assert buttons(arbiter, 0.0, 1.0)[-1] == AHEAD
    arbiter.hear("program", AHEAD, T + 1.25)  # 0.27 s without a look: a press may be on its way
    assert arbiter.step(T + 1.25) == STOP
    arbiter.hear_emergency(False, T + 1.26, sent=T + 1.24, number=11)
    assert arbiter.step(T + 1.26) in (STOP, None)
    arbiter.hear_emergency(False, T + 1.3, sent=T + 1.27, number=12)
    assert arbiter.step(T + 1.3) != STOP
    assert not arbiter.emergency


def test_after_a_silence_it_goes_on_when_a_button_is_heard_for_half_a_second():
    arbiter = new()
    buttons(arbiter, 0.0, 1.0)  # the last message came at 0.9 s
    assert STOP not in drive(arbiter, 1.0, 0.38, AHEAD)
    assert set(drive(arbiter, 1.42, 0.5, AHEAD)) == {STOP}
    assert set(buttons(arbiter, 1.94, 0.48, number=11)) == {STOP}
    assert not arbiter.emergency
    assert buttons(arbiter, 2.44, 0.2, number=16)[-1] == AHEAD


CALLS = {"step": (), "hear": ("program", AHEAD), "hear_emergency": (False,), "hear_odometry": (Pose(0.0, 0.0, 0.0), STOP)}
CALLS |= {"locate": (0.0, 0.0), "hear_scan": (hall(),), "hear_standby": (), "count_buttons": (0,), "enable": (False,)}
TIMES = {"hear_odometry": "measured", "hear_standby": "sent"}


@pytest.mark.parametrize("name", CALLS)
def test_one_who_did_not_listen_for_long_may_have_missed_a_press(name):
    arbiter = new()
    buttons(arbiter, 0.0, 1.0)
    getattr(arbiter, name)(*CALLS[name], T + 1.6, **({TIMES[name]: T + 1.6} if name in TIMES else {}))
    assert arbiter.buttons.trouble(T + 1.6) == "the emergency stop was not listened to for 0.6 s"
    assert set(buttons(arbiter, 1.6, 2.0, number=12)) == {STOP}
    assert arbiter.enable(True, T + 3.6) == ""


def test_a_required_button_must_be_heard_to_start():
    arbiter = new(require_emergency_stop=True)
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}
    assert "no emergency stop is heard" in arbiter.enable(True, T + 1.0)
    assert set(buttons(arbiter, 1.02, 0.3)) <= {STOP}
    assert arbiter.enable(True, T + 1.33) == ""
    assert buttons(arbiter, 1.34, 0.3, number=4)[-1] == AHEAD


def test_without_a_required_standby_the_robot_stands():
    arbiter = new(require_standby=True)
    assert set(drive(arbiter, 0.0, 1.0, AHEAD)) == {STOP}
    arbiter.hear_standby(T + 1.02, sent=T + 1.0)
    assert drive(arbiter, 1.02, 0.46, AHEAD)[-1] == AHEAD
    assert set(drive(arbiter, 1.52, 1.0, AHEAD)) == {STOP}
    assert not arbiter.emergency


@pytest.mark.parametrize(("at", "stands"), [(0.0, True), (5.0, True), (5.02, False)])
def test_a_robot_that_joins_in_the_first_five_seconds_stands_first(at, stands):
    arbiter = new()
    drive(arbiter, 0.0, at, AHEAD)
    arbiter.greet(T + at)
    assert set(drive(arbiter, at, 1.0, AHEAD)) == ({STOP} if stands else {AHEAD})
    assert drive(arbiter, at + 1.02, 0.3, AHEAD)[-1] == AHEAD


@pytest.mark.parametrize(("stood", "periods"), [(0.5, 1), (3.0, 2)])  # zeros are sent, or none any more
def test_a_turn_starts_gently_too(stood, periods):
    arbiter = new()
    drive(arbiter, 0.0, stood)
    turning = drive(arbiter, stood, 0.2, Command(0.0, 2.6))
    assert turning[0] == (0.0, pytest.approx(0.625 * periods))  # 2.5 m/s^2 for 20 ms at a wheel 0.08 m from the middle
    assert turning[1] == (0.0, pytest.approx(0.625 * (periods + 1)))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"frame": "map"}, "its frame is 'map', not 'r/odom'"),
        ({"frame": "odom"}, "its frame is 'odom', not 'r/odom'"),
        ({"x": math.nan}, "it is at (nan, 0)"),
        ({"x": 0.3, "y": 0.41}, ""),  # half a metre is a fence
    ],
)
def test_a_pose_of_another_frame_or_too_far_away_proves_nothing(wrong, said):
    assert not new().outside(T)
    arbiter = new(geofence=0.5, frame_prefix="r/")
    right = {"x": 0.0, "y": 0.0, "frame": "r/odom"}
    arbiter.locate(now=T, **right)
    assert (arbiter.outside(T), arbiter.lost) == (False, "")
    arbiter.locate(now=T, **{**right, **wrong})
    assert (arbiter.outside(T), arbiter.lost) == (True, said)
    arbiter.locate(now=T, **right)
    assert (arbiter.outside(T), arbiter.lost) == (False, "")


def test_a_pose_is_as_old_as_what_was_sent():
    arbiter = new(geofence=0.5)
    assert (arbiter.outside(T), arbiter.lost) == (True, "")  # nothing is known
    arbiter.locate(0.0, 0.0, T, sent=T - 0.375)
    assert not arbiter.outside(T + 0.125)
    assert arbiter.outside(T + 0.1875)
    arbiter.locate(0.0, 0.0, T + 1.0, sent=T + 5.0)  # not in the future
    assert arbiter.outside(T + 1.5625)


def test_a_motion_in_force_is_repeated_each_twentieth_of_a_second_however_high_the_rate():
    arbiter = new(rate=200.0)
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear("program", AHEAD, T + 1.0)
    times = [at for k in range(1, 80) if arbiter.step(at := T + 1.0 + 0.005 * k) == AHEAD]
    assert np.diff(times) == pytest.approx(0.0525, abs=0.003)


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


@pytest.mark.parametrize("v", [0.1, math.nan, -math.inf])
@pytest.mark.parametrize("omega", [math.nan, math.inf, 0.2])
def test_a_command_is_a_stop_unless_both_of_its_numbers_are_finite(v, omega):
    arbiter, is_command = new(), math.isfinite(v) and math.isfinite(omega)
    drive(arbiter, 0.0, 1.0, AHEAD)
    arbiter.hear("program", Command(v, omega), T + 1.0)
    assert arbiter.step(T + 1.0) == (AHEAD if is_command else STOP)
    assert arbiter.refused["not finite"] == (not is_command)


def test_a_command_may_come_half_a_period_early():
    arbiter = new(rate=64.0)  # half a period is 1/128 s
    drive(arbiter, 0.0, 1.0, AHEAD)
    for at, passes in ((1.0, True), (1.0077, False), (1.0078125, True)):
        arbiter.hear("program", Command(0.1, 0.2 - 0.1 * at), T + at)
        assert (arbiter.step(T + at) is not None) is passes


def test_of_two_commands_that_were_sent_at_the_same_time_the_later_one_counts():
    arbiter = new(max_age=0.5)
    drive(arbiter, 0.0, 1.0)
    for sent, refused in ((0.5, 0), (0.49, 1)):
        arbiter.hear("program", AHEAD, T + 1.0, sent=T + sent)
        assert arbiter.refused["too old"] == refused
    arbiter.hear("program", AHEAD, T + 1.0, sent=T + 0.75)
    assert arbiter.step(T + 1.0).v > 0.0
    arbiter.hear("program", STOP, T + 1.0, sent=T + 0.75)
    assert arbiter.step(T + 1.0) == STOP


def test_more_than_a_tenth_of_a_second_without_a_call_is_a_gap():
    for at, why in ((0.0625, ""), (0.125, "the emergency stop is silent")):  # it may have waited, and proves nothing
        arbiter = Arbiter(Parameters(), now=0.0)  # the machine has just started
        arbiter.hear_emergency(False, at, dated=False)
        assert arbiter.buttons.trouble(at) == why
    for at, refused in ((0.1, 0), (0.125, 1)):
        arbiter = Arbiter(Parameters(), now=0.0)
        arbiter.hear("program", AHEAD, at, dated=False)
        assert arbiter.refused["undated after a gap"] == refused


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


@pytest.mark.parametrize(("sent", "measured"), [(0.35, 0.35), (0.0, 0.45)])
def test_a_command_is_obeyed_while_it_is_fresh_by_both_of_its_ages(sent, measured):
    arbiter = new()
    drive(arbiter, 0.0, 2.0)
    arbiter.hear("program", AHEAD, T + 2.0, sent=T + 2.0 - sent, measured=T + 2.0 - measured)
    assert arbiter.step(T + 2.02) not in (STOP, None)
    assert arbiter.step(T + 2.08) == STOP


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


def test_a_gap_longer_than_a_commands_age_stops():
    arbiter = new(max_age=0.5)
    arbiter.hear("program", AHEAD, T)
    assert arbiter.step(T + 0.5).v > 0.0
    assert arbiter.step(T + 1.0625) == STOP


def test_one_that_starts_disabled_says_zeros_at_its_rate_for_a_second_like_any_other():
    for arbiter in (new(), new(start_enabled=False)):
        assert arbiter.state == "stopped"
        assert arbiter.step(T) == STOP
        assert arbiter.step(T + 0.001) is None
    arbiter = new()
    assert drive(arbiter, 0.0, 1.0)[-1] == STOP
    assert arbiter.step(T + 1.0) is None
    assert arbiter.state == "silent"
    arbiter = new(start_enabled=False)
    assert set(drive(arbiter, 0.0, 2.0, AHEAD)) == {STOP}
    assert arbiter.state == "disabled"
    arbiter.enable(True, T + 2.0)
    assert drive(arbiter, 2.0, 1.0, AHEAD)[-1] == AHEAD
