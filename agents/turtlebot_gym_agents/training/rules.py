"""Rules of hyper-parameters: what each may be, how it is read, and the words that say so where it is something else.

YAML takes ``1e-3`` for text, so text that is a number is read as one; booleans are refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from turtlebot_gym.validation import shown

ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Sigmoid", "Softplus", "Mish")
"""Modules of torch.nn between the layers of a network."""
MOST_NUMBERS = 10**8
"""Steps that a rollout or a replay buffer may hold: a few gigabytes."""


class Rule(NamedTuple):
    """What a hyper-parameter may be."""

    allowed: str
    """In words."""
    read: Callable[[Any], Any]
    """Returns a value as the algorithm takes it; raises ValueError or TypeError where it is not allowed."""


class Linear:
    """A rate that falls linearly to zero; a class, so that a checkpoint can hold it."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, progress_remaining: float) -> float:
        # The last rollout goes beyond the total, and a negative rate would unlearn.
        return self.start * max(progress_remaining, 0.0)


def checked(name: str, value: Any, rule: Rule) -> Any:
    """Return a hyper-parameter as the algorithm takes it.

    Raises:
        ValueError: If it is not what the rule allows; the message names it and the rule.
    """
    try:
        return rule.read(value)
    except (TypeError, ValueError, OverflowError, LookupError, AttributeError):
        raise ValueError(f"{name} must be {rule.allowed}, got {shown(value)}.") from None


def real(low: float, high: float, *, above: bool = False) -> Rule:
    """Return the rule of a number in a range, whose lower end belongs to it unless it must be ``above``."""

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float, str)):
            raise TypeError
        number = float(value)
        if not low <= number <= high or (above and number == low):  # also refuses NaN
            raise ValueError
        return number

    return Rule(f"a number {'above' if above else 'from'} {low:g} {'and at most' if above else 'to'} {high:g}", read)


def whole(low: int, high: int) -> Rule:
    """Return the rule of a whole number in a range; 1e6 is one."""

    def read(value: Any) -> int:
        number = real(low, high).read(value)
        if number != math.floor(number):
            raise ValueError
        return value if isinstance(value, int) else int(number)

    return Rule(f"a whole number from {low} to {high:,}".replace(",", "_"), read)


def rate(high: float) -> Rule:
    """Return the rule of a positive number, or of one from which a rate falls linearly to zero."""
    number = real(0.0, high, above=True)

    def read(value: Any) -> Any:
        if isinstance(value, str) and value.startswith("lin_"):
            return Linear(number.read(value.removeprefix("lin_")))
        return number.read(value)

    return Rule(f"{number.allowed}, or such a number after 'lin_', from which it falls to 0", read)


def either(rule: Rule, *choices: Any) -> Rule:
    """Return the rule that some words or None will do, too."""

    def read(value: Any) -> Any:
        if any(value is choice or (isinstance(choice, str) and value == choice) for choice in choices):
            return value
        return rule.read(value)

    return Rule(f"{rule.allowed}, or {' or '.join('null' if one is None else repr(one) for one in choices)}", read)


def _truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


TRUTH = Rule("true or false", _truth)


def _entropy(value: Any) -> Any:
    if isinstance(value, str) and value.startswith("auto"):
        if value != "auto":
            real(0.0, 100.0, above=True).read(value.removeprefix("auto_"))
        return value
    return real(0.0, 100.0).read(value)


def _frequency(value: Any) -> Any:
    if not isinstance(value, (list, tuple)):
        return whole(1, 1_000_000).read(value)
    count, unit = value
    if unit not in ("step", "episode"):
        raise ValueError
    return whole(1, 1_000_000).read(count), unit


def _layers(value: Any) -> list[int]:
    if not isinstance(value, (list, tuple)) or len(value) > 16:
        raise TypeError
    return [whole(1, 8192).read(size) for size in value]


