"""The environments as Gymnasium and Stable-Baselines3 see them."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym.observations.columns import bounds_of

NAV, POSE, SQUARE = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square"))
STRAIGHT = np.array([1.0, 0.0], np.float32)


@pytest.mark.parametrize(
    ("id", "options"),
    [(NAV, {"render_mode": "rgb_array"}), (POSE, {"observation": "truth", "dt": 0.02}), (SQUARE, {"noise": "wheel"})],
)
def test_ids_make_environments_that_the_checkers_of_gymnasium_and_stable_baselines3_accept(id, options):
    scalar, vector = gym.make(id), gym.make_vec(id, num_envs=2)
    assert (type(scalar.unwrapped), type(vector)) == (NavigationEnv, NavigationVectorEnv)
    assert gym.make(f"turtlebot_gym:{id}").spec.id == id
    assert scalar.spec.max_episode_steps == (600 if id == SQUARE else 300)
    low, high = np.array(bounds_of(OPEN_GROUND), np.float32)
    assert scalar.observation_space == vector.single_observation_space == gym.spaces.Box(low, high)
    check_env(gym.make(id, **options).unwrapped, skip_render_check="render_mode" not in options)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(id, **options), warn=True)  # warnings are errors here


SHAPES = {"true_state": (5,), "odometry": (3,), "estimate": (5,), "covariance": (3, 3), "reference": (3,), "command": (2,)}
REWARDS = {"reward_shares": (4,)}
NUMBERS = {"nis": (), "measured": (), "slipping": ()}
"""What only the vector environment tells: the scalar one is as fast as it can be."""


def test_infos_of_the_scalar_environment_are_new_buffers_at_every_step():
    env = gym.make(NAV)
    _, info = env.reset(seed=0)
    for _ in range(3):
        assert {key: np.shape(value) for key, value in info.items()} == SHAPES | REWARDS | {"distance": (), "is_success": ()}
        assert info["distance"] == pytest.approx(np.hypot(*(info["reference"] - info["true_state"][:3])[:2]))
        np.testing.assert_array_equal(info["covariance"], info["covariance"].T)
        before = {key: np.copy(value) for key, value in info.items()}
        _, _, _, _, after = env.step(STRAIGHT)
        for key, value in before.items():
            np.testing.assert_array_equal(info[key], value)
        info = after


@pytest.mark.parametrize(("info", "keys"), [("default", {}), ("rewards", REWARDS), ("full", SHAPES | NUMBERS | REWARDS)])
def test_infos_of_a_vector_environment_have_a_row_for_each(info, keys):
    env = gym.make_vec(NAV, num_envs=4, info=info)
    expected = {key: (4, *shape) for key, shape in {**keys, "distance": (), "is_success": ()}.items()}
    for infos in (env.reset(seed=0)[1], env.step(np.tile(STRAIGHT, (4, 1)))[4]):
        assert {key: value.shape for key, value in infos.items() if not key.startswith("_")} == expected


# Pictures.


def square(n, **options):
    return gym.make_vec(SQUARE, num_envs=n, **{"max_episode_steps": 4, "render_mode": "rgb_array"} | options)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_pictures_are_those_of_the_scalar_environments(mode):
    envs, alone = square(2, autoreset_mode=mode), gym.make(SQUARE, render_mode="rgb_array")
    assert alone.unwrapped.metadata["render_fps"] == envs.metadata["render_fps"] == 10
    ahead = np.tile(STRAIGHT, (2, 1))
    envs.reset(seed=5)
    envs.step(ahead)  # which leaves no trail, since nothing was drawn yet
    envs.reset(seed=5)
    alone.reset(seed=6)
    np.testing.assert_array_equal(envs.render()[1], alone.render())
    for _ in range(3):
        envs.step(ahead)
        alone.step(STRAIGHT)
        np.testing.assert_array_equal(envs.render()[1], alone.render())
    envs.step(ahead)
    if mode is AutoresetMode.NEXT_STEP:
        envs.step(ahead)
    if mode is AutoresetMode.DISABLED:
        envs.reset(options={"reset_mask": np.ones(2, np.bool_)})
    alone.reset()
    np.testing.assert_array_equal(envs.render()[1], alone.render())  # without the trails of the episode before
