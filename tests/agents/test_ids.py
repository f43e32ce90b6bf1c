"""Short names of environments."""

import json

import gymnasium as gym
import pytest

from turtlebot_gym_agents.evaluation.evaluate import driving
from turtlebot_gym_agents.ids import SHORT, arguments_of, environment_id

BROUGHT = {"task": "room", "world": "office", "lidar": "lds02", "robot": "waffle", "noise": "wheel", "dt": 0.2, "delay": 1}
OWN = "turtlebot_gym/Own-v0"


@pytest.fixture
def own():
    """Register an environment with options."""
    entries = {"entry_point": "turtlebot_gym.envs.navigation:NavigationEnv", "max_episode_steps": 300}
    gym.register(OWN, vector_entry_point="turtlebot_gym.envs.vector:make_vector", kwargs=BROUGHT, **entries)
    yield
    del gym.registry[OWN]


def test_every_environment_of_the_package_has_a_short_name_in_any_case():
    ours = {spec.id for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"}
    assert {*map(environment_id, map(str.upper, SHORT))} == ours


def test_a_limit_of_steps_of_a_task_is_an_argument_of_the_environment():
    task = {"base": "nav", "max_steps": 50.0}
    assert arguments_of({"task": task, "dt": 0.2}) == {"task": task, "dt": 0.2, "max_episode_steps": 50.0}
    assert arguments_of({"task": "nav"}) == {"task": "nav"}
    assert arguments_of({"task": None, "fix": None}) == {"fix": None}  # the id's own task


@pytest.mark.parametrize("env", [*SHORT, OWN])
def test_the_id_brings_its_options_into_the_bundle_of_a_run_however_it_is_named(env, own, tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
    from turtlebot_gym_agents.policies.bundle import BundlePolicy
    from turtlebot_gym_agents.training.config import TrainingConfig
    from turtlebot_gym_agents.training.export import export
    from turtlebot_gym_agents.training.model import make_model

    small = {"n_envs": 2, "n_timesteps": 8, "n_steps": 4, "batch_size": 8, "policy_kwargs": {"net_arch": [8]}}
    config = TrainingConfig(env=env, config=small)
    envs = config.make_training()
    make_model(config, envs).save(tmp_path / "best.zip")
    (tmp_path / "config.json").write_text(json.dumps(config.record()))
    brought = BROUGHT if env == OWN else {}
    for name in (None, env, config.env):
        export(tmp_path / "best.zip", tmp_path / "bundle.onnx", env=name, allow_pickle=True, steps=5)
        card = BundlePolicy(tmp_path / "bundle.onnx").card
        assert (card.robot["name"], card.noise) == (brought.get("robot", "burger"), brought.get("noise", "tutorial"))
        with driving(str(tmp_path / "bundle.onnx"), config.env, 1):
            pass  # it drives where it was trained
