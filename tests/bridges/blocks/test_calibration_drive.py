"""The calibration drive: it shows everything that a calibration needs, and stays where it is allowed."""

import math
from collections import Counter

import numpy as np
import pytest

from turtlebot_gym import write_parameters
from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_ros.blocks import CalibrationDrive, TurtlebotSimulator
from turtlebot_gym_ros.blocks.calibration_drive import LEVELS, _script

DT = 0.1


def make(**parameters):
    return CalibrationDrive(CalibrationDrive.Params(**parameters))


def driven(drive, noise, *, seed=0, duration=320.0):
    """Return the commands of a drive, and its distances from the start as measured, m."""
    plant = TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, seed=seed))
    commands, far, command = [], [], None
    for k in range(round(duration / DT)):
        odometry = plant.step(DT, command)["odometry"]
        answer = drive.step(DT * (k > 0), odometry)
        if not answer:
            break
        command = answer["command"]
        commands.append(command)
        far.append(math.hypot(odometry.pose.x, odometry.pose.y))
    return commands, far


@pytest.fixture(scope="module")
def strays(tmp_path_factory):
    """Noise under which a script that nobody watches wanders off: the robot makes 1.4 of each command."""
    file = tmp_path_factory.mktemp("noise") / "strays.yaml"
    noise = Noise(process=ProcessNoise(scale=1.4), odometry=OdometryNoise(R=(1e-6, 1e-6, 1e-6)))
    write_parameters(noise, file)
    return str(file)


def test_a_round_shows_all_speeds_and_rates_both_ways_arcs_and_stops():
    commands, _ = driven(make(), "clean")
    seconds = Counter()
    for command in commands:
        seconds[round(command.v, 6), round(command.omega, 6)] += DT
    straights = {v for v, omega in seconds if v > 0.0 == omega}
    turns = {omega for v, omega in seconds if v == 0.0 != omega}
    arcs = {(v, omega) for v, omega in seconds if v > 0.0 and omega}
    assert straights == {round(0.2 * level, 6) for level in LEVELS}
    assert turns == {round(sign * 1.5 * level, 6) for level in LEVELS for sign in (1.0, -1.0)}
    assert {(v, -omega) for v, omega in arcs} == arcs
    assert len(arcs) == 2 * len(LEVELS)
    assert seconds[0.0, 0.0] > 20.0
    assert min(seconds.values()) > 1.9  # nothing is shown for a moment only
    length = DT * sum(command.v for command in commands)
    turned = DT * sum(abs(command.omega) for command in commands)
    assert length > 15.0
    assert turned > 10.0 * math.pi


def test_a_round_ends_where_it_began():
    legs = list(_script(ROBOTS["burger"], speed=0.2, turning=1.5, reach=1.0))
    x = y = theta = 0.0
    for (v, omega), duration in legs:
        if omega:
            x += v / omega * (math.sin(theta + omega * duration) - math.sin(theta))
            y -= v / omega * (math.cos(theta + omega * duration) - math.cos(theta))
        x, y = (x + v * duration * math.cos(theta), y + v * duration * math.sin(theta)) if not omega else (x, y)
        theta += omega * duration
    assert (x, y, math.sin(theta), math.cos(theta)) == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-9)


@pytest.mark.parametrize("radius", [0.6, 1.0, 2.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_it_stays_within_its_circle_also_where_the_robot_strays(strays, radius, seed):
    commands, far = driven(make(radius=radius), strays, seed=seed)
    assert max(far) < radius
    assert sum(command.v > 0.0 for command in commands) > 0.3 * len(commands)  # and it goes on driving


def test_a_script_that_nobody_watches_leaves_the_circle(strays, monkeypatch):
    monkeypatch.setattr(CalibrationDrive, "_leaves", lambda *_: False)
    _, far = driven(make(radius=1.0), strays)
    assert max(far) > 2.0


def test_it_ends_after_its_time_and_a_reset_begins_again():
    drive = make(duration=30.0)
    commands, _ = driven(drive, "clean")
    assert len(commands) == 300
    odometry = Odometry(Pose(0.0, 0.0, 0.0), STOP, True)
    assert drive.step(DT, odometry) == {}
    drive.reset()
    assert drive.step(0.0, odometry) == {"command": commands[0]}


def test_a_gap_does_not_move_the_circle_but_a_robot_that_was_carried_away_has_another():
    drive = make(radius=1.0)
    for start in (Pose(5.0, 3.0, 0.4), Pose(5.9, 3.0, 0.0)):  # the second one after a gap, at the edge, looking outwards
        drive.reset()
        first = drive.step(0.0, Odometry(start, STOP, True))["command"]
    assert first.v == 0.0 != first.omega  # it turns back to the first start
    drive.reset()
    assert drive.step(0.0, Odometry(Pose(7.0, 3.0, 0.0), STOP, True))["command"].v > 0.0


@pytest.mark.parametrize(
    ("pose", "v", "omega"),
    [
        (Pose(5.0, 3.9, 0.0), 0.0, -0.75),  # the centre is to the right
        (Pose(5.0, 2.1, 0.0), 0.0, 0.75),
        (Pose(5.9, 3.0, 3.0), 0.1, 0.1415926535897931),  # ahead, a little to the left
    ],
)
def test_it_turns_to_the_centre_before_it_drives_there(pose, v, omega):
    drive = make(speed=0.2, turning=1.5)
    drive.step(0.0, Odometry(Pose(5.0, 3.0, 0.0), STOP, True))
    command = drive._homeward(pose, Pose(5.0, 3.0, 0.0))
    assert command == pytest.approx((v, omega))


@pytest.mark.parametrize("robot", ROBOTS)
def test_commands_are_within_the_robots_limits(robot):
    for command, duration in _script(ROBOTS[robot], speed=9.0, turning=9.0, reach=1.0):
        assert command == limit(command, ROBOTS[robot])
        assert 0.0 < duration < 60.0


def test_it_comes_home_from_any_side():
    for bearing in np.linspace(-math.pi, math.pi, 9, endpoint=False):
        drive, out = make(radius=1.0), Command(0.2, 0.0)
        for way in np.arange(0.0, 0.9, 0.2 * DT):
            drive.step(DT, Odometry(Pose(way * math.cos(bearing), way * math.sin(bearing), bearing), out, True))
        x, y, theta, v, omega = 0.9 * math.cos(bearing), 0.9 * math.sin(bearing), bearing, 0.2, 0.0
        for _ in range(400):
            v, omega = drive.step(DT, Odometry(Pose(x, y, theta), Command(v, omega), True))["command"]
            x, y, theta = x + DT * v * math.cos(theta), y + DT * v * math.sin(theta), theta + DT * omega
            if math.hypot(x, y) < 0.25:
                break
        assert math.hypot(x, y) < 0.25
