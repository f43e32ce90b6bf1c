"""Hyper-parameters: the form of rl-baselines3-zoo, and nothing in it that runs."""

import inspect
import re

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO, SAC, TD3

from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.algorithms import ALGORITHMS
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.rules import OURS
from turtlebot_gym_agents.training.train import make_model, train

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
        ({"policy_kwargs": "dict(activation_fn=nn.functional)"}, "activation_fn must be one of"),
        ({"policy_kwargs": {"activation_fn": "__import__('os')"}}, "activation_fn must be one of"),
        ({"policy_kwargs": {"activation_fn": "functional"}}, "activation_fn must be one of"),
        ({"noise_type": "pink", "noise_std": 0.1}, "noise_type must be"),
        ({"noise_type": "normal"}, "noise_type and noise_std must be given together"),
        ({"stats_window_size": 0}, "stats_window_size must be"),
        ({"gamme": 0.9}, "TD3 has no hyper-parameter 'gamme': did you mean gamma"),
    ],
)
def test_what_is_not_understood_is_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        hyperparameters.arguments(wrong, TD3 if "noise_type" in wrong or "gamme" in wrong else PPO)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "must be a mapping"),
        ("default: 3", "which is a mapping"),
        ("other/Env-v0: {n_envs: 1}", "'default'"),
        ("default: {n_envs: 1}", "n_timesteps, policy must be given"),
        ("default: {n_envs: 0, n_timesteps: 5, policy: MlpPolicy}", "n_envs must be a whole number from 1"),
        ("default: {n_envs: many, n_timesteps: 5, policy: MlpPolicy}", "n_envs must be a whole number"),
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


BAD = (True, "x", "", [], {}, float("nan"), float("inf"), -1e300, 1e300, -7, 0.5j, object(), "lin_x", "lin_-1", [1, 2, 3], None)
GOOD = {  # of each hyper-parameter some values in the forms that a file may have
    "learning_rate": [0.001, "1e-3", "lin_0.01"],
    "gamma": [0, 1, 0.99, "0.5"],
    "gae_lambda": [1.0, 0],
    "clip_range": [0.2, "lin_0.2"],
    "clip_range_vf": [None, 0.2, "lin_1"],
    "ent_coef": [0.0, 0.01],
    "vf_coef": [0.5],
    "max_grad_norm": [0.5, 10],
    "n_steps": [4, "16", 8.0],
    "batch_size": [256, "1e2"],
    "n_epochs": [1, 10],
    "normalize_advantage": [True, False],
    "use_sde": [True, False],
    "use_sde_at_warmup": [False],
    "sde_sample_freq": [-1, 4],
    "target_kl": [None, 0.01],
    "stats_window_size": [100],
    "verbose": [0, 1],
    "rms_prop_eps": [1e-5],
    "use_rms_prop": [True],
    "buffer_size": [1000, "1e4"],
    "learning_starts": [0, 100],
    "tau": [1.0, 0.005],
    "train_freq": [1, [4, "step"]],
    "gradient_steps": [-1, 1, 8],
    "target_update_interval": [1],
    "target_entropy": ["auto", -2.0],
    "policy_delay": [2],
    "target_policy_noise": [0.0, 0.2],
    "target_noise_clip": [0.5],
}
ARGUMENTS = [(algo, name) for algo, kind in ALGORITHMS.items() for name in hyperparameters.rules_of(kind)]
ALLOWED_TWICE = {  # bad values for most are good ones here
    ("clip_range_vf", None), ("target_kl", None), ("target_entropy", -7)
}  # fmt: skip


def test_every_argument_of_every_algorithm_has_a_rule_or_is_not_to_be_told():
    """A new argument of a new version of Stable-Baselines3 is refused by name until there is a rule for it."""
    never = {*hyperparameters.OPTIONS, *OURS, "policy_kwargs", "_init_setup_model", "action_noise", "rollout_buffer_class",
             "rollout_buffer_kwargs", "replay_buffer_class", "replay_buffer_kwargs", "optimize_memory_usage"}  # fmt: skip
    for kind in ALGORITHMS.values():
        names = set(inspect.signature(kind).parameters)
        assert names - never == set(hyperparameters.rules_of(kind)) - {"noise_type", "noise_std"}


