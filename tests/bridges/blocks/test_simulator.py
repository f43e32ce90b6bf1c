"""The plant is the environment: same transition, same noise for the same seed and episode; and a person at the keyboard."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.heart import Episode
from turtlebot_gym.presets import NOISES
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_ros.blocks import SimulatedTeleop, TurtlebotSimulator

COMMANDS = [Command(*pair) for pair in np.random.default_rng(0).uniform(-3.0, 3.0, (200, 2)).tolist()]


def simulator(**parameters):
    return TurtlebotSimulator(TurtlebotSimulator.Params(**parameters))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("robot", ["burger", "tutorial"])
def test_its_steps_are_the_environments_to_the_bit(noise, robot):
    plant = simulator(noise=noise, robot=robot, seed=7)
    plant.reset()  # the second episode
    episode = Episode(make_parameters(replace(NAV, random=False), noise=noise, robot=robot), [Pose(0.0, 0.0, 0.0)], seed=7)
    world, lost = episode.reset(), 0
    assert plant.step(0.1, None) == {
        "truth": world.body.true_state,
        "odometry": Odometry(world.senses.odometry.pose, STOP, True),
    }
    for command in COMMANDS:
        before = episode.world.senses.odometry.pose
        episode.step(command)
        world, out = episode.world, plant.step(0.1, command)
        assert out["truth"] == world.body.true_state
        measured = noise not in ("rough",) or world.senses.odometry.pose != before  # its white noise never repeats a number
        assert out["odometry"] == Odometry(world.senses.odometry.pose, world.body.command, measured)
        lost += not measured
    assert (lost > 0) == (NOISES[noise].odometry.dropout_probability > 0.01)  # rarer ones do not happen in this drive


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
