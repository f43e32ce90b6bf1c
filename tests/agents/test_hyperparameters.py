"""Hyper-parameters: the form of rl-baselines3-zoo, and nothing in it that runs."""

import inspect
import re

import numpy as np
import pytest
import torch
import yaml

from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.hyperparameters import RULES, load
from turtlebot_gym_agents.training.model import ALGORITHMS, arguments, make_model

TASKS = ["turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotPose-v0", "turtlebot_gym/TurtleBotSquare-v0"]
SHIPPED = sorted(path.stem for path in hyperparameters.configs_folder().glob("*.yaml"))
NEEDED = {"n_envs": 1, "n_timesteps": 5, "policy": "MlpPolicy"}


def checked(algo="ppo", **given):
    """Return hyper-parameters, with those that must be given."""
    return load(algo, TASKS[0], NEEDED | given)


def write(tmp_path, text):
    path = tmp_path / "hyper.yaml"
    path.write_text(text)
    return path


def test_an_environments_own_entry_goes_before_the_default(tmp_path):
    rest = "policy: MlpPolicy, n_envs: 4"
    path = write(tmp_path, f"default: {{n_timesteps: 1, {rest}}}\n{TASKS[0]}: {{n_timesteps: !!float 2e3, {rest}}}\n")
    assert load("ppo", TASKS[0], path)["n_timesteps"] == 2000
    assert load("ppo", TASKS[1], path)["n_timesteps"] == 1


def test_the_zoos_text_is_the_mapping_that_it_says():
    text = "dict(net_arch=dict(pi=[8], vf=[9]), activation_fn=nn.ReLU, log_std_init=-0.5)"
    hyper = checked(policy_kwargs=text)
    assert hyper["policy_kwargs"] == {"net_arch": {"pi": [8], "vf": [9]}, "activation_fn": "ReLU", "log_std_init": -0.5}
    assert arguments(hyper)["policy_kwargs"]["activation_fn"] is torch.nn.ReLU


@pytest.mark.parametrize("algo", SHIPPED)
def test_shipped_files_are_read_for_any_environment_and_mean_the_same_to_the_zoo(algo, tmp_path):
    """rl-baselines3-zoo evaluates text under ``policy_kwargs`` with ``nn`` in scope, and splits rates at their underscore."""
    assert load(algo, "somebody/Else-v3")["n_envs"] > 0
    for env in TASKS:
        hyper = load(algo, env)
        assert load(algo, env, hyper) == hyper
        hyperparameters.save(tmp_path / "saved.yaml", env, hyper)
        assert load(algo, env, tmp_path / "saved.yaml") == hyper
        for file in (tmp_path / "saved.yaml", hyperparameters.configs_folder() / f"{algo}.yaml"):
            theirs = yaml.safe_load(file.read_text())[env]["policy_kwargs"]
            network = eval(theirs, {"nn": torch.nn}) if isinstance(theirs, str) else theirs
            assert network == arguments(hyper)["policy_kwargs"]


def test_names_become_objects():
    values = {
        "learning_rate": "lin_0.002",
        "clip_range": "1e-1",
        "ent_coef": "1e-3",
        "n_steps": 8.0,
        "policy_kwargs": {"activation_fn": "nn.Tanh", "net_arch": [8]},
    }
    made = arguments(checked(**values))
    assert [made["learning_rate"](remaining) for remaining in (1.0, 0.5, 0.0, -0.1)] == [0.002, 0.001, 0.0, 0.0]
    assert (made["clip_range"], made["ent_coef"], made["n_steps"]) == (0.1, 0.001, 8)
    assert made["policy_kwargs"] == {"activation_fn": torch.nn.Tanh, "net_arch": [8]}
    assert values["policy_kwargs"]["activation_fn"] == "nn.Tanh"  # the argument is not changed
    assert not {"n_envs", "n_timesteps", "policy"} & set(made)
    assert arguments(checked("sac", train_freq=[4, "step"]))["train_freq"] == (4, "step")
    noise = arguments(checked("td3", noise_type="normal", noise_std=0.3))["action_noise"]
    assert np.std([noise() for _ in range(2000)]) == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "must be a mapping"),
        ("default: 3", "which is a mapping"),
        ("other/Env-v0: {n_envs: 1}", "'default'"),
        ("default: {n_envs: 1}", "n_timesteps, policy must be given"),
        ("default: {n_envs: 0, n_timesteps: 5, policy: MlpPolicy}", "n_envs must be a whole number from 1"),
        ("default: !!python/object/apply:os.system ['true']", "is not YAML"),
        ("{", "is not YAML"),
    ],
)
def test_files_of_another_form_are_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as refusal:
        load("ppo", TASKS[0], write(tmp_path, text))
    assert str(tmp_path) in str(refusal.value)
    with pytest.raises(ValueError, match=r"no hyper-parameters for 'a2c' .* known algorithms: ppo, sac, td3"):
        load("a2c", TASKS[0])  # there is no file of it


