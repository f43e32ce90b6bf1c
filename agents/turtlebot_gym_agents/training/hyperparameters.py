"""Hyper-parameters from YAML in the form of rl-baselines3-zoo; nothing in them is evaluated as code.

The zoo passes ``policy_kwargs`` to Python's ``eval`` where it is text, and as it is to the algorithm where it is a mapping; a
mapping cannot name an activation function. So the files hold ``policy_kwargs: dict(net_arch=[64, 64], activation_fn=nn.ReLU)``.
Here that text is parsed, and refused if it is anything but a call of ``dict`` with literals and names of ``nn``.

References:
    rl-baselines3-zoo 2.9.2, ``rl_zoo3/exp_manager.py``, ``_preprocess_hyperparams``.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from turtlebot_gym import files
from turtlebot_gym.validation import choose, shown
from turtlebot_gym_agents.files import replacing
from turtlebot_gym_agents.provenance import plain
from turtlebot_gym_agents.training.rules import MOST_NUMBERS, OURS, OWN_RULES, RULES, Rule, checked, network_rules

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

OPTIONS = {"env": "--env", "seed": "--seed", "device": "--device", "tensorboard_log": "--out"}
"""Arguments of the algorithm that are options of the training, not hyper-parameters."""


def configs_folder() -> Path:
    """Return the folder with the configurations shipped with the package."""
    installed = Path(str(resources.files("turtlebot_gym_agents"))) / "configs"
    return installed if installed.is_dir() else installed.parent.parent / "configs"


def load(algo: str, env: str, path: Path | None = None) -> dict[str, Any]:
    """Return the hyper-parameters of an algorithm for an environment.

    Args:
        algo: Name of the algorithm in lower case; without a path, of the file in the package.
        env: The environment's id; ``default`` in the file stands for those that it does not name.
        path: Another file.

    Raises:
        ValueError: If there is no such file, it has nothing for the environment, or what it has is of another form.
    """
    file = path or configs_folder() / f"{algo}.yaml"
    if not file.is_file():
        known = ", ".join(sorted(found.stem for found in configs_folder().glob("*.yaml")))
        raise ValueError(f"There are no hyper-parameters for {algo!r} in {file}; known algorithms: {known}.")
    content = files.load(file)
    chosen = content.get(env, content.get("default")) if isinstance(content, dict) else None
    if not isinstance(chosen, dict):
        raise ValueError(f"{file} must be a mapping with an entry {env!r} or 'default', which is a mapping.")
    missing = [key for key in OURS if key not in chosen]
    if missing:
        raise ValueError(f"{file}, {env}: {', '.join(missing)} must be given.")
    try:
        return checked_for(algo, chosen)
    except ValueError as error:
        raise ValueError(f"{file}, {env}: {error}") from error


def checked_for(algo: str, hyper: Mapping[str, Any]) -> dict[str, Any]:
    """Return hyper-parameters, checked by the rules and the signature of an algorithm, in the types that JSON knows.

    Args:
        algo: Name of the algorithm in lower case.
        hyper: The hyper-parameters; text under ``policy_kwargs`` becomes the mapping that it says.

    Raises:
        ValueError: See `arguments`, and if there is no such algorithm.
    """
    from turtlebot_gym_agents.training.algorithms import ALGORITHMS

    arguments(hyper, choose("algo", algo, ALGORITHMS))
    ours = {key: checked(key, hyper[key], OURS[key]) for key in OURS if key in hyper}
    return plain({**hyper, "policy_kwargs": _network_of(hyper), **ours})


def save(path: Path, env: str, hyper: dict[str, Any]) -> None:
    """Write hyper-parameters so that `load` reads them back, and rl-baselines3-zoo, too."""
    if isinstance(network := hyper.get("policy_kwargs"), dict):
        written = ", ".join(f"{key}={_written(key, value)}" for key, value in network.items())
        hyper = {**hyper, "policy_kwargs": f"dict({written})"}
    with replacing(path) as beside:
        beside.write_text(yaml.safe_dump({env: hyper}, sort_keys=False, width=128), encoding="utf-8")


def _written(key: str, value: Any) -> str:
    return f"nn.{str(value).removeprefix('nn.')}" if key == "activation_fn" else repr(value)


def _network_of(hyper: Mapping[str, Any]) -> Any:
    """Return ``policy_kwargs``, parsed if they are text."""
    network = hyper.get("policy_kwargs") or {}
    return _keywords(network) if isinstance(network, str) else network


def _keywords(text: str) -> dict[str, Any]:
    """Return what ``dict(name=literal, activation_fn=nn.Name)`` says, with the name as text, without running it."""
    try:
        call = ast.parse(text.strip(), mode="eval").body
        value = _value(call) if isinstance(call, ast.Call) else None
    except (SyntaxError, ValueError, RecursionError):
        value = None
    if value is None:
        raise ValueError(
            f"policy_kwargs must be a mapping, or text like 'dict(net_arch=[64, 64], activation_fn=nn.ReLU)', got {text!r}."
        )
    return value


def _value(node: ast.expr) -> Any:
    match node:
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords) if all(one.arg for one in keywords):
            return {str(one.arg): _value(one.value) for one in keywords}
        case ast.Attribute(value=ast.Name(id="nn"), attr=name):
            return name
    return ast.literal_eval(node)


def arguments(hyper: Mapping[str, Any], algorithm: type[BaseAlgorithm]) -> dict[str, Any]:
    """Return the keyword arguments of an algorithm: schedules, activations and exploration noise made from their names.

    Raises:
        ValueError: If one is unknown, of another type, out of its range, or does not go with another one; the message names it
            and says what is allowed.
    """
    who, known = algorithm.__name__, rules_of(algorithm)
    given = {key: value for key, value in hyper.items() if key not in (*OURS, "policy_kwargs")}
    if option := next((key for key in OPTIONS if key in given), None):
        raise ValueError(f"{option} is no hyper-parameter; use the option {OPTIONS[option]}.")
    _require_known(f"{who} has no hyper-parameter", given, [*known, *OURS, "policy_kwargs"])
    found = {key: checked(key, value, known[key]) for key, value in given.items()}
    ours = {key: checked(key, hyper[key], rule) for key, rule in OURS.items() if key in hyper}
    network = _network_of(hyper)
    if not isinstance(network, Mapping):
        raise ValueError(f"policy_kwargs must be a mapping, got {shown(network)}.")
    rules = network_rules_of(algorithm)
    _require_known(f"policy_kwargs of {who} has no", network, rules)
    found["policy_kwargs"] = {key: checked(f"policy_kwargs.{key}", value, rules[key]) for key, value in network.items()}
    _require_together(ours.get("n_envs", 1), found, algorithm)
    kind, std = found.pop("noise_type", None), found.pop("noise_std", None)
    return found | ({} if kind is None else {"action_noise": _action_noise(std)})


def rules_of(algorithm: type[BaseAlgorithm]) -> dict[str, Rule]:
    """Return the rules of the hyper-parameters that an algorithm has by its signature."""
    names = set(inspect.signature(algorithm).parameters)
    names |= {"noise_type", "noise_std"} if "action_noise" in names else set()
    return {name: rule for name, rule in (RULES | OWN_RULES.get(algorithm.__name__, {})).items() if name in names}


def network_rules_of(algorithm: type[BaseAlgorithm]) -> dict[str, Rule]:
    """Return the rules of ``policy_kwargs`` for an algorithm, by the signature of its policy."""
    names = inspect.signature(algorithm.policy_aliases["MlpPolicy"]).parameters
    return {name: rule for name, rule in network_rules("vf" if "ortho_init" in names else "qf").items() if name in names}


def _require_known(what: str, given: Mapping[Any, Any], known: Iterable[str]) -> None:
    """Raise ValueError if a name is unknown; the message has the nearest known one, or all."""
    names = sorted(known)
    for name in given:
        if name not in names:
            near = get_close_matches(str(name), names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(names)}."
            raise ValueError(f"{what} {shown(name)}: {hint}")


def _require_together(n_envs: int, found: Mapping[str, Any], algorithm: type[BaseAlgorithm]) -> None:
    """Raise ValueError if hyper-parameters do not go with each other."""
    defaults = {name: one.default for name, one in inspect.signature(algorithm).parameters.items()}
    value = {**defaults, **found}
    if ("noise_type" in found) != ("noise_std" in found):
        raise ValueError("noise_type and noise_std must be given together.")
    if value.get("use_rms_prop") and "optimizer_kwargs" in found["policy_kwargs"]:
        raise ValueError("policy_kwargs.optimizer_kwargs are Adam's: they need use_rms_prop: false.")
    if "gae_lambda" in value:
        rollout = n_envs * value["n_steps"]
        if not (2 if value["normalize_advantage"] else 1) <= rollout <= MOST_NUMBERS:
            raise ValueError(
                f"n_envs times n_steps must be from {2 if value['normalize_advantage'] else 1} to {MOST_NUMBERS}, got "
                f"{n_envs} times {value['n_steps']}."
            )
    elif n_envs > 1 and isinstance(value["train_freq"], tuple) and value["train_freq"][1] == "episode":
        raise ValueError(f"train_freq must be in steps where n_envs is more than 1, got {value['train_freq']!r} and {n_envs}.")


def _action_noise(std: float) -> Any:
    """Return the noise with which algorithms whose policy has none of its own explore."""
    import numpy as np
    from stable_baselines3.common.noise import NormalActionNoise

    return NormalActionNoise(np.zeros(2), np.full(2, std))
