"""Our vector environments keep Gymnasium's contract, by the checker in the folder `checker/`."""

from functools import partial

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode

from gymnasium_vector_checker import check_vector_env


@pytest.mark.parametrize("info", ["default", "full"])
@pytest.mark.parametrize("name", ["Nav", "Pose", "Square"])
def test_every_id_keeps_the_contract_in_every_mode(name, info):
    make = partial(gym.make_vec, f"turtlebot_gym/TurtleBot{name}-v0", info=info, noise="rough")
    assert check_vector_env(make) == tuple(AutoresetMode)


def test_a_batch_of_several_tiles_keeps_the_contract():
    check_vector_env(partial(gym.make_vec, "turtlebot_gym/TurtleBotNav-v0", info="full"), num_envs=35, steps=16)
