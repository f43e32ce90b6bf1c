"""The environments as Gymnasium and Stable-Baselines3 see them."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as RecordVectorVideo

from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.parameters import Reward
from turtlebot_gym.presets import make_robot
from turtlebot_gym.tasks import OBSERVATION_HIGH, OBSERVATION_LOW

NAV = "turtlebot_gym/TurtleBotNav-v0"
IDS = [NAV, "turtlebot_gym/TurtleBotPose-v0", "turtlebot_gym/TurtleBotSquare-v0"]
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
STRAIGHT = np.array([1.0, 0.0], np.float32)


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("options", [{}, {"noise": "wheel"}, {"observation": "truth", "dt": 0.02}], ids=str)
def test_gymnasiums_checker_is_content(id, options):
    # Warnings are errors here.
    check_env(gym.make(id, **options).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("id", IDS)
def test_stable_baselines3s_checker_is_content(id):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(id), warn=True)


def test_render_modes_pass_gymnasiums_checker(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    check_env(gym.make(NAV, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("id", IDS)
def test_ids_make_both_environments(id):
    scalar, vector = gym.make(id), gym.make_vec(id, num_envs=2)
    assert isinstance(scalar.unwrapped, NavigationEnv)
    assert isinstance(vector, NavigationVectorEnv)
    assert gym.make(f"turtlebot_gym:{id}").spec.id == id
    assert scalar.spec.max_episode_steps == (600 if "Square" in id else 300)
    assert scalar.observation_space == vector.single_observation_space
    assert scalar.observation_space.shape == (13,)
    assert scalar.observation_space.dtype == np.float32
    np.testing.assert_array_equal(scalar.observation_space.low, np.array(OBSERVATION_LOW, np.float32))
    np.testing.assert_array_equal(scalar.observation_space.high, np.array(OBSERVATION_HIGH, np.float32))


SHAPES = {
    "true_state": (5,), "odometry": (3,), "estimate": (5,), "covariance": (5, 5), "reference": (3,), "command": (2,),
}  # fmt: skip


NUMBERS = {"nis": (), "measured": (), "slipping": ()}
"""What only the vector environment tells: the scalar one is as fast as it can be."""


def test_scalar_info():
    env = gym.make(NAV)
    _, info = env.reset(seed=0)
    for _ in range(3):
        assert {key: np.shape(info[key]) for key in SHAPES} == SHAPES
        assert type(info["distance"]) is float
        assert type(info["is_success"]) is bool
        assert set(info) == {*SHAPES, "distance", "is_success"}
        assert info["distance"] == pytest.approx(np.hypot(*(info["reference"] - info["true_state"][:3])[:2]))
        np.testing.assert_array_equal(info["covariance"], info["covariance"].T)
        before = {key: np.copy(value) for key, value in info.items()}
        _, _, _, _, after = env.step(STRAIGHT)
        for key, value in before.items():
            np.testing.assert_array_equal(info[key], value)  # a new buffer at every step
        info = after


def test_vector_info():
    default, full = (gym.make_vec(NAV, num_envs=4, info=info) for info in ("default", "full"))
    for env, keys in ((default, {}), (full, SHAPES | NUMBERS)):
        expected = {**{key: (4, *shape) for key, shape in keys.items()}, "distance": (4,), "is_success": (4,)}
        _, infos = env.reset(seed=0)
        for _ in range(2):
            assert {key: value.shape for key, value in infos.items() if not key.startswith("_")} == expected
            infos = env.step(np.tile(STRAIGHT, (4, 1)))[4]


@pytest.mark.parametrize("info", ["default", "full"])
def test_infos_of_a_partial_reset_cover_only_the_rows_that_were_reset(info):
    env = gym.make_vec(NAV, num_envs=3, info=info)
    env.reset(seed=0)
    _, infos = env.reset(options={"reset_mask": np.array([False, True, False])})
    for key, value in infos.items():
        if key.startswith("_"):
            assert value.tolist() == [False, True, False]
        else:
            assert not value[[0, 2]].any()
    assert infos["distance"][1] > 0.0


def test_same_step_returns_final_observations_as_gymnasium_does():
    def sync(limit):
        return gym.make_vec(
            NAV, 4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": SAME_STEP}, max_episode_steps=limit
        )

    native, theirs = gym.make_vec(NAV, num_envs=4, autoreset_mode=SAME_STEP, max_episode_steps=5), sync(5)
    ends = 0
    for env in (native, theirs):
        env.reset(seed=0)
    mask = np.array([False, True, False, True])
    for step in range(14):
        if step == 2:
            for env in (native, theirs):
                env.reset(options={"reset_mask": mask.copy()})
        actions = np.full((4, 2), 0.1 * step, np.float32)
        infos, expected = native.step(actions)[4], theirs.step(actions)[4]
        assert ("final_obs" in infos) == ("final_obs" in expected)
        if "final_obs" in infos:
            assert infos["final_obs"].dtype == expected["final_obs"].dtype == object
            for one, other in zip(infos["final_obs"], expected["final_obs"], strict=True):
                assert (one is None) == (other is None)
                if one is not None:
                    ends += 1
                    assert one.dtype == np.float32
                    np.testing.assert_array_equal(one, other)
    assert ends == 8  # rows 0 and 2 after steps 5 and 10, the others after 7 and 12


@pytest.mark.parametrize("seed", [0, 2**31 - 1, 2**63 - 2, 2**80])
def test_seeds_of_any_size_count_up_from_row_to_row(seed):
    many = gym.make_vec(NAV, num_envs=3)
    observations, _ = many.reset(seed=seed)
    for i in range(3):
        if seed + i < 2**63:  # larger ones are cut
            np.testing.assert_array_equal(gym.make(NAV).reset(seed=seed + i)[0], observations[i])
    assert len(np.unique(observations, axis=0)) == 3


def test_unseeded_environments_differ():
    starts = [gym.make(NAV).reset()[0] for _ in range(3)] + list(gym.make_vec(NAV, num_envs=3).reset()[0])
    assert len(np.unique(starts, axis=0)) == 6


def test_episodes_of_a_seed_differ_and_can_be_repeated():
    env = gym.make(NAV)
    first = [env.reset(seed=4)[0], *(env.reset()[0] for _ in range(3))]
    again = [env.reset(seed=4)[0], *(env.reset()[0] for _ in range(3))]
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first, axis=0)) == 4


@pytest.mark.parametrize("gain", [0.3, 1.0])
def test_the_progress_of_a_course_is_its_length_whichever_way_it_was_driven(gain):
    only = Reward(progress=1.0, time=0.0, effort=0.0, success=0.0)
    env = gym.make("turtlebot_gym/TurtleBotSquare-v0", reward=only)
    observation, info = env.reset(seed=0)
    length = info["distance"] + 3 * 2.0
    progress, terminated = 0.0, False
    while not terminated:
        action = np.array([max(observation[1], 0.0), gain * np.arctan2(observation[2], observation[1])], np.float32)
        observation, reward, terminated, truncated, info = env.step(np.clip(action, -1.0, 1.0))
        assert not truncated
        progress += reward * make_robot("burger").max_linear * 0.1
    assert progress == pytest.approx(length - info["distance"], abs=1e-9)


def square(n, **options):
    options = {"autoreset_mode": NEXT_STEP, "max_episode_steps": 4, "render_mode": "rgb_array"} | options
    return gym.make_vec("turtlebot_gym/TurtleBotSquare-v0", num_envs=n, **options)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_pictures_are_those_of_the_scalar_environments(mode, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    envs, alone = square(2, autoreset_mode=mode), gym.make("turtlebot_gym/TurtleBotSquare-v0", render_mode="rgb_array")
    assert alone.unwrapped.metadata["render_fps"] == envs.metadata["render_fps"] == 10
    envs.reset(seed=5)
    envs.step(np.tile(STRAIGHT, (2, 1)))  # which leaves no trail, since nothing was drawn yet
    envs.reset(seed=5)
    alone.reset(seed=6)
    np.testing.assert_array_equal(envs.render()[1], alone.render())
    for _ in range(3):
        envs.step(np.tile(STRAIGHT, (2, 1)))
        alone.step(STRAIGHT)
        np.testing.assert_array_equal(envs.render()[1], alone.render())
    envs.step(np.tile(STRAIGHT, (2, 1)))
    if mode is NEXT_STEP:
        envs.step(np.tile(STRAIGHT, (2, 1)))
    if mode is DISABLED:
        envs.reset(options={"reset_mask": np.ones(2, np.bool_)})
    alone.reset()
    np.testing.assert_array_equal(envs.render()[1], alone.render())  # without the trails of the episode before


def test_a_reset_of_one_row_leaves_the_trails_of_the_others():
    envs = square(2, max_episode_steps=50)
    envs.reset(seed=0)
    for _ in range(5):
        before = envs.render()
        envs.step(np.tile(STRAIGHT, (2, 1)))
    before = envs.render()
    envs.reset(seed=[None, 1], options={"reset_mask": np.array([False, True])})
    after = envs.render()
    np.testing.assert_array_equal(after[0], before[0])
    assert (after[1] != before[1]).any()


def test_the_first_rows_are_drawn_the_smaller_where_they_are_many():
    for rows, number, shape in ((2, 2, (704, 640, 3)), (4, 4, (704, 640, 3)), (5, 5, (352, 320, 3)), (99, 6, (352, 320, 3))):
        envs = square(6, render_rows=rows)
        envs.reset(seed=0)
        pictures = envs.render()
        assert isinstance(pictures, tuple)
        assert [(picture.shape, picture.dtype) for picture in pictures] == [(shape, np.uint8)] * number
    envs.close()
    assert len(gym.make_vec(NAV, num_envs=12, render_mode="rgb_array").unwrapped._pictures._renderers) == 0  # no pygame yet


def test_other_parameters_are_drawn():
    envs = square(1)
    envs.reset(seed=0)
    (burger,) = envs.render()
    p = envs.unwrapped.parameters
    envs.unwrapped.set_parameters(p._replace(robot=make_robot("waffle")))
    assert (envs.render()[0] != burger).any()


@pytest.mark.parametrize("record", [RecordVideo, RecordVectorVideo])
def test_gymnasium_records_videos(tmp_path, monkeypatch, record):
    pytest.importorskip("moviepy")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    folder = tmp_path / "films"
    env = gym.make(NAV, render_mode="rgb_array", max_episode_steps=4) if record is RecordVideo else square(3)
    env = record(env, str(folder), episode_trigger=lambda episode: True)
    env.reset(seed=0)
    for step in range(7):
        if record is RecordVideo and step == 4:
            env.reset()
        env.step(np.zeros(env.action_space.shape, np.float32))
    env.close()
    films = sorted(folder.glob("*.mp4"))
    assert len(films) == 2
    assert min(film.stat().st_size for film in films) > 1000
