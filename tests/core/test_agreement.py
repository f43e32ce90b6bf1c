"""Odometry that is alive and wrong is refused within a second and 0.25 m, and odometry that is only slow or noisy never is."""

import math
import random

import pytest
from driver import LIES, Driver, wrapped

from turtlebot_gym.estimation.agreement import Agreement, _explanation
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import NOISES
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command, Odometry, Pose, SidewaysOdometry


def watch(noise="wheel"):
    return Agreement(ROBOTS["burger"], NOISES[noise])


def judged(driver, command, *, seconds=10.0):
    """Return the time and the way from the lie to the final cause, and the cause, for a robot under one command."""
    agreement, way = watch(), None
    while driver.time < seconds:
        said = driver.step(command)
        way = driver.way if way is None and driver.time > driver.since else way
        agreement.judge(Driver.dt, said, command)
        if agreement.cause:
            return driver.time - driver.since, driver.way - way, agreement.cause
    return math.inf, math.inf, ""


SAID = {
    "mm": "1000 times the command: in mm?",
    "twist in deg/s": "57 times the command: in degrees/s?",
    "speed sign": "the speed has the wrong sign",
    "blocked": "commanded to drive and does not move: blocked, or its emergency stop is pressed",
    "crossed": "the turning rate has the wrong sign",
}
"""What some lies are called; more by `test_a_wrong_sign_and_a_wrong_unit_are_told_by_their_motion`."""


# A frozen twist is true as long as the robot drives as before; along x there is no y; and a drive that begins has no reset.
@pytest.mark.parametrize(
    ("lie", "since"),
    [
        (lie, since)
        for lie in (*LIES, "blocked", "crossed")
        for since in (0.0, 3.0)
        if lie != "twist frozen" and (since or lie not in ("y sign", "reset"))
    ],
)
def test_a_lie_is_final_within_a_second_and_a_quarter_of_a_metre(lie, since):
    """In a bend, so that each lie shows at once; a twist that froze there shows when the robot turns another way."""
    command = Command(0.2, 0.6)
    time, way, cause = judged(Driver(lie, since), command)
    assert time <= 1.0
    assert way <= 0.25
    if since or lie in ("blocked", "crossed", "stands", "mm", "cm"):
        assert SAID.get(lie, "") in cause


@pytest.mark.parametrize("noise", NOISES)
def test_two_opposite_spikes_in_a_window_are_noise(noise):
    """Not one message is refused: in lock-step a graph waits for the answer to each."""
    agreement, spike = watch(noise), NOISES[noise].odometry.spike
    for k in range(40):
        heading = {10: spike, 14: -spike, 20: -spike, 21: spike}.get(k, 0.0)
        assert agreement.judge(0.1, Odometry(Pose(0.02 * k, 0.0, heading), Command(0.2, 0.0), True), Command(0.2, 0.0)) == ""


@pytest.mark.parametrize("distance", [0.1, 0.35, 3.0])
def test_a_reset_is_noticed_at_any_distance(distance):
    assert judged(Driver("reset", distance / 0.2 + 0.001), Command(0.2, 0.0), seconds=60.0) < (0.25, 0.06)


def driven(driver, rng, hours):
    """Return the causes for a robot that changes its mind often."""
    agreement, causes, until = watch(), [], 0.0
    while driver.time < 3600.0 * hours:
        if driver.time >= until:
            command = Command(rng.choice((0.0, 0.02, -0.1, 0.2, 0.2)), rng.choice((0.0, 0.0, 0.05, -0.3, 1.5, -2.5)))
            until = driver.time + rng.choice((0.1, 0.6, 2.0, 5.0))
        agreement.judge(Driver.dt, driver.step(command), command)
        if agreement.cause:
            causes.append(agreement.cause)
            agreement.begin()
    return causes


@pytest.mark.parametrize(
    ("delay", "acceleration", "grid"),
    [(0.0, (math.inf, math.inf), 0.0), (0.5, (math.inf, math.inf), 0.0), (0.0, (0.1, 0.6), 0.0), (0.3, (0.5, 3.0), 0.01)],
)
def test_a_robot_that_is_only_slow_is_never_refused(delay, acceleration, grid):
    assert driven(Driver(delay=delay, acceleration=acceleration, grid=grid), random.Random(1), 0.25) == []


