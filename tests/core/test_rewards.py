"""Rewards: their shares add up, weights and terms of one's own count everywhere, and what would not count is refused."""

import gymnasium as gym
import numpy as np
import own_parts
import pytest

from turtlebot_gym import Options
from turtlebot_gym.rewards import IN_ROOMS, ON_GROUND, ON_MISSIONS

TASKS = {"Nav": ON_GROUND, "Square": ON_GROUND, "Rooms": IN_ROOMS, "Missions": ON_MISSIONS}
SPIN = {"own_parts:SPIN": 100.0}
NUMBER, STEPS = 3, 40


def rewards(task, **options):
    """Return rewards and infos of a drive, of the scalar environment and of the first row of the vector one."""
    drives = []
    rng = np.random.default_rng(4)
    actions = rng.uniform(-1.0, 1.0, (STEPS, 2)).astype(np.float32)
    env = gym.make(f"turtlebot_gym/TurtleBot{task}-v0", **options)
    envs = gym.make_vec(f"turtlebot_gym/TurtleBot{task}-v0", num_envs=NUMBER, info="full", **options)
    for made in (env, envs):
        made.reset(seed=3)
        rows = []
        for action in actions:
            _, reward, _, _, info = made.step(action if made is env else np.tile(action, (NUMBER, 1)))
            shares, reward = (info["reward_shares"], reward) if made is env else (info["reward_shares"][0], reward[0])
            rows.append((float(reward), dict(zip(made.unwrapped.reward_terms, map(float, shares), strict=True))))
        drives.append(rows)
    assert drives[0] == drives[1]
    return drives[0]


@pytest.mark.parametrize("task", TASKS)
def test_the_shares_add_up_to_the_reward_in_the_order_of_the_terms(task):
    for reward, shares in rewards(task):
        assert list(shares) == [term.name for term in TASKS[task]]
        total = 0.0
        for share in shares.values():
            total += share
        assert reward == total


@pytest.mark.parametrize("task", ["Nav", "Rooms"])
def test_a_term_of_ones_own_adds_its_share_and_nothing_else(task):
    spun = 0.0
    for (plain, _), (reward, shares) in zip(rewards(task), rewards(task, reward=SPIN), strict=True):
        assert reward == plain + shares["spin"]
        spun += shares["spin"]
    assert spun < -1.0


def test_a_system_of_ones_own_brings_its_terms():
    options = {"system": own_parts.system_with_spin, "reward": {"spin": 7.0}}
    setup = Options(**options).setup()
    assert setup.parameters.reward._asdict() == {"progress": 1.0, "time": 0.1, "effort": 0.01, "success": 10.0, "spin": 7.0}
    assert rewards("Nav", **options) == rewards("Nav", reward={"own_parts:SPIN": 7.0})


def test_a_term_of_a_room_is_refused_on_open_ground():
    with pytest.raises(ValueError, match=r"reward on open ground .* must be one of .* got 'nearness'"):
        gym.make("turtlebot_gym/TurtleBotNav-v0", reward={"nearness": 1.0})
