"""The tutorial's person at the keyboard."""

import pytest

from turtlebot_gym.values import Command
from turtlebot_gym_ros.blocks import SimulatedTeleop

AHEAD, LEFT, RIGHT, SPIN = Command(0.15, 0.0), Command(0.15, 0.8), Command(0.15, -0.8), Command(0.0, 1.5)


@pytest.mark.parametrize("period", [0.1, 0.05, 0.02, 0.03])
def test_it_follows_the_script_at_any_rate(period):
    teleop = SimulatedTeleop(SimulatedTeleop.Params(period=period))
    steps = round(30.0 / period)
    commands = [teleop.step(period)["command"] for _ in range(steps)]
    durations = {command: commands.count(command) * period for command in set(commands)}
    expected = {AHEAD: 21.0, LEFT: 3.0, RIGHT: 3.0, SPIN: 3.0}
    assert durations == {command: pytest.approx(seconds, abs=1.01 * period) for command, seconds in expected.items()}
    order = [command for command, before in zip(commands, [None, *commands], strict=False) if command != before]
    assert order == [AHEAD, LEFT, AHEAD, RIGHT, AHEAD, SPIN, AHEAD]
    assert teleop.step(period) == {}  # the end: the robot is left to others
    teleop.reset()
    assert teleop.step(period) == {"command": AHEAD}


def test_a_person_needs_no_enabling():
    assert SimulatedTeleop.Params().start_enabled