MAPPING, UNKNOWN = "policy_kwargs must be a mapping", "policy_kwargs.activation_fn must be one of ReLU, Tanh, ELU"


@pytest.mark.parametrize(
    ("algo", "given", "message"),
    [
        ("dreamer", {}, "algo must be one of 'a2c', 'ddpg', 'ppo', 'sac', 'td3', got 'dreamer'"),
        ("ppo", {"n_envs": True}, "n_envs must be a whole number from 1 to 1000000, got True"),
        ("ppo", {"gamma": -1}, "gamma must be a number from 0 to 1, got -1."),
        (
            "ppo",
            {"clip_range": float("nan")},
            "clip_range must be a number above 0 and at most 10, or 'lin_' and such a number",
        ),
        ("ppo", {"learning_rate": "cos_0.1"}, "learning_rate must be"),
        ("ppo", {"device": "cpu"}, "device is not a hyper-parameter; use the option --device"),
        ("ppo", {"seed": 1}, "seed is not a hyper-parameter; use the option --seed"),
        ("ppo", {"env": "x"}, "env is not a hyper-parameter; use the option --env"),
        ("ppo", {"tau": 0.1}, "ppo has no 'tau'"),
        ("td3", {"gamme": 0.9}, "td3 has no 'gamme'; it has n_envs, n_timesteps, "),
        ("td3", {"gamme": 0.9}, "Did you mean 'gamma'?"),
        ("ppo", {3: 0.9}, "ppo has no 3"),
        ("ppo", {"policy": "CnnPolicy"}, "policy must be one of MlpPolicy, got 'CnnPolicy'"),
        ("ppo", {"policy_kwargs": 3}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(net_arch=[open('x')])"}, MAPPING + ", or text like"),
        ("ppo", {"policy_kwargs": "dict(activation_fn=os.system)"}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(activation_fn=nn.functional.relu)"}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(**nn.__dict__)"}, MAPPING),
        ("ppo", {"policy_kwargs": "dict([])"}, MAPPING),
        ("ppo", {"policy_kwargs": "nn.ReLU"}, MAPPING),
        ("ppo", {"policy_kwargs": "dict("}, MAPPING),
        ("ppo", {"policy_kwargs": "dict(activation_fn=nn.functional)"}, UNKNOWN),
        ("ppo", {"policy_kwargs": {"activation_fn": "__import__('os')"}}, UNKNOWN),
        ("ppo", {"policy_kwargs": {"activation_fn": "Linear"}}, UNKNOWN),
        ("ppo", {"policy_kwargs": {"net_arc": [8]}}, "policy_kwargs has no 'net_arc'"),
        ("ppo", {"policy_kwargs": {"net_arch": [0]}}, "policy_kwargs.net_arch must be a list of at most 16 sizes"),
        ("ppo", {"policy_kwargs": {"net_arch": [8] * 17}}, "policy_kwargs.net_arch must be a list of at most 16 sizes"),
        ("ppo", {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [8]}}}, "or a mapping of pi and vf to such lists"),
        ("sac", {"policy_kwargs": {"net_arch": {"pi": [8], "vf": [8]}}}, "or a mapping of pi and qf to such lists"),
        ("ppo", {"policy_kwargs": {"optimizer_kwargs": {"lr": 1.0}}}, "optimizer_kwargs has no 'lr'; it has eps"),
        ("ppo", {"policy_kwargs": {"optimizer_kwargs": {"betas": [0.9]}}}, "optimizer_kwargs.betas must be two numbers"),
        ("a2c", {"policy_kwargs": {"optimizer_kwargs": {"eps": 0.1}}}, "they need use_rms_prop: false"),
        ("ppo", {"n_steps": 1}, "n_envs times n_steps must be a whole number from 2 to 100000000, got 1"),
        ("ppo", {"n_envs": 1_000_000, "n_steps": 1_000}, "n_envs times n_steps must be"),
        ("sac", {"n_envs": 2, "train_freq": [1, "episode"]}, "train_freq must be in steps where n_envs is more than 1"),
        ("td3", {"noise_std": 0.1}, "noise_type and noise_std must be given together"),
        ("td3", {"noise_type": "pink", "noise_std": 0.1}, "noise_type must be one of normal"),
        ("sac", {"ent_coef": "auto_0"}, "ent_coef must be a number from 0 to 100, or 'auto', or 'auto_'"),
    ],
    ids=str,
)
def test_a_refusal_is_one_line_that_says_what_is_allowed(algo, given, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        load(algo, TASKS[0], NEEDED | given)
    assert "\n" not in str(refusal.value)


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
NUMBERED = [(algo, name) for algo, rules in RULES.items() for name in rules.rules if name in GOOD]
ALLOWED = [("clip_range_vf", None), ("target_kl", None), ("target_entropy", -7)]
"""Values that are bad for most and good for these."""


@pytest.mark.parametrize("algo", RULES)
def test_every_argument_of_every_algorithm_has_a_rule_or_is_set_elsewhere(algo):
    """A new argument of a new version of Stable-Baselines3 is refused by name until there is a rule for it."""
    elsewhere = {*hyperparameters.OPTIONS, "_init_setup_model", "action_noise", "rollout_buffer_class", "rollout_buffer_kwargs",
                 "replay_buffer_class", "replay_buffer_kwargs", "optimize_memory_usage"}  # fmt: skip
    signature = set(inspect.signature(ALGORITHMS[algo]).parameters) | {"n_envs", "n_timesteps"}
    noise = {"noise_type", "noise_std"} if "action_noise" in signature else set()
    assert set(RULES[algo].rules) == signature - elsewhere | noise
    policy = set(inspect.signature(ALGORITHMS[algo].policy_aliases["MlpPolicy"]).parameters)
    ours = {"observation_space", "action_space", "lr_schedule", "use_sde", "squash_output", "features_extractor_class",
            "features_extractor_kwargs", "normalize_images", "optimizer_class"}  # fmt: skip
    assert set(RULES[algo].rules["policy_kwargs"].rules) == policy - ours


@pytest.mark.parametrize(("algo", "name"), NUMBERED)
def test_each_hyperparameter_is_taken_in_its_range_and_refused_outside(algo, name):
    values = ["auto", "auto_0.1", 0.2] if (algo, name) == ("sac", "ent_coef") else GOOD[name]
    for value in values:
        assert name in checked(algo, **{name: value, "n_envs": 2})
    for value in BAD:
        if (name, value) in ALLOWED or (isinstance(value, bool) and isinstance(GOOD[name][0], bool)):
            continue
        with pytest.raises(ValueError, match=rf"^{name} must be .*, got [^\n]*$"):
            checked(algo, **{name: value})


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_all_accepted_values_make_a_model_that_learns(algo):
    """All good values of all hyper-parameters at once, the last of each: nothing that a rule allows ends in a traceback."""
    hyper = {name: GOOD[name][-1] for name in RULES[algo].rules if name in GOOD}
    off_policy = {"learning_starts": 4, "noise_type": "normal", "noise_std": 0.1, "gradient_steps": 1}
    hyper |= off_policy if "buffer_size" in hyper else {"n_steps": 8, "batch_size": 8} if algo == "ppo" else {}
    hyper |= NEEDED | {"policy_kwargs": {"net_arch": [4], "activation_fn": "Tanh"}, "n_envs": 2, "n_timesteps": 16}
    config = TrainingConfig(algo=algo, config=hyper, episodes=2, evaluations=1)
    model = make_model(config, config.make_training())
    model.learn(16)
    assert all(bool(torch.isfinite(weight).all()) for weight in model.policy.parameters())
