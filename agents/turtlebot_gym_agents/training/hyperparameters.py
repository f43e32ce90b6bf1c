"""Hyper-parameters: YAML in the form of rl-baselines3-zoo, and the rule of each."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from turtlebot_gym import files
from turtlebot_gym.validation import Names, Range, Rule, choose, did_you_mean, flag, refusal, shown
from turtlebot_gym_agents.policies.named import shipped_folder

ACTIVATIONS = Names(("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Sigmoid", "Softplus", "Mish"))
"""Modules of torch.nn between the layers of a network."""
MOST_NUMBERS = 10**8
"""Steps that a rollout or a replay buffer may hold: a few gigabytes."""
OPTIONS = {"env": "--env", "seed": "--seed", "device": "--device", "tensorboard_log": "--out"}
"""Arguments of the algorithms that are options of the training, not hyper-parameters."""


@dataclass(frozen=True, slots=True)
class _Reading:
    """A rule in words, and the function that reads a value by it."""

    text: str
    read: Callable[[Any], Any]

    def check(self, name: str, value: Any) -> Any:
        try:
            return self.read(value)
        except (TypeError, ValueError, LookupError, OverflowError, AttributeError):
            raise refusal(name, self.text, value) from None

    def __str__(self) -> str:
        return self.text


def _as_numbers(value: Any) -> Any:
    """Return a value with numeric texts as numbers, since YAML reads 1e-3 as text; whole ones such as 2e6 become integers."""
    if isinstance(value, Mapping):
        return {key: _as_numbers(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_as_numbers(item) for item in value]
    if isinstance(value, str):
        with suppress(ValueError):
            value = float(value)
    return int(value) if isinstance(value, float) and abs(value) < 2**53 and value.is_integer() else value


def _either(rule: Rule, *others: Any) -> _Reading:
    """Return a rule that also allows a few other values."""

    def read(value: Any) -> Any:
        return value if any(type(value) is type(other) and value == other for other in others) else rule.check("", value)

    return _Reading(f"{rule}, or {' or '.join('null' if other is None else repr(other) for other in others)}", read)


def _after(prefix: str, rule: Rule, high: float, meaning: str) -> _Reading:
    """Return a rule that also allows text of a prefix and a positive number."""

    def read(value: Any) -> Any:
        if isinstance(value, str) and value.startswith(prefix):
            Range(0.0, high, open_low=True).check("", float(value.removeprefix(prefix)))
            return value
        return rule.check("", value)

    return _Reading(f"{rule}, or {prefix!r} and {meaning}", read)


def _rate(high: float) -> _Reading:
    return _after("lin_", Range(0.0, high, open_low=True), high, "such a number, from which it falls to 0")


def _list(rule: Rule, text: str, *, most: int, least: int = 0) -> _Reading:
    def read(value: Any) -> list[Any]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise TypeError
        return [rule.check("", item) for item in value]

    return _Reading(text, read)


@dataclass(frozen=True, slots=True)
class _Mapping:
    """A mapping whose values have rules of their own."""

    rules: Mapping[str, Rule]

    def check(self, name: str, value: Any) -> dict[str, Any]:
        """Return the mapping with its values as read; its name is an algorithm, or the path of a nested mapping."""
        if not isinstance(value, Mapping):
            raise refusal(name, f"a mapping of {', '.join(self.rules)}", value)
        for key in value:
            if key not in self.rules:
                raise ValueError(f"{name} has no {shown(key)}; it has {', '.join(self.rules)}.{did_you_mean(key, self.rules)}")
        path = "" if name in RULES else f"{name}."
        return {key: self.rules[key].check(f"{path}{key}", item) for key, item in value.items()}


def _layers(critic: str) -> _Reading:
    """Return the rule of a network's layers; those of the critic may differ."""
    sizes = _list(Range(1, 8192, whole=True), "a list of at most 16 sizes of layers, each from 1 to 8192", most=16)

    def read(value: Any) -> Any:
        if isinstance(value, Mapping) and set(value) == {"pi", critic}:
            return {name: sizes.read(layers) for name, layers in value.items()}
        return sizes.read(value)

    return _Reading(f"{sizes}, or a mapping of pi and {critic} to such lists", read)


def _frequency(value: Any) -> Any:
    if not isinstance(value, list):
        return _UPDATES.check("", value)
    count, unit = value
    return [_UPDATES.check("", count), {"step": "step", "episode": "episode"}[unit]]