def test_late_and_lost_messages_are_no_contradiction_and_a_reset_behind_them_is():
    for reset in (False, True):
        driver, agreement, rng = Driver("reset" if reset else None, 20.0), watch(), random.Random(3)
        command, since = Command(0.2, 0.5), 0.0
        for _ in range(600):
            said, since = driver.step(command), since + Driver.dt
            if rng.random() < 0.3 or rng.random() < 0.01:
                continue
            agreement.judge(since + rng.uniform(-0.02, 0.02), said, command)
            since = 0.0
        assert bool(agreement.cause) is reset


def test_noise_is_no_contradiction_and_the_same_noise_is_where_the_model_has_none():
    rng = random.Random(5)
    for name, expected in (("documented", False), ("wheel", True)):
        noise, driver = NOISES["documented"].odometry, Driver()
        agreement = watch(name)
        for _ in range(20000):
            said = driver.step(Command(0.2, 0.7))
            spike = rng.choice((-noise.spike, noise.spike)) * (rng.random() < noise.spike_probability)
            x, y, theta = (value + rng.gauss(0.0, math.sqrt(R)) for value, R in zip(said.pose, noise.R, strict=True))
            agreement.judge(Driver.dt, said._replace(pose=Pose(x, y, wrapped(theta + spike))), Command(0.2, 0.7))
        assert bool(agreement.cause) is expected


def test_wheels_that_slip_as_the_model_says_are_no_contradiction():
    slippery = Noise(process=ProcessNoise(slip=0.5, slip_start=0.1, slip_end=0.1))
    for noise, expected in ((slippery, False), (Noise(odometry=OdometryNoise(wheel=True)), True)):
        agreement, x = Agreement(ROBOTS["burger"], noise), 0.0
        for k in range(400):
            x += 0.01 * (0.2 if k % 100 < 50 else 1.0)
            agreement.judge(0.05, Odometry(Pose(x, 0.0, 0.0), Command(0.2, 0.0), True))
        assert bool(agreement.cause) is expected


def test_a_glitch_of_one_message_is_refused_and_forgotten():
    """As a TurtleBot3 sends it where its heading leaves [-pi, pi): a turning rate of 2 pi per message."""
    driver, agreement = Driver(), watch()
    for k in range(400):
        said = driver.step(Command(0.1, 0.3))
        glitch = k % 40 == 20
        said = said._replace(twist=said.twist._replace(omega=-125.0)) if glitch else said
        assert bool(agreement.judge(Driver.dt, said, Command(0.1, 0.3))) is glitch
    assert agreement.cause == ""


@pytest.mark.parametrize(("across", "refused"), [(0.02, False), (0.05, True), (-0.05, True)])
def test_a_twist_to_the_side_is_one_in_another_frame(across, refused):
    driver, agreement = Driver(), watch()
    for _ in range(40):
        said = SidewaysOdometry(*driver.step(Command(0.2, 0.0)))
        said.across = across
        agreement.judge(Driver.dt, said, Command(0.2, 0.0))
    assert ("in the world's frame" in agreement.cause) is refused


