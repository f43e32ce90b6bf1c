"""Keyword arguments of Stable-Baselines3's algorithms: made from hyper-parameters, and checked by name and type."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from inspect import signature
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.utils import LinearSchedule

from turtlebot_gym.config import did_you_mean, refusal
from turtlebot_gym_agents.training.config import NAMES

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {name: getattr(stable_baselines3, name.upper()) for name in NAMES}
"""The algorithms of Stable-Baselines3 by their names in lower case."""
NETWORK = "policy_kwargs"
"""The argument that holds those of the network."""
_OURS = ("policy", "env", "seed", "device", "tensorboard_log", "_init_setup_model")
"""Arguments of the algorithms that are options of a training, or set here."""
ELSEWHERE = {
    "n_timesteps": "the option steps",
    "tensorboard_log": "the folder tensorboard in that of the run",
    "_init_setup_model": "set by the training",
}
"""Names that are no hyper-parameters of a training, and what they are instead."""
_OF_TRAINING = ("n_envs", "n_timesteps", "policy", "reward_scale")
"""Hyper-parameters that are no arguments of an algorithm."""
_NOISE = ("noise_type", "noise_std")
"""Those that make the argument ``action_noise``."""
_FEATURES = ("features_extractor_class", "features_extractor_kwargs")
_OF_NETWORK = ("observation_space", "action_space", "lr_schedule", "use_sde", *_FEATURES)
"""Arguments of networks that are set here."""
_CLASSES = {"activation_fn": (torch.nn, "ReLU"), "optimizer_class": (torch.optim, "Adam")}
"""Arguments of networks that are classes of a module, with an example."""
_ZOO = {
    "normalize": "observations are normalized within the policy, and rewards are not: leave it out.",
    "frame_stack": "the option --observation shows past values, such as 'ekf,scan*2': leave it out.",
    **dict.fromkeys(("env_wrapper", "vec_env_wrapper", "monitor_kwargs", "callback", "vec_env_class"), "leave it out."),
}
"""Settings of rl-baselines3-zoo that are no arguments of an algorithm, and what to do instead."""


def arguments(algo: str, hyper: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keyword arguments of an algorithm: schedules, activations and exploration noise made from their names.

    Args:
        algo: A name in `ALGORITHMS`.
        hyper: Hyper-parameters by `hyperparameters.load`.

    Raises:
        ValueError: If the algorithm has no such argument, or a value is of another type than the argument.
    """
    made: dict[str, Any] = {key: _made(value) for key, value in hyper.items() if key not in _OF_TRAINING}
    if made.get("noise_type") == "normal":
        del made["noise_type"]
        made["action_noise"] = NormalActionNoise(np.zeros(2), np.full(2, made.pop("noise_std", 0.0)))
    known = _parameters(algo)
    for name, value in made.items():
        if name in ("env", "seed", "device"):
            raise ValueError(f"{name} is no hyper-parameter: use the option --{name}.")
        if name in _ZOO:
            raise ValueError(f"{name} is of rl-baselines3-zoo, and no hyper-parameter of a training here: {_ZOO[name]}")
        if name not in known:
            raise ValueError(f"{algo} has no hyper-parameter {name!r}; it has {', '.join(known)}.{did_you_mean(name, known)}")
        if name != NETWORK:
            _require_type(name, known[name], value)
    return {**made, NETWORK: _network(algo, hyper)}


def names_of(algo: str, policy: str = "MlpPolicy") -> tuple[str, ...]:
    """Return the names of an algorithm's hyper-parameters, those of its network with a dot."""
    noise = _NOISE if "action_noise" in (known := _parameters(algo)) else ()
    network = (f"{NETWORK}.{name}" for name in _network_parameters(algo, policy))
    return ("n_envs", "policy", "reward_scale", *known, *noise, *network)


def _parameters(algo: str) -> dict[str, tuple[Any, Any]]:
    """Return the type and the default of each argument of an algorithm, besides those that are set here."""
    return _of(ALGORITHMS[algo], _OURS)


def _network_parameters(algo: str, policy: str) -> dict[str, tuple[Any, Any]]:
    return _of(ALGORITHMS[algo].policy_aliases[policy], _OF_NETWORK)


def _of(owner: type, left_out: tuple[str, ...]) -> dict[str, tuple[Any, Any]]:
    parameters = signature(owner).parameters.items()
    return {name: (item.annotation, item.default) for name, item in parameters if name not in left_out}


def _network(algo: str, hyper: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keyword arguments of the network."""
    network, policy = dict(hyper[NETWORK]), hyper["policy"]
    known = {}
    if isinstance(policy, str) and policy in ALGORITHMS[algo].policy_aliases:
        known = _network_parameters(algo, policy)
    for name, value in network.items():
        if name in _CLASSES:
            home, example = _CLASSES[name]
            if not hasattr(home, str(value)):
                raise refusal(f"{NETWORK}.{name}", f"a module of {home.__name__}, such as {example}", value)
            network[name] = getattr(home, str(value))
        elif name in known:
            _require_type(f"{NETWORK}.{name}", known[name], value)
        elif known and isinstance(name, str) and name not in _OF_NETWORK:
            raise ValueError(f"{NETWORK} has no {name!r}; it has {', '.join(known)}.{did_you_mean(name, known)}")
    return network


def _made(value: Any) -> Any:
    if isinstance(value, str) and value.startswith("lin_"):
        with suppress(ValueError):  # another text stays one, and is refused
            return LinearSchedule(float(value.removeprefix("lin_")), end=0.0, end_fraction=1.0)
    return tuple(value) if isinstance(value, list) else value


def _require_type(name: str, parameter: tuple[Any, Any], value: Any) -> None:
    """Refuse a value of another type than an argument, which is given with its default."""
    kind, default = parameter
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if not any(_is(one, value) for one in kinds):
        if any((get_origin(one) or one) is type for one in kinds):
            raise ValueError(f"{name} is a class, which data cannot name: leave it out, or train in Python.")
        raise refusal(name, f"a value such as {default!r}" if default is not None else f"of type {_named(kinds)}", value)


def _is(kind: Any, value: Any) -> bool:
    kind = get_origin(kind) or kind
    if kind in (Any, object):
        return True
    if kind is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind is Callable:
        return callable(value) and not isinstance(value, type)
    return isinstance(kind, type) and isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _named(kinds: tuple[Any, ...]) -> str:
    shown = [getattr(get_origin(one) or one, "__name__", str(one)) for one in kinds if one is not NoneType]
    return " or ".join(dict.fromkeys(shown))
