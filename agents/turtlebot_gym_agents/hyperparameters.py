"""Hyper-parameters from YAML, in the form that rl-baselines3-zoo reads; nothing in them is evaluated as code."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

OURS = ("n_envs", "n_timesteps", "policy")
"""Keys that are not arguments of the algorithm."""


def configs_folder() -> Path:
    """Return the folder with the configurations that come with the package."""
    installed = Path(str(resources.files("turtlebot_gym_agents"))) / "configs"
    return installed if installed.is_dir() else installed.parent.parent / "configs"


def load(algo: str, env: str, path: Path | None = None) -> dict[str, Any]:
    """Return the hyper-parameters of an algorithm for an environment.

    Args:
        algo: Name of the algorithm in lower case; without a path, of the file in the package.
        env: The environment's id; ``default`` in the file stands for those that it does not name.
        path: Another file.

    Raises:
        ValueError: If there is no such file, or it has nothing for the environment.
    """
    file = path or configs_folder() / f"{algo}.yaml"
    if not file.is_file():
        known = ", ".join(sorted(found.stem for found in configs_folder().glob("*.yaml")))
        raise ValueError(f"There are no hyper-parameters for {algo!r} in {file}; known algorithms: {known}.")
    content = yaml.safe_load(file.read_text())
    if not isinstance(content, dict) or not ({env, "default"} & set(content)):
        raise ValueError(f"{file} must be a mapping with an entry {env!r} or 'default'.")
    chosen = content.get(env, content.get("default"))
    missing = [key for key in OURS if key not in chosen]
    if missing:
        raise ValueError(f"{file}, {env}: {', '.join(missing)} must be given.")
    return dict(chosen)


def arguments(hyper: dict[str, Any]) -> dict[str, Any]:
    """Return the keyword arguments of the algorithm: schedules and activations made from their names.

    Raises:
        ValueError: If a name is not understood.
    """
    import torch

    keywords = {key: value for key, value in hyper.items() if key not in OURS}
    for key in ("learning_rate", "clip_range"):
        if isinstance(keywords.get(key), str):
            keywords[key] = _schedule(key, keywords[key])
    network = dict(keywords.pop("policy_kwargs", {}))
    if "activation_fn" in network:
        activation = getattr(torch.nn, str(network["activation_fn"]).removeprefix("nn."), None)
        if not (isinstance(activation, type) and issubclass(activation, torch.nn.Module)):
            raise ValueError(f"activation_fn must name a module of torch.nn, got {network['activation_fn']!r}.")
        network["activation_fn"] = activation
    return {**keywords, "policy_kwargs": network}


def _schedule(key: str, text: str) -> Callable[[float], float]:
    """Return the linear schedule that ``lin_x`` stands for."""
    kind, _, number = text.partition("_")
    try:
        start = float(number)
    except ValueError:
        start = -1.0
    if kind != "lin" or start < 0.0:
        raise ValueError(f"{key} must be a number or 'lin_' and a number, got {text!r}.")
    return _Linear(start)


class _Linear:
    """A rate that falls linearly to zero; a class, so that a checkpoint can hold it."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, progress_remaining: float) -> float:
        return self.start * progress_remaining