# A reset just before leaves no command that the robot might obey late, and one that swayed leaves slow ones only.
@pytest.mark.parametrize(
    ("crossed", "delay", "acceleration", "before"),
    [
        (*case, before)
        for case in [(1, 0.0, math.inf), (1, 0.1, 3.0), (0, 0.1, 3.0), (0, 0.5, math.inf), (0, 0.5, 1.0)]
        for before in ({}, {"reset": 34}, {"sways": 0.2})
        if case != (1, 0.1, 3.0) or "sways" not in before  # which looks like a late answer to a command that alternates
    ],
)
def test_wheels_that_turn_the_other_way_show_at_once_though_the_command_alternates(crossed, delay, acceleration, before):
    driver = Driver("crossed" if crossed else None, 2.0, delay=delay, acceleration=(math.inf, acceleration))
    agreement, omega, late = watch(), 0.0, math.inf
    for k in range(160):
        if k == before.get("reset"):
            agreement.begin()
        sign = 1.0 if k < 46 else (-1.0) ** (k // 4)  # from 2.3 s on it alternates every 0.2 s
        omega = before.get("sways", 0.0) * (-1.0) ** (k // 4) if k < 40 else sign
        if agreement.judge(Driver.dt, driver.step(Command(0.1, omega)), Command(0.1, omega)) and late == math.inf:
            late = driver.time - 2.0 - delay
    assert (late < 0.5) if crossed else (agreement.cause == "")


def test_after_a_pause_the_robot_must_be_where_it_was():
    for x, refused in ((1.0, False), (1.3, False), (0.0, True), (2.0, True)):
        agreement = watch()
        agreement.judge(0.0, Odometry(Pose(1.0, 0.0, 0.0), STOP, True))
        agreement.pause()
        assert bool(agreement.judge(0.0, Odometry(Pose(x, 0.0, 0.0), STOP, True))) is refused


def test_time_alone_ends_no_refusal_and_begin_does():
    agreement, away = watch(), Odometry(Pose(0.4, 0.0, 0.0), STOP, True)
    agreement.judge(0.0, Odometry(Pose(0.0, 0.0, 0.0), STOP, True))
    assert all(agreement.judge(0.05, away) for _ in range(2000))
    agreement.begin()
    assert agreement.judge(0.0, away) == ""


WAY, TURN = 0.3 + 0.12j, 0.5


@pytest.mark.parametrize(
    ("moved", "text"),
    [
        ((-WAY, TURN), "the pose moves against the speed"),
        ((WAY.conjugate(), -TURN), "the heading turns against the turning rate"),
        ((WAY, math.degrees(TURN)), "the heading changes 57 times as fast"),
        ((3.0 * WAY, TURN), "the pose moves 3 times as far as the twist says"),
        ((1000.0 * WAY, TURN), "the pose moves 1e+03 times as far as the twist says: in mm?"),
        ((WAY / 3.0, TURN), "the twist is 3 times too large"),
        ((1.0 - 1.0j, TURN), ""),
    ],
)
def test_a_wrong_sign_and_a_wrong_unit_are_told_by_their_motion(moved, text):
    said = _explanation(moved, (WAY, TURN), (0.05, 0.05, 0.1))
    assert text in said
    assert bool(text) is bool(said)


def test_a_twist_that_froze_shows_when_the_robot_turns_another_way():
    driver, agreement = Driver("twist frozen", 1.0), watch()
    for command in [Command(0.2, 0.0)] * 40 + [Command(0.2, 1.0)] * 20:
        assert agreement.cause == "" or driver.time > 2.01
        agreement.judge(Driver.dt, driver.step(command), command)
    assert "pose and twist differ" in agreement.cause


@pytest.mark.parametrize(("gap", "refused"), [(3.0, False), (0.05, True)])
def test_a_robot_that_stands_after_a_gap_in_the_messages_has_not_disobeyed(gap, refused):
    """It stood because nobody was there to command it; with the same messages in time it does disobey."""
    turning, agreement, heading = Command(0.0, 0.6), watch(), 0.0
    agreement.judge(0.0, Odometry(Pose(0.0, 0.0, 0.0), turning, True), turning)
    for _ in range(40):
        heading = wrapped(heading + 0.6 * Driver.dt)
        assert agreement.judge(Driver.dt, Odometry(Pose(0.0, 0.0, heading), turning, True), turning) == ""
    stands = Odometry(Pose(0.0, 0.0, heading), STOP, True)
    refusals = [agreement.judge(gap if first else Driver.dt, stands, turning) for first in [True] + [False] * 14]
    assert refusals[0] == ""
    assert any("does not turn" in why for why in [*refusals, agreement.judge(Driver.dt, stands, turning)]) is refused


@pytest.mark.parametrize("late", [0.3, 0.5])
@pytest.mark.parametrize("turn", [2.0, -2.0])
def test_a_heading_that_is_late_shows_when_the_robot_begins_to_turn(late, turn):
    agreement, driver, headings = watch(), Driver(), [0.0] * round(late / Driver.dt)
    while driver.time < 2.0 and not agreement.cause:
        said = driver.step(Command(0.1, turn if driver.time >= 1.0 else 0.0))
        headings.append(said.pose.theta)
        agreement.judge(Driver.dt, said._replace(pose=said.pose._replace(theta=headings.pop(0))), None)
    assert agreement.cause
