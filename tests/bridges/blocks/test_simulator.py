"""The plant is the environment: same transition, same noise for the same seed and episode; and a person at the keyboard."""

import numpy as np
import pytest

from turtlebot_gym.values import Command
from turtlebot_gym_ros.blocks import SimulatedTeleop, TurtlebotSimulator


def test_a_drawn_room_has_the_map_of_the_environments_localizer_anew_in_each_episode():
    node = TurtlebotSimulator(TurtlebotSimulator.Params(world="dense", noise="wheel", localizer="match", goals=2, seed=3))
    fields = []
    for _ in range(2):
        field = node.step(0.1, None)["map"].field()
        np.testing.assert_array_equal(field, node._episode.scene.memory.field)
        assert "map" not in node.step(0.1, None)
        fields.append(field)
        node.reset()
    assert (fields[0] != fields[1]).any()


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
