"""The environments as Gymnasium and Stable-Baselines3 see them."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordVideo

from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym.presets import make_robot

NAV, POSE, SQUARE = IDS = [f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square")]
STRAIGHT = np.array([1.0, 0.0], np.float32)


@pytest.fixture(autouse=True)
def headless(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.sample(3)
@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("options", [{"render_mode": "rgb_array"}, {"noise": "wheel"}, {"observation": "truth", "dt": 0.02}])
def test_the_checkers_of_gymnasium_and_stable_baselines3_are_content(id, options):
    # Warnings are errors here.
    check_env(gym.make(id, **options).unwrapped, skip_render_check="render_mode" not in options)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(id, **options), warn=True)


@pytest.mark.parametrize("id", IDS)
def test_ids_make_both_environments(id):
    scalar, vector = gym.make(id), gym.make_vec(id, num_envs=2)
    assert isinstance(scalar.unwrapped, NavigationEnv)
    assert isinstance(vector, NavigationVectorEnv)
    assert gym.make(f"turtlebot_gym:{id}").spec.id == id
    assert scalar.spec.max_episode_steps == (600 if id == SQUARE else 300)
    assert scalar.observation_space == vector.single_observation_space
    assert (scalar.observation_space.shape, scalar.observation_space.dtype) == ((13,), np.float32)
    low, high = np.array(bounds_of(OPEN_GROUND), np.float32)
    np.testing.assert_array_equal(scalar.observation_space.low, low)
    np.testing.assert_array_equal(scalar.observation_space.high, high)


SHAPES = {
    "true_state": (5,),
    "odometry": (3,),
    "estimate": (5,),
    "covariance": (3, 3),
    "reference": (3,),
    "command": (2,),
}
NUMBERS = {"nis": (), "measured": (), "slipping": ()}
"""What only the vector environment tells: the scalar one is as fast as it can be."""


def test_infos_of_the_scalar_environment_are_new_buffers_at_every_step():
    env = gym.make(NAV)
    _, info = env.reset(seed=0)
    for _ in range(3):
        assert {key: np.shape(info[key]) for key in SHAPES} == SHAPES
        assert (type(info["distance"]), type(info["is_success"])) == (float, bool)
        assert set(info) == {*SHAPES, "distance", "is_success", "reward_shares"}
        assert info["distance"] == pytest.approx(np.hypot(*(info["reference"] - info["true_state"][:3])[:2]))
        np.testing.assert_array_equal(info["covariance"], info["covariance"].T)
        before = {key: np.copy(value) for key, value in info.items()}
        _, _, _, _, after = env.step(STRAIGHT)
        for key, value in before.items():
            np.testing.assert_array_equal(info[key], value)
        info = after


REWARDS = {"reward_shares": (4,)}


@pytest.mark.parametrize(("info", "keys"), [("default", {}), ("rewards", REWARDS), ("full", SHAPES | NUMBERS | REWARDS)])
def test_infos_of_a_vector_environment_have_a_row_for_each(info, keys):
    env = gym.make_vec(NAV, num_envs=4, info=info)
    expected = {key: (4, *shape) for key, shape in {**keys, "distance": (), "is_success": ()}.items()}
    for infos in (env.reset(seed=0)[1], env.step(np.tile(STRAIGHT, (4, 1)))[4]):
        assert {key: value.shape for key, value in infos.items() if not key.startswith("_")} == expected


@pytest.mark.parametrize("gain", [0.3, 1.0])
def test_the_progress_of_a_course_is_its_length_whichever_way_it_was_driven(gain):
    env = gym.make(SQUARE, reward={"time": 0.0, "effort": 0.0, "success": 0.0})
    observation, info = env.reset(seed=0)
    length = info["distance"] + 3 * 2.0
    progress, terminated = 0.0, False
    while not terminated:
        action = np.array([max(observation[1], 0.0), gain * np.arctan2(observation[2], observation[1])], np.float32)
        observation, reward, terminated, truncated, info = env.step(np.clip(action, -1.0, 1.0))
        assert not truncated
        progress += reward * make_robot("burger").max_linear * 0.1
    assert progress == pytest.approx(length - info["distance"], abs=1e-9)


# Pictures.


def square(n, **options):
    options = {"autoreset_mode": AutoresetMode.NEXT_STEP, "max_episode_steps": 4, "render_mode": "rgb_array"} | options
    return gym.make_vec(SQUARE, num_envs=n, **options)


def ahead(envs):
    return envs.step(np.tile(STRAIGHT, (envs.num_envs, 1)))


@pytest.mark.parametrize("mode", AutoresetMode)
def test_pictures_are_those_of_the_scalar_environments(mode):
    envs, alone = square(2, autoreset_mode=mode), gym.make(SQUARE, render_mode="rgb_array")
    assert alone.unwrapped.metadata["render_fps"] == envs.metadata["render_fps"] == 10
    envs.reset(seed=5)
    ahead(envs)  # which leaves no trail, since nothing was drawn yet
    envs.reset(seed=5)
    alone.reset(seed=6)
    np.testing.assert_array_equal(envs.render()[1], alone.render())
    for _ in range(3):
        ahead(envs)
        alone.step(STRAIGHT)
        np.testing.assert_array_equal(envs.render()[1], alone.render())
    ahead(envs)
    if mode is AutoresetMode.NEXT_STEP:
        ahead(envs)
    if mode is AutoresetMode.DISABLED:
        envs.reset(options={"reset_mask": np.ones(2, np.bool_)})
    alone.reset()
    np.testing.assert_array_equal(envs.render()[1], alone.render())  # without the trails of the episode before


def test_a_reset_of_one_row_leaves_the_trails_of_the_others_and_other_parameters_are_drawn():
    envs = square(2, max_episode_steps=50)
    envs.reset(seed=0)
    for _ in range(5):
        envs.render()
        ahead(envs)
    before = envs.render()
    envs.reset(seed=[None, 1], options={"reset_mask": np.array([False, True])})
    after = envs.render()
    np.testing.assert_array_equal(after[0], before[0])
    assert (after[1] != before[1]).any()
    envs.unwrapped.set_parameters(envs.unwrapped.parameters._replace(robot=make_robot("waffle")))
    assert (envs.render()[0] != after[0]).any()


@pytest.mark.parametrize("record", [RecordVideo, getattr(gym.wrappers.vector, "RecordVideo", None)])
def test_gymnasium_records_videos(tmp_path, record):
    pytest.importorskip("moviepy")
    if record is None:
        pytest.skip("this Gymnasium has no RecordVideo for vectors of environments")
    env = gym.make(NAV, render_mode="rgb_array", max_episode_steps=4) if record is RecordVideo else square(3)
    env = record(env, str(tmp_path / "films"), episode_trigger=lambda episode: True)
    env.reset(seed=0)
    for step in range(7):
        if record is RecordVideo and step == 4:
            env.reset()
        env.step(np.zeros(env.action_space.shape, np.float32))
    env.close()
    films = list((tmp_path / "films").glob("*.mp4"))
    assert len(films) == 2
    assert min(film.stat().st_size for film in films) > 1000
