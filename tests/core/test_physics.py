"""Open ground with a physics engine as its plant: what the episode around it reads and obeys."""

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym
from turtlebot_gym.heart import Episode
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.systems import Options, make_parameters, system_of
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import Command, Pose

pytest.importorskip("mujoco")

SLIPPERY = MujocoBurger(friction=0.5, caster_friction=0.3)
NAV = "turtlebot_gym/TurtleBotNav-v0"


def parameters(**options):
    task, waypoints = Options(task="nav").course()
    return make_parameters(task, **{"plant": "mujoco", **options}), waypoints


def test_without_noise_the_odometry_is_the_truth_and_on_wheels_what_they_have_rolled():
    for noise in ("clean", "wheel"):
        p, waypoints = parameters(noise=noise, plant=SLIPPERY)
        episode = Episode(p, waypoints, seed=1)
        for _ in range(50):
            episode.act((1.0, 0.1))
        body, odometry = episode.world.body, episode.world.senses.odometry
        assert odometry.pose == (body.wheels if noise == "wheel" else body.true_state[:3])
        assert odometry.twist == body.twist == pytest.approx(body.command, rel=0.03)
        assert np.hypot(body.wheels.x - body.true_state.x, body.wheels.y - body.true_state.y) > 0.05


def test_commands_obey_the_robots_limits_and_the_delay():
    episodes = [
        Episode(make_parameters(SQUARE, noise="clean", plant=plant, delay=2), SQUARE_WAYPOINTS)
        for plant in ("mujoco", "unicycle")
    ]
    for _ in range(6):
        for episode in episodes:
            episode.step(Command(0.5, 1.0))
        assert episodes[0].world.body.command == episodes[1].world.body.command
        assert episodes[0].world.body.asked == episodes[1].world.body.asked


def test_where_it_grips_it_is_the_unicycle_within_a_few_centimetres():
    poses = []
    for plant in ("mujoco", "unicycle"):
        episode = Episode(make_parameters(SQUARE, noise="clean", plant=plant, integrator="midpoint"), SQUARE_WAYPOINTS)
        for k in range(100):
            episode.step(Command(0.15, 0.5 if k % 40 < 20 else -0.5))
        poses.append(Pose(*episode.world.body.true_state[:3]))
    np.testing.assert_allclose(*poses, atol=0.03)


def test_one_system_serves_all_of_a_kind():
    p, _ = parameters()
    assert system_of(p) is system_of(parameters(noise="rough")[0])
    assert not system_of(p).compiled
    assert system_of(p) is not system_of(parameters(plant=SLIPPERY)[0])
    assert system_of(make_parameters()).compiled


def test_plants_cannot_be_mixed_in_a_batch():
    envs = gym.make_vec(NAV, num_envs=2, vectorization_mode="vector_entry_point", plant="mujoco")
    rows = [turtlebot_gym.make_parameters(plant="mujoco"), turtlebot_gym.make_parameters(plant=SLIPPERY)]
    with pytest.raises(ValueError, match="and so must the plant"):
        envs.unwrapped.set_parameters(rows)