def network(critic: str) -> Rule:
    """Return the rule of a network's layers, where the critic's have a name of their own."""

    def read(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return _layers(value)
        if set(value) != {"pi", critic}:
            raise ValueError
        return {name: _layers(layers) for name, layers in value.items()}

    return Rule(
        f"a list of at most 16 sizes of layers, each from 1 to 8192, or a mapping of pi and {critic} to such lists", read
    )


def _activation(value: Any) -> Any:
    import torch

    name = value.removeprefix("nn.")
    if name not in ACTIVATIONS:
        raise ValueError
    return getattr(torch.nn, name)


def _no_action_noise(value: Any) -> str:
    if value != "normal":
        raise ValueError
    return value


RULES: dict[str, Rule] = {
    "learning_rate": rate(1.0),
    "gamma": real(0.0, 1.0),
    "gae_lambda": real(0.0, 1.0),
    "clip_range": rate(10.0),
    "clip_range_vf": either(rate(1000.0), None),
    "ent_coef": real(0.0, 100.0),
    "vf_coef": real(0.0, 100.0),
    "max_grad_norm": real(0.0, 1e6, above=True),
    "n_steps": whole(1, 1_000_000),
    "batch_size": whole(1, 10_000_000),
    "n_epochs": whole(1, 1000),
    "normalize_advantage": TRUTH,
    "use_sde": TRUTH,
    "use_sde_at_warmup": TRUTH,
    "sde_sample_freq": whole(-1, 1_000_000),
    "target_kl": either(real(0.0, 1000.0, above=True), None),
    "stats_window_size": whole(1, 1_000_000),
    "verbose": whole(0, 2),
    "rms_prop_eps": real(0.0, 1.0, above=True),
    "use_rms_prop": TRUTH,
    "buffer_size": whole(1, MOST_NUMBERS),
    "learning_starts": whole(0, 10**9),
    "tau": real(0.0, 1.0, above=True),
    "train_freq": Rule("a whole number from 1 to 1_000_000, or such a number with 'step' or 'episode'", _frequency),
    "gradient_steps": Rule(
        "a whole number from 1 to 1_000_000, or -1 for as many as there were steps",
        lambda value: -1 if value == -1 and not isinstance(value, bool) else whole(1, 1_000_000).read(value),
    ),
    "target_update_interval": whole(1, 1_000_000),
    "target_entropy": either(real(-1000.0, 1000.0), "auto"),
    "policy_delay": whole(1, 1000),
    "target_policy_noise": real(0.0, 10.0),
    "target_noise_clip": real(0.0, 10.0),
    "noise_type": Rule("'normal'", _no_action_noise),
    "noise_std": real(0.0, 10.0),
}
"""Arguments of Stable-Baselines3's algorithms by name, and the exploration noise's two; which of them an algorithm has, its
signature says."""

OWN_RULES: dict[str, dict[str, Rule]] = {
    "PPO": {"batch_size": whole(2, 10_000_000)},
    "SAC": {"ent_coef": Rule("a number from 0 to 100, 'auto', or 'auto_' and the number to begin with", _entropy)},
}
"""Those that are other ones for an algorithm."""

OURS: dict[str, Rule] = {
    "n_envs": whole(1, 1_000_000),
    "n_timesteps": whole(1, 10**12),
    "policy": Rule("'MlpPolicy'", lambda value: {"MlpPolicy": "MlpPolicy"}[value]),
}
"""What is no argument of an algorithm; all of it must be given."""


def network_rules(critic: str) -> dict[str, Rule]:
    """Return the rules of ``policy_kwargs``, of which a policy's signature says which it has."""
    return {
        "net_arch": network(critic),
        "activation_fn": Rule(f"one of {', '.join(ACTIVATIONS)}", _activation),
        "ortho_init": TRUTH,
        "log_std_init": real(-20.0, 5.0),
        "full_std": TRUTH,
        "use_expln": TRUTH,
        "share_features_extractor": TRUTH,
        "clip_mean": real(0.0, 100.0),
        "n_critics": whole(1, 16),
        "optimizer_kwargs": Rule("a mapping of numbers: eps, weight_decay and betas", _optimizer),
    }


def _optimizer(value: Any) -> dict[str, Any]:
    rules = {"eps": real(0.0, 1.0, above=True), "weight_decay": real(0.0, 1.0)}
    share = real(0.0, 1.0 - 1e-9)
    if not isinstance(value, Mapping):
        raise TypeError
    return {
        name: _pair(given, share) if name == "betas" else rules[name].read(given) if name in rules else _unknown()
        for name, given in value.items()
    }


def _pair(value: Any, rule: Rule) -> tuple[Any, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise TypeError
    return tuple(map(rule.read, value))


def _unknown() -> Any:
    raise ValueError
