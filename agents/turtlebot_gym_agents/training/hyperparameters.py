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
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from turtlebot_gym_agents.files import replacing

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

OURS = ("n_envs", "n_timesteps", "policy")
"""Keys that are not arguments of the algorithm; all of them must be given."""
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
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{file} is not YAML: {error}.") from error
    chosen = content.get(env, content.get("default")) if isinstance(content, dict) else None
    if not isinstance(chosen, dict):
        raise ValueError(f"{file} must be a mapping with an entry {env!r} or 'default', which is a mapping.")
    missing = [key for key in OURS if key not in chosen]
    if missing:
        raise ValueError(f"{file}, {env}: {', '.join(missing)} must be given.")
    if option := next((key for key in OPTIONS if key in chosen), None):
        raise ValueError(f"{file}, {env}: {option} is no hyper-parameter; use the option {OPTIONS[option]}.")
    whole = {key: int(_number(key, chosen[key])) for key in ("n_envs", "n_timesteps")}
    if not all(number > 0 for number in whole.values()):
        raise ValueError(f"{file}, {env}: n_envs and n_timesteps must be positive, got {whole}.")
    if isinstance(text := chosen.get("policy_kwargs"), str):
        chosen = {**chosen, "policy_kwargs": _keywords(text)}
    return {**chosen, **whole}


def save(path: Path, env: str, hyper: dict[str, Any]) -> None:
    """Write hyper-parameters so that `load` reads them back, and rl-baselines3-zoo, too."""
    if isinstance(network := hyper.get("policy_kwargs"), dict):
        written = ", ".join(f"{key}={_written(key, value)}" for key, value in network.items())
        hyper = {**hyper, "policy_kwargs": f"dict({written})"}
    with replacing(path) as beside:
        beside.write_text(yaml.safe_dump({env: hyper}, sort_keys=False, width=128), encoding="utf-8")


def _written(key: str, value: Any) -> str:
    return f"nn.{str(value).removeprefix('nn.')}" if key == "activation_fn" else repr(value)


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


def arguments(hyper: dict[str, Any], algorithm: type[BaseAlgorithm]) -> dict[str, Any]:
    """Return the keyword arguments of an algorithm: schedules, activations and exploration noise made from their names.

    Raises:
        ValueError: If a name is not understood.
    """
    import torch

    keywords = {key: value for key, value in hyper.items() if key not in (*OURS, "policy_kwargs")}
    for key, value in keywords.items():
        if isinstance(value, str):
            keywords[key] = _rate(key, value) if key in ("learning_rate", "clip_range") else _plain(value)
    network = hyper.get("policy_kwargs", {})
    network = dict(network) if isinstance(network, dict) else _keywords(str(network))
    if "activation_fn" in network:
        activation = getattr(torch.nn, str(network["activation_fn"]).removeprefix("nn."), None)
        if not (isinstance(activation, type) and issubclass(activation, torch.nn.Module)):
            raise ValueError(f"activation_fn must name a module of torch.nn, got {network['activation_fn']!r}.")
        network["activation_fn"] = activation
    kind, std = keywords.pop("noise_type", None), keywords.pop("noise_std", None)
    if kind is not None:
        keywords["action_noise"] = _action_noise(kind, _number("noise_std", std))
    unknown = set(keywords) - set(inspect.signature(algorithm).parameters)
    if unknown:
        raise ValueError(f"{algorithm.__name__} has no arguments {', '.join(sorted(unknown))}.")
    return {**keywords, "policy_kwargs": network}


def _plain(text: str) -> float | str:
    """Return a number that YAML takes for text, such as 1e-3; other text, such as "auto", as it is."""
    try:
        return float(text)
    except ValueError:
        return text


def _number(key: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{key} must be a number, got {value!r}.") from None


def _rate(key: str, text: str) -> Any:
    """Return the number, or the linear schedule that ``lin_x`` stands for."""
    linear = text.startswith("lin_")
    try:
        start = float(text.removeprefix("lin_"))
    except ValueError:
        start = -1.0
    if not start >= 0.0:
        raise ValueError(f"{key} must be a number or 'lin_' and a number, got {text!r}.")
    return _Linear(start) if linear else start


def _action_noise(kind: str, std: float) -> Any:
    """Return the noise with which algorithms whose policy has none of its own explore."""
    import numpy as np
    from stable_baselines3.common.noise import NormalActionNoise

    if kind != "normal":
        raise ValueError(f"noise_type must be 'normal', got {kind!r}.")
    return NormalActionNoise(np.zeros(2), np.full(2, std))


class _Linear:
    """A rate that falls linearly to zero; a class, so that a checkpoint can hold it."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, progress_remaining: float) -> float:
        # The last rollout exceeds the total, and a negative rate would unlearn.
        return self.start * max(progress_remaining, 0.0)
