"""Short names of environments."""

import gymnasium as gym
import pytest

import turtlebot_gym  # noqa: F401
from turtlebot_gym_agents.ids import SHORT, environment_id


def test_every_environment_of_the_package_has_a_short_name():
    ours = {spec.id for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"}
    assert set(SHORT.values()) == ours


@pytest.mark.parametrize("name", ["nav", "Nav", "NAV"])
def test_case_does_not_matter(name):
    assert environment_id(name) == "turtlebot_gym/TurtleBotNav-v0"


@pytest.mark.parametrize("name", ["turtlebot_gym/TurtleBotNav-v0", "CartPole-v1", "module:Own-v0", "navy"])
def test_other_texts_stay(name):
    assert environment_id(name) == name
