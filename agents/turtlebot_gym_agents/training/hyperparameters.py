"""Hyper-parameters: YAML in the form of rl-baselines3-zoo, which `model.make_model` passes on to Stable-Baselines3."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from turtlebot_gym import files
from turtlebot_gym.config import Range, refusal
from turtlebot_gym_agents.policies.named import shipped_folder

ROLLOUTS = 40
"""Fewest rollouts from which a training with the package's own hyper-parameters learns."""
FEWEST_ENVS = 8
"""Fewest environments of such a training."""
_OF_TRAINING = ("n_envs", "n_timesteps", "policy", "reward_scale")
"""Hyper-parameters that are no arguments of an algorithm."""


def load(algo: str, env: str, source: Path | Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the hyper-parameters of an algorithm, in lower case, for an environment's id, in JSON's types.

    ``source`` is a file, in which ``default`` stands for environments that it does not name, or the hyper-parameters
    themselves; None is the file that is shipped for the algorithm. Other forms are refused.
    """
    chosen: Any = source
    if not isinstance(source, Mapping):
        path = Path(source or shipped_folder("configs") / f"{algo}.yaml")
        if not path.is_file():
            raise ValueError(f"There is no {path}: give a file of hyper-parameters for {algo!r} with --config FILE.")
        content = files.load(path)
        chosen = content.get(env, content.get("default")) if isinstance(content, dict) else None
        if not isinstance(chosen, dict):
            raise ValueError(f"{path} must be a mapping with an entry {env!r} or 'default', which is a mapping.")
    hyper = {"policy": "MlpPolicy", **chosen}
    for name in ("n_envs", "n_timesteps"):
        Range(1, 10**12, whole=True).check(name, hyper.get(name))
    return hyper | {"policy_kwargs": _network(hyper.get("policy_kwargs") or {})}


def for_steps(hyper: Mapping[str, Any], steps: int) -> dict[str, Any]:
    """Return hyper-parameters for fewer steps than they were made for.

    An algorithm that learns from rollouts of ``n_steps`` then has fewer environments, and smaller batches in proportion, and
    still `ROLLOUTS` rollouts to learn from: 40,960 steps on Nav are ten rollouts of 512 environments, and forty of 128, after
    which a policy reaches all of its goals.
    """
    if "n_steps" not in hyper:
        return dict(hyper)
    fewer = min(hyper["n_envs"], max(FEWEST_ENVS, steps // (ROLLOUTS * hyper["n_steps"])))
    return {**hyper, "n_envs": fewer, "batch_size": hyper["batch_size"] * fewer // hyper["n_envs"]}


def override(hyper: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return hyper-parameters of which some are replaced, and of ``policy_kwargs`` those that are given."""
    merged = {**hyper, **changes}
    return merged | {"policy_kwargs": {**hyper["policy_kwargs"], **_network(merged["policy_kwargs"])}}


def arguments(hyper: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keyword arguments of an algorithm: schedules, classes and exploration noise made from their names."""
    import numpy as np
    import torch
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.utils import LinearSchedule

    made: dict[str, Any] = {key: value for key, value in hyper.items() if key not in _OF_TRAINING}
    for key, value in made.items():
        if isinstance(value, str) and value.startswith("lin_"):
            made[key] = LinearSchedule(float(value.removeprefix("lin_")), end=0.0, end_fraction=1.0)
        elif isinstance(value, list):
            made[key] = tuple(value)
    if made.get("noise_type") == "normal":
        del made["noise_type"]
        made["action_noise"] = NormalActionNoise(np.zeros(2), np.full(2, made.pop("noise_std", 0.0)))
    network = dict(made["policy_kwargs"])
    for key, home in {"activation_fn": torch.nn, "optimizer_class": torch.optim}.items():
        if key in network:
            name = str(network[key]).rpartition(".")[2]
            if not hasattr(home, name):
                raise refusal(f"policy_kwargs.{key}", f"a class of {home.__name__}", name)
            network[key] = getattr(home, name)
    return {**made, "policy_kwargs": network}


def _network(given: Any) -> dict[str, Any]:
    """Return ``policy_kwargs``, also from the zoo's text ``dict(net_arch=[64], activation_fn=nn.ReLU)``, which is not run."""
    with suppress(AttributeError, SyntaxError, TypeError, ValueError, RecursionError):
        if isinstance(given, str):
            keywords = ast.parse(given.strip(), mode="eval").body.keywords  # type: ignore[attr-defined]
            return {item.arg: getattr(item.value, "attr", None) or ast.literal_eval(item.value) for item in keywords}
        return dict(given)
    raise refusal("policy_kwargs", "a mapping, or text like 'dict(net_arch=[64, 64], activation_fn=nn.ReLU)'", given)