_UPDATES, _SHARE = Range(1, 1_000_000, whole=True), Range(0.0, 1.0)
_POSITIVE_SHARE = Range(0.0, 1.0, open_low=True)
_FLAG = _Reading("True or False", lambda value: flag("flag", value))
_NETWORK: dict[str, Rule] = {
    "activation_fn": _Reading(str(ACTIVATIONS), lambda value: ACTIVATIONS.check("", value.removeprefix("nn."))),
    "share_features_extractor": _FLAG,
    "optimizer_kwargs": _Mapping(
        {
            "eps": _POSITIVE_SHARE,
            "weight_decay": _SHARE,
            "betas": _list(Range(0.0, 1.0 - 1e-9), "two numbers of at least 0 and below 1", least=2, most=2),
        }
    ),
}
_EXPLORING = {"log_std_init": Range(-20.0, 5.0), "use_expln": _FLAG}
_ON_POLICY_NETWORK = _NETWORK | _EXPLORING | {"net_arch": _layers("vf"), "ortho_init": _FLAG, "full_std": _FLAG}
_OFF_POLICY_NETWORK = _NETWORK | {"net_arch": _layers("qf"), "n_critics": Range(1, 16, whole=True)}
_ANY: dict[str, Rule] = {
    "n_envs": _UPDATES,
    "n_timesteps": Range(1, 10**12, whole=True),
    "policy": Names(("MlpPolicy",)),
    "learning_rate": _rate(1.0),
    "gamma": _SHARE,
    "verbose": Range(0, 2, whole=True),
}
_SAMPLING = {"use_sde": _FLAG, "sde_sample_freq": Range(-1, 1_000_000, whole=True), "stats_window_size": _UPDATES}
_ON_POLICY = _ANY | _SAMPLING | {
    "n_steps": _UPDATES,
    "gae_lambda": _SHARE,
    "ent_coef": Range(0.0, 100.0),
    "vf_coef": Range(0.0, 100.0),
    "max_grad_norm": Range(0.0, 1e6, open_low=True),
    "normalize_advantage": _FLAG,
    "policy_kwargs": _Mapping(_ON_POLICY_NETWORK),
}  # fmt: skip
_OFF_POLICY = _ANY | {
    "buffer_size": Range(1, MOST_NUMBERS, whole=True),
    "learning_starts": Range(0, 10**9, whole=True),
    "batch_size": Range(1, 10_000_000, whole=True),
    "tau": _POSITIVE_SHARE,
    "train_freq": _Reading(f"{_UPDATES}, or a pair of such a number and 'step' or 'episode'", _frequency),
    "gradient_steps": _either(_UPDATES, -1),
    "n_steps": _UPDATES,
    "noise_type": Names(("normal",)),
    "noise_std": Range(0.0, 10.0),
    "policy_kwargs": _Mapping(_OFF_POLICY_NETWORK),
}
RULES: dict[str, _Mapping] = {
    "a2c": _Mapping(_ON_POLICY | {"rms_prop_eps": _POSITIVE_SHARE, "use_rms_prop": _FLAG}),
    "ddpg": _Mapping(_OFF_POLICY),
    "ppo": _Mapping(
        _ON_POLICY
        | {
            "batch_size": Range(2, 10_000_000, whole=True),
            "n_epochs": Range(1, 1000, whole=True),
            "clip_range": _rate(10.0),
            "clip_range_vf": _either(_rate(1000.0), None),
            "target_kl": _either(Range(0.0, 1000.0, open_low=True), None),
        }
    ),
    "sac": _Mapping(
        _OFF_POLICY
        | _SAMPLING
        | {
            "ent_coef": _after("auto_", _either(Range(0.0, 100.0), "auto"), 100.0, "the number to begin with"),
            "use_sde_at_warmup": _FLAG,
            "target_update_interval": _UPDATES,
            "target_entropy": _either(Range(-1000.0, 1000.0), "auto"),
            "policy_kwargs": _Mapping(_OFF_POLICY_NETWORK | _EXPLORING | {"clip_mean": Range(0.0, 100.0)}),
        }
    ),
    "td3": _Mapping(
        _OFF_POLICY
        | {
            "policy_delay": Range(1, 1000, whole=True),
            "target_policy_noise": Range(0.0, 10.0),
            "target_noise_clip": Range(0.0, 10.0),
            "stats_window_size": _UPDATES,
        }
    ),
}
"""Rules of the hyper-parameters of each algorithm."""


