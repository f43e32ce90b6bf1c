"""Make a policy bundle of what people have: models and networks of other libraries, and ONNX models.

The bundle takes along all that the policy needs: the normalization of observations, a stack of them, and the state of a
recurrent network. It is written only if it acts as the library itself does, in the environment of the training.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import closing
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym import Options
from turtlebot_gym.validation import as_int, refusal
from turtlebot_gym.variants import BASE, split
from turtlebot_gym_agents.ids import arguments_of, brought_by
from turtlebot_gym_agents.policies import PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import KEY, Card
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.policies.onnx_network import OnnxNetwork
from turtlebot_gym_agents.training import files
from turtlebot_gym_agents.training.config import base_of, require_env
from turtlebot_gym_agents.training.network import ROWS, STEPS, program_of, write_checked
from turtlebot_gym_agents.training.stages import Staged, normalization_of
from turtlebot_gym_agents.training.torch_policy import Called, TorchPolicy

NONE = "none"
"""Instead of statistics: observations were not normalized."""


class _Converted(NamedTuple):
    """A policy of another library as ONNX, and by its library."""

    program: Any
    original: PolicyWithMemory
    training: Mapping[str, Any]


def export(
    model: Any,
    path: str | Path,
    *,
    env: str | None = None,
    vec_normalize: Any = None,
    memory: int = 0,
    allow_pickle: bool = False,
    training: Mapping[str, Any] | None = None,
    card: Card | None = None,
    steps: int = STEPS,
    **options: Any,
) -> float:
    """Write a policy as a bundle, if both return the same actions.

    Args:
        model: A model of Stable-Baselines3 or sb3-contrib, with the `VecNormalize` and the `VecFrameStack` of its environment;
            a torch module, or a function of tensors, from observations (n, k) to actions (n, 2), of which those beyond 1 are
            clipped; an ONNX model that fits, which gets a card and is not changed; or a file of one, or the folder of a
            training, see `files.read`.
        path: The bundle's file, replaced atomically.
        env: Id of the environment that it was trained in; None for the one that the model or its folder names, else Nav.
        vec_normalize: What normalized observations: a `VecNormalize`, Gymnasium's `NormalizeObservation`, or "none"; None for
            what the model's environment has.
        memory: Of a torch module with a state: how many numbers that has. The module then maps observations and the state (n,
            memory), zeros where an episode begins, to actions and the next state.
        allow_pickle: Whether files may be read that can run code.
        training: Entries for the card about the training, such as library, version, algorithm, steps and seed.
        card: Card to write; None for that of the environment.
        steps: Steps on which the actions are compared, in 8 environments.
        **options: Arguments of the environment: ``robot``, ``noise``, ``filter``, ``observation``, ``dt`` and so on.

    Returns:
        The largest difference between the bundle's actions and the library's.

    Raises:
        ValueError: If the policy cannot be a bundle, or a part of what it needs is missing; the message says what to do.
        RuntimeError: If the difference is larger than `network.TOLERANCE`.
        ImportError: If the library of a file is missing.
    """
    found = files.Found(model=model)
    if isinstance(model, (str, Path)):
        found = files.read(Path(model), allow_pickle=allow_pickle)
        model = found.model
    known, own = _environment_of(model)
    env = require_env(env or found.env or known or "nav")
    trained = {**(own if env == known else {}), **(found.options if found.env in (None, env) else {})}
    options = {**trained, **{name: _based(value, name, env, trained) for name, value in options.items()}}
    with closing(_make(env, options)) as envs:
        space: Any = envs.single_observation_space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise refusal("env", "an environment whose observations are terms, such as those of this package", env)
        converted = _convert(model, space, env, NONE if found.training else vec_normalize, memory)
        if card is None:
            used = brought_by(env) | arguments_of(options)
            card = Card.of(env, used, parameters_of(envs), {**found.training, **converted.training, **(training or {})})
            card = card if found.noise is None else replace(card, noise=found.noise)
        return write_checked(converted.program, path, card, converted.original, envs, steps=steps)


def _based(value: Any, name: str, env: str, trained: Mapping[str, Any]) -> Any:
    """Return an option; a variant that leaves its base open is one of the training's."""
    if not (isinstance(value, Mapping) and value.get(BASE, "") is None):
        return value
    base, changes = split(trained.get(name, base_of(env, name)))
    return {BASE: base, **changes, **{key: part for key, part in value.items() if key != BASE}}


