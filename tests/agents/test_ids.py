"""Short names of environments."""

import gymnasium as gym
import pytest

import turtlebot_gym  # noqa: F401
from turtlebot_gym_agents.ids import SHORT, arguments_of, environment_id


def test_every_environment_of_the_package_has_a_short_name():
    ours = {spec.id for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"}
    assert set(SHORT.values()) == ours


@pytest.mark.parametrize("name", ["nav", "Nav", "NAV"])
def test_case_does_not_matter(name):
    assert environment_id(name) == "turtlebot_gym/TurtleBotNav-v0"


@pytest.mark.parametrize("name", ["turtlebot_gym/TurtleBotNav-v0", "CartPole-v1", "module:Own-v0", "navy"])
def test_other_texts_stay(name):
    assert environment_id(name) == name


def test_a_study_and_a_training_take_short_names_and_record_the_ids():
    pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
    from turtlebot_gym_agents.cluster.grid import StudyGrid
    from turtlebot_gym_agents.training.config import TrainingConfig

    cells = StudyGrid(policies=("bearing",), grid={"env": ["nav", "Pose"]}, trainings={"ppo": {"seeds": 1}}).cells()
    assert [cell["env"] for cell in cells] == ["turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotPose-v0"]
    assert TrainingConfig(env="ROOMS").record()["config"]["env"] == "turtlebot_gym/TurtleBotRooms-v0"
    assert TrainingConfig(env="rooms") == TrainingConfig(env="turtlebot_gym/TurtleBotRooms-v0")


def test_a_limit_of_steps_of_a_task_is_an_argument_of_the_environment():
    task = {"base": "nav", "max_steps": 50.0}
    assert arguments_of({"task": task, "dt": 0.2}) == {"task": task, "dt": 0.2, "max_episode_steps": 50.0}
    assert arguments_of({"task": "nav"}) == {"task": "nav"}
