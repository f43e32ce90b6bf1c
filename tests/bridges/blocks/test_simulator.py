"""The plant is the environment: the same transition, the same noise for the same seed and episode."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.presets import NOISES
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import Episode, make_parameters
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_ros.blocks import TurtlebotSimulator

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
    assert (lost > 0) == (NOISES[noise].odometry.dropout_probability > 0.0)


def test_it_is_at_rest_until_commanded_and_then_holds_the_last_command():
    plant = simulator(noise="clean")
    for _ in range(10):
        assert plant.step(0.1, None)["truth"] == (0.0, 0.0, 0.0, 0.0, 0.0)
    plant.step(0.1, Command(0.1, 0.0))
    for k in range(10):  # the shell gives it the last command, however old
        assert plant.step(0.1, Command(0.1, 0.0))["truth"].x == pytest.approx(0.01 * (k + 1), abs=1e-12)


def test_a_sensor_that_loses_nothing_measures_in_every_step():
    plant = simulator(noise="clean")
    assert all(plant.step(0.1, None)["odometry"].measured for _ in range(100))


def test_where_a_measurement_is_lost_the_pose_is_the_last_one_and_the_twist_is_new():
    """5 % are lost: none of 300 with a probability of 2e-7."""
    plant, before, lost = simulator(noise="rough", seed=2), None, 0
    for k in range(300):
        odometry = plant.step(0.1, Command(0.1, 0.001 * k))["odometry"]
        assert odometry.twist == ((0.0, 0.0) if k == 0 else (0.1, pytest.approx(0.001 * k)))
        assert odometry.measured or odometry.pose == before
        lost, before = lost + (not odometry.measured), odometry.pose
    assert lost > 0


def test_its_wheels_respect_the_robots_limits():
    plant, robot = simulator(noise="clean"), ROBOTS["burger"]
    plant.step(0.1, None)
    twist = plant.step(0.1, Command(10.0, 10.0))["odometry"].twist
    assert abs(twist.v) + abs(twist.omega) * robot.wheel_separation / 2.0 <= robot.max_wheel * (1.0 + 1e-12)
    assert twist.v == pytest.approx(twist.omega)


def test_episodes_differ_and_can_be_had_again():
    first, again = simulator(seed=3), simulator(seed=3)
    one = [first.step(0.1, None)["odometry"] for _ in range(3)]
    assert one == [again.step(0.1, None)["odometry"] for _ in range(3)]
    first.reset()
    assert first.step(0.1, None)["odometry"] != one[0]


def test_it_starts_where_the_navigation_task_draws_it():
    p = make_parameters(NAV)
    start = Episode(p, seed=5).world.body.true_state
    assert simulator(seed=5, random_start=True).step(0.1, None)["truth"] == start
    assert Pose(*start[:3]) != Pose(0.0, 0.0, 0.0)


@pytest.mark.parametrize("noise", ["rough", "wheel"])
def test_in_mujoco_too_its_steps_are_the_environments_to_the_bit(noise):
    pytest.importorskip("mujoco", reason="needs the extra [mujoco]")
    plant = simulator(noise=noise, seed=7, plant="mujoco", friction=0.5, caster_friction=0.3)
    plant.reset()  # the second episode
    burger = MujocoBurger(friction=0.5, caster_friction=0.3)
    p = make_parameters(replace(NAV, random=False), noise=noise, plant=burger)
    episode = Episode(p, [Pose(0.0, 0.0, 0.0)], seed=7)
    episode.reset()
    plant.step(0.1, None)
    for command in COMMANDS[:50]:
        episode.step(command)
        world, out = episode.world, plant.step(0.1, command)
        assert out == {"truth": world.body.true_state, "odometry": world.senses.odometry}
    assert world.senses.odometry.twist != world.body.command  # it is what the wheels tell
