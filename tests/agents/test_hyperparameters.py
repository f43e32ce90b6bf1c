"""Hyper-parameters: the form of rl-baselines3-zoo, and nothing in it that runs."""

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO, SAC, TD3

from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.train import ALGORITHMS

TASKS = ["turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotPose-v0", "turtlebot_gym/TurtleBotSquare-v0"]
SHIPPED = sorted(path.stem for path in hyperparameters.configs_folder().glob("*.yaml"))


def write(tmp_path, text):
    path = tmp_path / "hyper.yaml"
    path.write_text(text)
    return path


def test_algorithms_are_shipped():
    assert {"ppo", "sac", "td3"} <= set(SHIPPED)


@pytest.mark.parametrize("algo", SHIPPED)
@pytest.mark.parametrize("env", [*TASKS, "somebody/Else-v3"])
def test_shipped_files_are_understood_for_any_environment(algo, env):
    hyper = hyperparameters.load(algo, env)
    hyperparameters.arguments(hyper, ALGORITHMS[algo])
    assert hyper["n_envs"] > 0


def test_an_environments_own_entry_goes_before_the_default(tmp_path):
    rest = "policy: MlpPolicy, n_envs: 4"
    path = write(tmp_path, f"default: {{n_timesteps: 1, {rest}}}\n{TASKS[0]}: {{n_timesteps: !!float 2e3, {rest}}}\n")
    assert hyperparameters.load("ppo", TASKS[0], path)["n_timesteps"] == 2000
    assert hyperparameters.load("ppo", TASKS[1], path)["n_timesteps"] == 1


def test_what_is_saved_is_loaded(tmp_path):
    hyper = hyperparameters.load("ppo", TASKS[1])
    hyperparameters.save(tmp_path / "best.yaml", "an/Id-v0", hyper)
    assert hyperparameters.load("ppo", "an/Id-v0", tmp_path / "best.yaml") == hyper


def test_the_zoos_text_is_the_mapping_that_it_says(tmp_path):
    head = "default: {n_envs: 1, n_timesteps: 5, policy: MlpPolicy, policy_kwargs: "
    text = write(tmp_path, head + '"dict(net_arch=dict(pi=[8], vf=[9]), activation_fn=nn.ReLU, log_std_init=-0.5)"}')
    hyper = hyperparameters.load("ppo", TASKS[0], text)
    assert hyper["policy_kwargs"] == {"net_arch": {"pi": [8], "vf": [9]}, "activation_fn": "ReLU", "log_std_init": -0.5}
    assert hyperparameters.arguments(hyper, PPO)["policy_kwargs"]["activation_fn"] is torch.nn.ReLU


@pytest.mark.parametrize("algo", SHIPPED)
@pytest.mark.parametrize("env", TASKS)
def test_what_is_written_means_the_same_to_the_zoo(algo, env, tmp_path):
    """rl-baselines3-zoo evaluates text under ``policy_kwargs`` with ``nn`` in scope, and splits rates at their underscore."""
    hyper = hyperparameters.load(algo, env)
    hyperparameters.save(tmp_path / "saved.yaml", env, hyper)
    ours = hyperparameters.arguments(hyper, ALGORITHMS[algo])["policy_kwargs"]
    for file in (tmp_path / "saved.yaml", hyperparameters.configs_folder() / f"{algo}.yaml"):
        theirs = yaml.safe_load(file.read_text())[env]["policy_kwargs"]
        assert (eval(theirs, {"nn": torch.nn}) if isinstance(theirs, str) else theirs) == ours


def test_names_become_objects():
    names = {
        "learning_rate": "lin_0.002",
        "clip_range": "1e-1",
        "ent_coef": "1e-3",
        "policy_kwargs": {"activation_fn": "nn.Tanh", "net_arch": [8]},
    }
    made = hyperparameters.arguments(names, PPO)
    assert made["learning_rate"](0.5) == 0.001
    assert (made["clip_range"], made["ent_coef"]) == (0.1, 0.001)
    assert made["policy_kwargs"] == {"activation_fn": torch.nn.Tanh, "net_arch": [8]}
    assert names["policy_kwargs"]["activation_fn"] == "nn.Tanh"  # what was given is not changed
    assert hyperparameters.arguments({"ent_coef": "auto"}, SAC)["ent_coef"] == "auto"
    noise = hyperparameters.arguments({"noise_type": "normal", "noise_std": 0.3}, TD3)["action_noise"]
    assert np.std([noise() for _ in range(2000)]) == pytest.approx(0.3, rel=0.1)


def test_a_linear_rate_is_never_negative():
    rate = hyperparameters.arguments({"learning_rate": "lin_0.002"}, PPO)["learning_rate"]
    assert [rate(remaining) for remaining in (1.0, 0.25, 0.0, -0.1)] == [0.002, 0.0005, 0.0, 0.0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"learning_rate": "cos_0.1"}, "learning_rate must be"),
        ({"learning_rate": "lin_-1"}, "learning_rate must be"),
        ({"policy_kwargs": "dict(net_arch=[open('x')])"}, "policy_kwargs must be a mapping, or text like"),
        ({"policy_kwargs": "dict(activation_fn=os.system)"}, "policy_kwargs must be"),
        ({"policy_kwargs": "dict(activation_fn=nn.functional.relu)"}, "policy_kwargs must be"),
        ({"policy_kwargs": "dict(**nn.__dict__)"}, "policy_kwargs must be"),
        ({"policy_kwargs": "dict([])"}, "policy_kwargs must be"),
        ({"policy_kwargs": "nn.ReLU"}, "policy_kwargs must be"),
        ({"policy_kwargs": "dict("}, "policy_kwargs must be"),
        ({"policy_kwargs": 3}, "policy_kwargs must be"),
        ({"policy_kwargs": "dict(activation_fn=nn.functional)"}, "activation_fn must name"),
        ({"policy_kwargs": {"activation_fn": "__import__('os')"}}, "activation_fn must name"),
        ({"policy_kwargs": {"activation_fn": "functional"}}, "activation_fn must name"),
        ({"noise_type": "pink", "noise_std": 0.1}, "noise_type must be"),
        ({"noise_type": "normal"}, "noise_std must be a number"),
        ({"gamme": 0.9}, "PPO has no arguments gamme"),
    ],
)
def test_what_is_not_understood_is_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        hyperparameters.arguments(wrong, PPO)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "must be a mapping"),
        ("default: 3", "which is a mapping"),
        ("other/Env-v0: {n_envs: 1}", "'default'"),
        ("default: {n_envs: 1}", "n_timesteps, policy must be given"),
        ("default: {n_envs: 0, n_timesteps: 5, policy: MlpPolicy}", "must be positive"),
        ("default: {n_envs: many, n_timesteps: 5, policy: MlpPolicy}", "n_envs must be a number"),
        ("default: !!python/object/apply:os.system ['true']", "is not YAML"),
        ("{", "is not YAML"),
    ],
)
def test_files_of_another_form_are_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        hyperparameters.load("ppo", TASKS[0], write(tmp_path, text))


def test_unknown_algorithms_are_told_with_the_known_ones():
    with pytest.raises(ValueError, match="ppo, sac, td3"):
        hyperparameters.load("dreamer", TASKS[0])