def load(algo: str, env: str, source: Path | Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the checked hyper-parameters of an algorithm for an environment, in JSON's types.

    Args:
        algo: Name of the algorithm in lower case.
        env: The environment's id; ``default`` in a file stands for those that it does not name.
        source: A file, or the hyper-parameters themselves; None for the file that is shipped for the algorithm.

    Raises:
        ValueError: If the algorithm or the file is unknown, or a hyper-parameter is missing, unknown, out of its range, or does
            not go with another one.
    """
    rules = choose("algo", algo, RULES)
    if isinstance(source, Mapping):
        return _checked(algo, rules, source)
    path = configs_folder() / f"{algo}.yaml" if source is None else Path(source)
    if not path.is_file():
        algorithms = ", ".join(sorted(file.stem for file in configs_folder().glob("*.yaml")))
        raise ValueError(f"There are no hyper-parameters for {algo!r} in {path}; known algorithms: {algorithms}.")
    content = files.load(path)
    chosen = content.get(env, content.get("default")) if isinstance(content, dict) else None
    if not isinstance(chosen, dict):
        raise ValueError(f"{path} must be a mapping with an entry {env!r} or 'default', which is a mapping.")
    try:
        return _checked(algo, rules, chosen)
    except ValueError as error:
        raise ValueError(f"{path}, {env}: {error}") from error


def configs_folder() -> Path:
    """Return the folder with the configurations shipped with the package."""
    return shipped_folder("configs")


def save(path: Path, env: str, hyper: Mapping[str, Any]) -> None:
    """Write hyper-parameters in a form that both `load` and rl-baselines3-zoo read."""
    content = dict(hyper)
    if isinstance(content.get("policy_kwargs"), dict):
        network = hyper["policy_kwargs"].items()
        words = (f"{key}={f'nn.{value}' if key == 'activation_fn' else repr(value)}" for key, value in network)
        content["policy_kwargs"] = f"dict({', '.join(words)})"
    files.write_text(path, yaml.safe_dump({env: content}, sort_keys=False, width=128))


def _checked(algo: str, rules: _Mapping, given: Mapping[str, Any]) -> dict[str, Any]:
    if option := next((key for key in OPTIONS if key in given), None):
        raise ValueError(f"{option} is not a hyper-parameter; use the option {OPTIONS[option]}.")
    if missing := [key for key in ("n_envs", "n_timesteps", "policy") if key not in given]:
        raise ValueError(f"{', '.join(missing)} must be given.")
    network = given.get("policy_kwargs") or {}
    network = _read_keywords(network) if isinstance(network, str) else network
    hyper = rules.check(algo, _as_numbers({**given, "policy_kwargs": network}))
    if ("noise_type" in hyper) != ("noise_std" in hyper):
        raise ValueError("noise_type and noise_std must be given together.")
    if algo == "a2c" and hyper.get("use_rms_prop", True) and "optimizer_kwargs" in hyper["policy_kwargs"]:
        raise ValueError("policy_kwargs.optimizer_kwargs are Adam's: they need use_rms_prop: false.")
    if algo in ("a2c", "ppo"):
        # Stable-Baselines3's defaults; advantages are normalized by their deviation, which is NaN for a single one.
        n_steps, normalized = {"a2c": (5, False), "ppo": (2048, True)}[algo]
        least = 2 if hyper.get("normalize_advantage", normalized) else 1
        Range(least, MOST_NUMBERS, whole=True).check("n_envs times n_steps", hyper["n_envs"] * hyper.get("n_steps", n_steps))
    elif hyper["n_envs"] > 1 and "episode" in str(hyper.get("train_freq")):
        raise ValueError(f"train_freq must be in steps where n_envs is more than 1, got {hyper['train_freq']!r}.")
    return hyper


def _read_keywords(text: str) -> dict[str, Any]:
    """Parse ``dict(name=literal, activation_fn=nn.Name)`` without running it; the name becomes text.

    The zoo passes ``policy_kwargs`` to Python's ``eval`` if it is text, and unchanged to the algorithm if it is a mapping. A
    mapping cannot name an activation function, so its files hold ``dict(net_arch=[64], activation_fn=nn.ReLU)`` as text.

    References:
        rl-baselines3-zoo 2.9.2, ``rl_zoo3/exp_manager.py``, ``_preprocess_hyperparams``.
    """
    with suppress(SyntaxError, ValueError, RecursionError):
        call = ast.parse(text.strip(), mode="eval").body
        if isinstance(call, ast.Call):
            return _literal(call)
    allowed = "a mapping, or text like 'dict(net_arch=[64, 64], activation_fn=nn.ReLU)'"
    raise refusal("policy_kwargs", allowed, text)


def _literal(node: ast.expr) -> Any:
    match node:
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords) if all(keyword.arg for keyword in keywords):
            return {str(keyword.arg): _literal(keyword.value) for keyword in keywords}
        case ast.Attribute(value=ast.Name(id="nn"), attr=name):
            return name
    return ast.literal_eval(node)
