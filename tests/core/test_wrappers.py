"""Wrappers: worked out by hand over a scripted environment, and row by row equal, scalar and vector, in every mode."""

from dataclasses import replace
from functools import partial, reduce

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation

from gymnasium_vector_checker import check_vector_env
from gymnasium_vector_checker.runs import Case
from turtlebot_gym import make_filter, make_noise, wrappers
from turtlebot_gym.wrappers import vector

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"


class Echo(gym.Env):
    """Observes twice the action, and tells how many steps there were."""

    def __init__(self):
        self.observation_space = spaces.Box(-2.0, 2.0, (1,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.at = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = 0
        return np.zeros(1, np.float32), {"at": 0}

    def step(self, action):
        self.at += 1
        return 2.0 * action, 5.0, self.at == 3, False, {"at": self.at}


def brisk(it):
    """Progress, less what the turning costs."""
    turning = np.abs(it.action[..., 1])
    return it.before.info["distance"] - it.after.info["distance"] - 0.1 * turning + it.after.info["true_state"][..., 3]


PAIRS = {
    name: (partial(scalar, **options), partial(many, **options))
    for name, scalar, many, options in (
        ("reward", wrappers.TransitionReward, vector.TransitionReward, {"reward": brisk}),
        ("smooth", wrappers.SmoothAction, vector.SmoothAction, {"share": 0.3}),
        ("stack", FrameStackObservation, vector.FrameStackObservation, {"stack_size": 3}),
        ("zeros", FrameStackObservation, vector.FrameStackObservation, {"stack_size": 2, "padding_type": "zero"}),
    )
}


def native(wrap, *, num_envs, autoreset_mode, max_episode_steps, id=NAV):
    options = {"max_episode_steps": max_episode_steps, "autoreset_mode": autoreset_mode, "info": "full"}
    return wrap(gym.make_vec(id, num_envs=num_envs, **options))


def rows(wrap, *, num_envs, autoreset_mode, max_episode_steps, id=NAV, around=lambda envs: envs):
    made = [lambda: wrap(gym.make(id, max_episode_steps=max_episode_steps))] * num_envs
    return around(SyncVectorEnv(made, autoreset_mode=autoreset_mode))


def play(make, mode):
    """Return what happens to each row in some episodes, one of which is broken off, but for infos."""
    events = Case(make, mode, 3, 24, 7).play(11)
    assert min(sum(event.kind == "reset" for event in row) for row in events) >= 3
    return [[event._replace(info={}) for event in row] for row in events]


def same(seen, expected):
    for row, other in zip(seen, expected, strict=True):
        for first, second in zip(row, other, strict=False):
            np.testing.assert_array_equal(first.observation, second.observation)
            assert first[2:] == second[2:]


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", PAIRS)
def test_a_row_is_the_scalar_environments(name, mode):
    scalar, many = PAIRS[name]
    expected = play(partial(rows, scalar), mode)
    same(play(partial(native, many), mode), expected)
    same(play(partial(rows, lambda env: env, around=many), mode), expected)  # around any vector environment


@pytest.mark.parametrize("name", ["reward", "stack"])
def test_rooms_are_wrapped_too(name):
    scalar, many = PAIRS[name]
    expected = play(partial(rows, scalar, id=ROOMS), AutoresetMode.SAME_STEP)
    same(play(partial(native, many, id=ROOMS), AutoresetMode.SAME_STEP), expected)


@pytest.mark.sample(2)
@pytest.mark.parametrize("names", [*((name,) for name in PAIRS), ("smooth", "reward", "stack")], ids=str)
def test_wrapped_environments_keep_the_contract_each_and_all_together(names):
    def make(num_envs, **options):
        return reduce(lambda envs, name: PAIRS[name][1](envs), names, native(lambda envs: envs, num_envs=num_envs, **options))

    check_vector_env(make, steps=16)


@pytest.mark.parametrize(("share", "seen"), [(0.5, [1.0, 1.5, -0.25]), (1.0, [2.0, 2.0, -2.0])])
def test_smoothed_actions_by_hand(share, seen):
    env, up = wrappers.SmoothAction(Echo(), share), np.ones(1, np.float32)
    for _ in range(2):
        env.reset()
        assert [env.step(action)[0].item() for action in (up, up, -up)] == seen


def test_rewards_by_hand():
    seen = []

    def reward(it):
        seen.append(it)
        return it.after.info["at"] - 10 * it.before.info["at"] + it.reward + it.action[..., 0] + 100 * it.terminated

    env = wrappers.TransitionReward(Echo(), reward)
    for _ in range(2):
        env.reset()
        rewards = [env.step(np.array([0.5], np.float32))[1] for _ in range(3)]
        assert rewards == [1 + 5 + 0.5, 2 - 10 + 5 + 0.5, 3 - 20 + 5 + 0.5 + 100]
        assert all(type(reward) is float for reward in rewards)
    assert seen[1].before.observation == seen[0].after.observation == 1.0


def test_a_wrapped_scalar_environment_is_made_again_from_its_specification():
    env = wrappers.SmoothAction(gym.make(NAV), 0.25)
    assert isinstance(gym.make(env.spec), wrappers.SmoothAction)


def envs():
    return gym.make_vec(NAV, num_envs=2)


SHARE = "share must be a number above 0 and at most 1"


def stepped(reward):
    many = vector.TransitionReward(envs(), reward)
    many.reset()
    many.step(np.zeros((2, 2), np.float32))


@pytest.mark.parametrize(
    ("wrap", "message"),
    [
        (lambda: wrappers.SmoothAction(Echo(), 0.0), f"{SHARE}, got 0.0"),
        (lambda: vector.SmoothAction(envs(), 1.5), f"{SHARE}, got 1.5"),
        (lambda: wrappers.SmoothAction(gym.make("CartPole-v1"), 0.5), "The action space must be a Box, got Discrete"),
        (lambda: vector.FrameStackObservation(envs(), 0), "stack_size must be a whole number of at least 1, got 0"),
        (lambda: vector.FrameStackObservation(envs(), 2, padding_type="one"), "padding_type must be one of 'reset', 'zero'"),
        (lambda: stepped(lambda it: 1.0), r"reward must return shape \(2,\), got \(\)"),
        (lambda: stepped(brisk), "info has no 'true_state'; vector environments tell more with info='full'"),
    ],
)
def test_arguments_of_wrappers_are_refused_in_one_line_with_the_remedy(wrap, message):
    with pytest.raises((ValueError, KeyError), match=f"{message}[^\n]*$"):
        wrap()


def test_the_doubts_of_a_filters_model_are_in_info():
    """Partner: they say nothing where the filter's noise is that of the environment."""
    noise = make_noise("documented")
    small = replace(noise, odometry=replace(noise.odometry, R=tuple(0.1 * R for R in noise.odometry.R)))
    for assumed, expected in ((noise, ""), (small, "is R too small")):
        env = wrappers.ModelDoubts(gym.make(NAV, noise=noise, filter=make_filter("matched", assumed)), assumed)
        _, info = env.reset(seed=1)
        assert info["doubt"] == ""
        for _ in range(60):
            *_, info = env.step(np.full(2, 0.3, np.float32))
        assert expected in info["doubt"]
        assert bool(info["doubt"]) is bool(expected)
        assert (info["mean_nis"] > 6.0) is (info["position_misfit"] > 3.0) is bool(expected)
    with pytest.raises(ValueError, match="scalar environment of turtlebot_gym"):
        wrappers.ModelDoubts(gym.make("CartPole-v1"))
