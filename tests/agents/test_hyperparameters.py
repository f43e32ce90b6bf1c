"""Hyper-parameters: the form of rl-baselines3-zoo, nothing in it that runs, and Stable-Baselines3's own checks in one line."""

import re

import numpy as np
import pytest
import torch
import yaml

from turtlebot_gym_agents.policies.named import shipped_folder
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.hyperparameters import ROLLOUTS, arguments, load
from turtlebot_gym_agents.training.model import make_model

TASKS = ["turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotPose-v0", "turtlebot_gym/TurtleBotSquare-v0"]
SHIPPED = sorted(path.stem for path in shipped_folder("configs").glob("*.yaml"))
NEEDED = {"n_envs": 2, "n_timesteps": 16, "policy": "MlpPolicy"}


def made(algo="ppo", **given):
    """Return the keyword arguments of an algorithm."""
    return arguments(load(algo, TASKS[0], NEEDED | given))


@pytest.mark.parametrize("algo", SHIPPED)
def test_shipped_files_are_read_for_any_environment_and_mean_the_same_to_the_zoo(algo):
    """rl-baselines3-zoo evaluates text under ``policy_kwargs`` with ``nn`` in scope, and splits rates at their underscore."""
    assert load(algo, "somebody/Else-v3")["n_envs"] > 0  # the default's
    for env in TASKS:
        hyper = load(algo, env)
        assert load(algo, env, hyper) == hyper
        theirs = yaml.safe_load((shipped_folder("configs") / f"{algo}.yaml").read_text())[env]["policy_kwargs"]
        network = eval(theirs, {"nn": torch.nn}) if isinstance(theirs, str) else theirs
        assert network == arguments(hyper)["policy_kwargs"]


def test_names_become_objects():
    values = {
        "learning_rate": "lin_0.002",
        "clip_range": 0.1,
        "n_steps": 8,
        "policy_kwargs": {"activation_fn": "nn.Tanh", "net_arch": [8]},
    }
    ppo = made(**values)
    assert [ppo["learning_rate"](remaining) for remaining in (1.0, 0.5, 0.0, -0.1)] == [0.002, 0.001, 0.0, 0.0]
    assert (ppo["clip_range"], ppo["n_steps"]) == (0.1, 8)
    assert ppo["policy_kwargs"] == {"activation_fn": torch.nn.Tanh, "net_arch": [8]}
    assert values["policy_kwargs"]["activation_fn"] == "nn.Tanh"  # the argument is not changed
    assert not {"n_envs", "n_timesteps", "policy"} & set(ppo)
    assert made("sac", train_freq=[4, "step"])["train_freq"] == (4, "step")
    noise = made("td3", noise_type="normal", noise_std=0.3)["action_noise"]
    assert np.std([noise() for _ in range(2000)]) == pytest.approx(0.3, rel=0.1)


MAPPING = "policy_kwargs must be a mapping, or text like"
MODULE = "policy_kwargs.activation_fn must be a class of torch.nn"
REFUSED = "Stable-Baselines3 refuses the hyper-parameters of ppo, see --config: "


@pytest.mark.parametrize(
    ("algo", "given", "message"),
    [
        ("dreamer", {}, "algo must be one of 'a2c', 'ddpg', 'ppo', 'sac', 'td3', got 'dreamer'"),
        ("ppo", {"n_envs": True}, "n_envs must be a whole number from 1"),
        ("ppo", {"tau": 0.1}, f"{REFUSED}"),
        ("ppo", {"policy_kwargs": 3}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(net_arch=[open('x')])"}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(activation_fn=os.system)"}, f"{MODULE}, got 'system'"),
        ("ppo", {"policy_kwargs": {"net_arc": [8]}}, f"{REFUSED}"),
        ("ppo", {"reward_scale": 0}, "reward_scale must be a positive number"),
    ],
    ids=str,
)
def test_a_refusal_is_one_line_that_names_the_setting(algo, given, message):
    def make():
        config = TrainingConfig(algo=algo, config=NEEDED | given)
        make_model(config, config.make_training())

    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        make()
    assert "\n" not in str(refusal.value)


def test_overrides_replace_hyper_parameters_nested_ones_too():
    shipped = TrainingConfig(env="nav")
    assert shipped.env == TASKS[0]
    overrides = {"learning_rate": 3e-4, "policy_kwargs": {"net_arch": [8], "optimizer_kwargs": {"weight_decay": 0.1}}}
    config = TrainingConfig(overrides=overrides)
    network = {**shipped.hyper["policy_kwargs"], "net_arch": [8], "optimizer_kwargs": {"weight_decay": 0.1}}
    assert config.hyper == {**shipped.hyper, "learning_rate": 3e-4, "policy_kwargs": network}
    assert config.record()["config"]["overrides"] == overrides
    assert config.record()["hyperparameters"] == config.hyper
    assert shipped.hyper["policy_kwargs"]["net_arch"] == [64, 64]


def test_few_steps_are_divided_among_fewer_environments_in_smaller_batches():
    for env in TASKS:
        whole = load("ppo", env)
        for steps in (1, 5_000, 20_000, 40_960, 300_000, whole["n_timesteps"]):
            hyper = TrainingConfig(env=env, steps=steps).hyper
            rollout = hyper["n_envs"] * hyper["n_steps"]
            assert hyper["n_envs"] == 8 or steps // rollout >= ROLLOUTS
            assert rollout // hyper["batch_size"] == whole["n_envs"] * whole["n_steps"] // whole["batch_size"]
            assert {**hyper, "n_envs": whole["n_envs"], "batch_size": whole["batch_size"]} == whole
        assert TrainingConfig(env=env, steps=whole["n_timesteps"]).hyper == TrainingConfig(env=env).hyper == whole
    given = NEEDED | {"n_steps": 32, "batch_size": 32}
    assert TrainingConfig(steps=1, config=given).hyper["n_envs"] == 2  # what somebody states is used
    assert TrainingConfig(algo="sac", steps=1).hyper == load("sac", TASKS[0])
