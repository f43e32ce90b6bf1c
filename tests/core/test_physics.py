"""Open ground with a physics engine as its plant: the episode around it, alone, in an environment, and in a batch."""

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.systems import Episode, Options, make_parameters, system_of
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import Command, Pose

pytest.importorskip("mujoco")

SLIPPERY = MujocoBurger(friction=0.5, caster_friction=0.3)
NAV = "turtlebot_gym/TurtleBotNav-v0"
ACTIONS = np.random.default_rng(0).uniform([0.0, -0.4], [1.0, 0.4], (60, 2)).astype(np.float32)


def parameters(**options):
    task, waypoints = Options(task="nav").course()
    return make_parameters(task, **{"plant": "mujoco", **options}), waypoints


def driven(episode, actions=ACTIONS):
    """Return all that an episode remembers and tells."""
    return [(episode.act(action.tolist()), episode.world) for action in actions]


@pytest.mark.parametrize("noise", ["rough", "wheel"])
def test_an_episode_depends_on_its_seed_alone(noise):
    p, waypoints = parameters(noise=noise, plant=SLIPPERY)
    alone = driven(Episode(p, waypoints, seed=4))
    after = Episode(p, waypoints, seed=4)
    driven(after, ACTIONS[:7])
    beside, again = Episode(p, waypoints, seed=5), Episode(p, waypoints, seed=4)
    mixed = []
    for action in ACTIONS:
        beside.act(action.tolist())
        mixed.append((again.act(action.tolist()), again.world))
    assert mixed == alone
    after.reset()
    after.number = -1  # the seed's first episode again, after others
    after.reset()
    assert driven(after) == alone
    assert driven(Episode(p, waypoints, seed=5)) != alone
    assert not any(world.body.slipping for world in (Episode(p, waypoints).world, *(world for _, world in alone)))


@pytest.mark.parametrize(
    "options",
    [{"noise": "rough", "filter": "slip"}, {"noise": "wheel", "delay": 1}, {"noise": "documented", "filter": "scale"}],
)
def test_the_environments_are_the_episode(options):
    p, waypoints = parameters(plant=SLIPPERY, **options)
    env = gym.make(NAV, plant=SLIPPERY, **options)
    envs = gym.make_vec(NAV, num_envs=34, vectorization_mode="vector_entry_point", info="full", plant=SLIPPERY, **options)
    env.reset(seed=35)
    envs.reset(seed=2)
    episode = Episode(p, waypoints, seed=35)
    for action in ACTIONS[:20]:
        outcome = episode.act(action.tolist())
        observation, reward, *_, info = env.step(action)
        observations, rewards, *_, infos = envs.step(np.tile(action, (34, 1)))
        world = episode.world
        for seen, told, gained in (
            (observation, info, reward),
            (observations[33], {k: infos[k][33] for k in info}, rewards[33]),
        ):
            np.testing.assert_array_equal(seen, np.array(episode.observe(), np.float32))
            np.testing.assert_array_equal(told["true_state"], world.body.true_state)
            np.testing.assert_array_equal(told["odometry"], world.senses.odometry.pose)
            np.testing.assert_array_equal(told["estimate"], world.estimate.belief.mean)
            assert gained == outcome.reward


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robot": "waffle"}, "robot must be 'burger', 'tutorial' or another one with that track, got 0.287 m"),
        ({"dt": 0.0333}, "must be multiples of MujocoBurger.step"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        gym.make(NAV, **{"plant": "mujoco", **options})


def test_plants_cannot_be_mixed_in_a_batch():
    envs = gym.make_vec(NAV, num_envs=2, vectorization_mode="vector_entry_point", plant="mujoco")
    rows = [turtlebot_gym.make_parameters(plant="mujoco"), turtlebot_gym.make_parameters(plant=SLIPPERY)]
    with pytest.raises(ValueError, match="and so must the plant"):
        envs.unwrapped.set_parameters(rows)