def _make(env: str, options: Mapping[str, Any]) -> VectorEnv:
    """Return the environments of the check."""
    return gym.make_vec(env, num_envs=ROWS, autoreset_mode=AutoresetMode.SAME_STEP, **arguments_of(options))


def _is_sb3(model: Any) -> bool:
    """Return whether an object is a model or a policy of Stable-Baselines3, which then is imported."""
    if "stable_baselines3" not in sys.modules:
        return False
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.policies import BasePolicy

    return isinstance(model, (BaseAlgorithm, BasePolicy))


def _environment_of(model: Any) -> tuple[str | None, dict[str, Any]]:
    """Return id and options of the environment that a model of Stable-Baselines3 was trained in, as far as it has one."""
    venv = model.get_env() if _is_sb3(model) and hasattr(model, "get_env") else None
    try:
        spec = None if venv is None else venv.get_attr("spec")[0]
    except (AttributeError, IndexError):
        spec = None
    if spec is None or spec.id not in registry:
        return None, {}
    names, registered = {item.name for item in fields(Options)}, registry[spec.id].kwargs
    return spec.id, {
        name: value
        for name, value in spec.kwargs.items()
        if name in names and not (name in registered and registered[name] == value)
    }


def _convert(model: Any, space: spaces.Box, env: str, vec_normalize: Any, memory: int) -> _Converted:
    """Return a policy of another library as ONNX, and by its library."""
    if _is_sb3(model):
        return _of_sb3(model, space, env, vec_normalize)
    size = space.shape[0]
    if type(model).__name__ == "ModelProto":
        return _Converted(model, _OnnxPolicy(model, size), {})
    layer = None if vec_normalize in (None, NONE) else normalization_of(vec_normalize)
    about = {"normalized": True} if layer else {}
    if layer is not None and layer.size != size:
        raise ValueError(f"vec_normalize must hold statistics of {size} observations, as {env} has, got {layer.size}.")
    if not callable(model):
        raise refusal("model", "a model of Stable-Baselines3, a torch module, a function of tensors or an ONNX model", model)
    network = model if isinstance(model, nn.Module) else Called(model)
    original = TorchPolicy(network, layer, as_int("memory", memory))
    original.try_on(space)
    staged = Staged([layer] if layer else [], network, memory)
    return _Converted(program_of(staged, size, staged.memory), original, {**about, **({"state": memory} if memory else {})})


class _OnnxPolicy:
    """An ONNX model as a policy, run as it is."""

    def __init__(self, model: Any, size: int) -> None:
        if any(entry.key == KEY for entry in model.metadata_props):
            raise ValueError("model is a policy bundle already: drive it as it is, --policy FILE.onnx.")
        self._network = OnnxNetwork("model", model.SerializeToString())
        self._network.require_shapes(size)
        self._memory = np.zeros((0, self._network.memory), np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._memory) != len(mask):
            self._memory = np.zeros((len(mask), self._network.memory), np.float32)
        self._memory = np.where(mask[:, None], np.float32(0.0), self._memory)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        actions, self._memory = self._network.run(observations, self._memory)
        return actions


def _of_sb3(model: Any, space: spaces.Box, env: str, vec_normalize: Any) -> _Converted:
    """Return a model of Stable-Baselines3 as ONNX, and by its own ``predict``."""
    from stable_baselines3.common.vec_env import VecNormalize

    from turtlebot_gym_agents.training import sb3_policy
    from turtlebot_gym_agents.training.sb3_network import network_of

    sb3_policy.require_actions(model)
    has_env = hasattr(model, "get_env") and model.get_env() is not None
    wrappers = sb3_policy.wrappers_of(model) if has_env else []
    own = [wrapper for wrapper in wrappers if isinstance(wrapper, VecNormalize)]
    if len(own) > 1:
        raise ValueError("model must be trained within at most one VecNormalize, got several.")
    if vec_normalize is None:
        if not has_env:
            raise ValueError(
                "model has no environment, which would say what normalized its observations: name their VecNormalize, "
                "export(model, ..., vec_normalize=...), or 'none'."
            )
        sb3_policy.require_no_observation_wrapper(model)
        vec_normalize = own[0] if own else NONE
    stages = sb3_policy.stages_of(model, space, env, None if vec_normalize == NONE else vec_normalize, wrappers)
    network, width = network_of(model)
    staged = Staged([stage.module for stage in stages], network, width)
    program = program_of(staged, space.shape[0], staged.memory)
    return _Converted(program, sb3_policy.Sb3Policy(model, stages), sb3_policy.library_of(model, stages, width))
