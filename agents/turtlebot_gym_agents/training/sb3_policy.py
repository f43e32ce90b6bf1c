"""A model of Stable-Baselines3 or sb3-contrib: the stages before its network, and its own ``predict``."""

from __future__ import annotations

import importlib
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import ObservationWrapper, spaces
from gymnasium.vector import VectorObservationWrapper
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from stable_baselines3.common.vec_env.stacked_observations import StackedObservations
from torch import nn

from turtlebot_gym.config import short_repr
from turtlebot_gym_agents.training.stages import FrameStack, Normalization, normalization_of, other_size

_SEES_NOTHING = ("VecMonitor", "VecCheckNan", "VecVideoRecorder")
"""Wrappers of Stable-Baselines3 that leave observations as they are."""


def discrete(name: str) -> ValueError:
    """Return the error for a model that chooses among discrete actions."""
    return ValueError(
        f"model of {name} chooses among discrete actions, and a bundle's are two numbers, shares of the robot's limits: train "
        "PPO, SAC or TD3 in the environment itself, without a wrapper of its actions."
    )


class Sb3Stage(NamedTuple):
    """A wrapper between the environment and the model: its part of the bundle, and the library's object."""

    module: nn.Module
    source: Any
    """The `VecNormalize`, or for a stack the space of what it stacks."""


class Sb3Policy:
    """A model as its library drives it: with its normalization, its stack, and the state that it carries.

    Args:
        model: The model, or a policy of one.
        stages: The stages before it, from the environment on.
    """

    def __init__(self, model: BaseAlgorithm | BasePolicy, stages: list[Sb3Stage]) -> None:
        self._model, self._stages = model, stages
        self._begins, self._state = np.ones(0, np.bool_), None
        self._stacks: dict[int, StackedObservations] = {}

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._begins) != len(mask):
            self._begins, self._state = np.ones(len(mask), np.bool_), None
            self._stacks = {
                place: StackedObservations(len(mask), stage.module.count, stage.source)
                for place, stage in enumerate(self._stages)
                if isinstance(stage.module, FrameStack)
            }
        self._begins = self._begins | mask

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen: Any = observations
        for place, (module, source) in enumerate(self._stages):
            if isinstance(module, FrameStack):
                last = [{"terminal_observation": row} if begins else {} for row, begins in zip(seen, self._begins, strict=True)]
                seen, _ = self._stacks[place].update(seen, self._begins, last)
            elif hasattr(source, "normalize_obs"):
                seen = source.normalize_obs(seen)
            else:
                seen = module(torch.from_numpy(seen)).numpy()
        starts = self._begins
        actions, self._state = self._model.predict(seen, state=self._state, episode_start=starts, deterministic=True)  # type: ignore
        self._begins = np.zeros(len(starts), np.bool_)
        return actions


def wrappers_of(model: BaseAlgorithm) -> list[Any]:
    """Return the wrappers of a model's environment that change observations, from the environment on.

    Raises:
        ValueError: If one of them does so in a way that a bundle cannot.
    """
    found = list[Any]()
    env: Any = model.get_env()
    while env is not None and hasattr(env, "venv"):
        if isinstance(env, (VecNormalize, VecFrameStack)):
            found.append(env)
        elif type(env).__name__ not in _SEES_NOTHING:
            raise _lost(type(env).__name__)
        env = env.venv
    return found[::-1]


def _lost(name: str) -> ValueError:
    return ValueError(
        f"model was trained within {name}, which a bundle does not have, and would act on other observations: train it without "
        "that wrapper, with VecNormalize, VecFrameStack or the option observation=..., which an export takes along."
    )


def require_no_observation_wrapper(model: BaseAlgorithm) -> None:
    """Refuse a model whose environments are wrapped by Gymnasium's or somebody's own observation wrappers."""
    env: Any = model.get_env()
    env = None if env is None else env.unwrapped
    layers = [env.envs, *(env.envs if isinstance(env.envs, list) else ())] if hasattr(env, "envs") else []
    for layer in layers:
        while layer is not None and not isinstance(layer, list):
            if isinstance(layer, (ObservationWrapper, VectorObservationWrapper)):
                raise _lost(type(layer).__name__)
            layer = getattr(layer, "env", None)