@pytest.mark.parametrize(("algo", "name"), [one for one in ARGUMENTS if not one[1].startswith("noise_")])
def test_each_hyperparameter_is_taken_in_its_range_and_refused_outside(algo, name):
    kind = ALGORITHMS[algo]
    values = ["auto", "auto_0.1", 0.2] if (algo, name) == ("sac", "ent_coef") else GOOD[name]
    for value in values:
        assert name in hyperparameters.arguments({name: value}, kind)
    for value in BAD:
        if isinstance(value, bool) and GOOD[name][0] in (True, False) and type(GOOD[name][0]) is bool:
            continue
        if any(allowed == (name, value) for allowed in ALLOWED_TWICE):
            continue
        with pytest.raises(ValueError, match=f"^{name} must be ") as caught:
            hyperparameters.arguments({name: value}, kind)
        assert "\n" not in str(caught.value)
        assert ", got " in str(caught.value)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_what_is_taken_makes_a_model_that_learns(algo):
    """All good values of all hyper-parameters at once, the last of each: nothing that a rule allows ends in a traceback."""
    kind = ALGORITHMS[algo]
    told = {name: GOOD[name][-1] for name in hyperparameters.rules_of(kind) if name in GOOD}
    off_policy = {"learning_starts": 4, "noise_type": "normal", "noise_std": 0.1, "gradient_steps": 1}
    told |= off_policy if "buffer_size" in told else {"n_steps": 8, "batch_size": 8} if algo == "ppo" else {}
    told |= {"policy_kwargs": {"net_arch": [4], "activation_fn": "Tanh"}, "n_envs": 2, "n_timesteps": 16, "policy": "MlpPolicy"}
    config = TrainingConfig(algo=algo, episodes=2, evaluations=1)
    model = make_model(config, hyperparameters.checked_for(algo, told), config.make(2), tensorboard=None)
    model.learn(16)
    assert all(bool(torch.isfinite(one).all()) for one in model.policy.parameters())


@pytest.mark.parametrize(
    ("algo", "told", "message"),
    [
        ("ppo", {"n_envs": True}, "n_envs must be a whole number from 1 to 1_000_000, got True"),
        ("ppo", {"gamma": -1}, "gamma must be a number from 0 to 1, got -1"),
        (
            "ppo",
            {"clip_range": float("nan")},
            "clip_range must be a number above 0 and at most 10, or such a number after 'lin_'",
        ),
        ("ppo", {"device": "cpu"}, "device is no hyper-parameter; use the option --device"),
        ("ppo", {"tau": 0.1}, "PPO has no hyper-parameter 'tau'"),
        ("ppo", {"gama": 0.9}, "PPO has no hyper-parameter 'gama': did you mean gamma?"),
        ("ppo", {"qqqqqqq": 0.9}, "PPO has no hyper-parameter 'qqqqqqq': it has batch_size, clip_range, "),
        ("ppo", {3: 0.9}, "PPO has no hyper-parameter 3"),
        ("ppo", {"policy": "CnnPolicy"}, "policy must be 'MlpPolicy', got 'CnnPolicy'"),
        ("ppo", {"policy_kwargs": {"net_arc": [8]}}, "policy_kwargs of PPO has no 'net_arc': did you mean net_arch?"),
        ("ppo", {"policy_kwargs": {"net_arch": [0]}}, "policy_kwargs.net_arch must be a list of at most 16 sizes"),
        ("ppo", {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [8]}}}, "or a mapping of pi and vf to such lists"),
        ("sac", {"policy_kwargs": {"net_arch": {"pi": [8], "vf": [8]}}}, "or a mapping of pi and qf to such lists"),
        ("ppo", {"policy_kwargs": {"activation_fn": "Linear"}}, "activation_fn must be one of ReLU, Tanh, ELU"),
        ("ppo", {"policy_kwargs": {"optimizer_kwargs": {"lr": 1.0}}}, "optimizer_kwargs must be a mapping of numbers: eps"),
        ("a2c", {"policy_kwargs": {"optimizer_kwargs": {"eps": 0.1}}}, "they need use_rms_prop: false"),
        ("ppo", {"n_envs": 1, "n_steps": 1}, "n_envs times n_steps must be from 2 to 100000000, got 1 times 1"),
        ("ppo", {"n_envs": 1_000_000, "n_steps": 1_000}, "n_envs times n_steps must be from 2 to 100000000"),
        ("sac", {"n_envs": 2, "train_freq": [1, "episode"]}, "train_freq must be in steps where n_envs is more than 1"),
        ("td3", {"noise_std": 0.1}, "noise_type and noise_std must be given together"),
        ("sac", {"ent_coef": "auto_0"}, "ent_coef must be a number from 0 to 100, 'auto'"),
    ],
)
def test_the_line_says_what_is_wrong_and_what_is_allowed(algo, told, message):
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        hyperparameters.checked_for(algo, told)
    assert "\n" not in str(caught.value)


def test_hyperparameters_in_python_are_checked_before_anything_is_written(tmp_path):
    hyper = {"n_envs": 4, "n_timesteps": 64, "policy": "MlpPolicy", "gamma": 2}
    with pytest.raises(ValueError, match=r"^gamma must be a number from 0 to 1, got 2\.$"):
        train(TrainingConfig(), tmp_path / "run", progress=False, hyper=hyper)
    assert not list(tmp_path.iterdir())