def require_actions(model: BaseAlgorithm | BasePolicy) -> None:
    """Refuse a model whose actions are not two numbers in [-1, 1]."""
    space, name = model.action_space, type(model).__name__
    if isinstance(space, (spaces.Discrete, spaces.MultiDiscrete, spaces.MultiBinary)):
        raise discrete(name)
    if (
        not isinstance(space, spaces.Box)
        or space.shape != (2,)
        or not (np.all(space.low == -1.0) and np.all(space.high == 1.0))
    ):
        raise ValueError(
            f"model must have actions (2,) in [-1, 1], as the environments have, got {short_repr(space)}: train it without a "
            "wrapper of the actions."
        )


def stages_of(
    model: BaseAlgorithm | BasePolicy, space: spaces.Box, env: str, statistics: Any, wrappers: list[Any]
) -> list[Sb3Stage]:
    """Return the stages between an environment and a model.

    Args:
        model: The model.
        space: The environment's space of observations.
        env: The environment's id, for messages.
        statistics: What normalizes observations: an object as for `normalization_of`, or None.
        wrappers: `wrappers_of` the model; if there are any, the stack of them is taken.

    Raises:
        ValueError: If the model does not read such observations, or a stack of them.
    """
    seen: Any = model.observation_space
    size = space.shape[0]
    count, rest = divmod(seen.shape[0], size) if isinstance(seen, spaces.Box) and len(seen.shape) == 1 else (0, 1)
    if rest or not count:
        is_row = isinstance(seen, spaces.Box) and len(seen.shape) == 1
        raise other_size(size, env, seen.shape[0] if is_row else short_repr(seen))
    stages = list[Sb3Stage]()
    layer = None if statistics is None else normalization_of(statistics)
    stack = Sb3Stage(FrameStack(count, size), space)
    if layer is None:
        stages = [stack] * (count > 1)
    elif count == 1 or layer.size == size:
        stages = [Sb3Stage(layer, statistics), *([stack] * (count > 1))]
    else:
        stages = [stack, Sb3Stage(layer, statistics)]
    if layer is not None and layer.size not in (size, count * size):
        raise ValueError(f"vec_normalize must hold statistics of {size} observations, as {env} has, got {layer.size}.")
    stacked = [env for env in wrappers if isinstance(env, VecFrameStack)]
    if wrappers and len(stacked) != (count > 1):
        raise ValueError(
            f"model must be trained within at most one VecFrameStack, of {count} observations, got {len(stacked)}."
        )
    bounds = [np.repeat(bound, count) for bound in (space.low, space.high)]  # as VecFrameStack has them
    same = np.allclose(seen.low, bounds[0]) and np.allclose(seen.high, bounds[1])
    is_normalized = layer is not None and not isinstance(statistics, VecNormalize)  # by Gymnasium: without bounds
    if not (same or is_normalized):
        raise ValueError(
            f"model must read the observations of {env}, as they are or by VecNormalize and VecFrameStack, but its observation "
            f"space has other bounds than {'a stack of them' if count > 1 else 'they have'}: another wrapper changed them, "
            "or they were of another task (--env) or terms (--observation). For Gymnasium's NormalizeObservation call "
            "export(model, ..., vec_normalize=WRAPPER) in Python."
        )
    return stages


def library_of(model: BaseAlgorithm | BasePolicy, stages: list[Sb3Stage], memory: int) -> dict[str, Any]:
    """Return what a card says of a model."""
    kind = next(kind for kind in type(model).__mro__ if kind.__module__.startswith(("stable_baselines3", "sb3_contrib")))
    library = importlib.import_module(kind.__module__.partition(".")[0])
    stacks = [stage.module.count for stage in stages if isinstance(stage.module, FrameStack)]
    return {
        "library": f"{library.__name__} {library.__version__}",
        "algorithm": type(model).__name__,
        "steps": getattr(model, "num_timesteps", None),
        **({"normalized": True} if any(isinstance(stage.module, Normalization) for stage in stages) else {}),
        **({"frame_stack": stacks[0]} if stacks else {}),
        **({"state": memory} if memory else {}),
    }
