"""Make a policy bundle of what people have: models and networks of other libraries, and their files.

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
import torch
from gymnasium import spaces
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorEnv
from torch import nn

from turtlebot_gym import Options
from turtlebot_gym.validation import as_int, refusal
from turtlebot_gym.variants import BASE, split
from turtlebot_gym_agents.front.defaults import NAV
from turtlebot_gym_agents.ids import arguments_of, brought_by
from turtlebot_gym_agents.policies import PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import Card
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.training import files
from turtlebot_gym_agents.training.config import base_of, require_env
from turtlebot_gym_agents.training.foreign_onnx import OnnxPolicy, network_model, script_model
from turtlebot_gym_agents.training.network import ROWS, STEPS, program_of, write_checked
from turtlebot_gym_agents.training.stages import Staged, normalization_of, other_size
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
            clipped; a TorchScript module; an ONNX model; or a file of one of these, or the folder of a training, see
            `files.read`.
        path: The bundle's file, replaced atomically.
        env: Id of the environment that it was trained in; None for the one that the model or its folder names, else Nav.
        vec_normalize: What normalized observations: a `VecNormalize`, Gymnasium's `NormalizeObservation`, a file of the first,
            or "none"; None for what the model's environment has, or what lies beside the file.
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
    env = require_env(env or found.env or known or NAV)
    trained = {**(own if env == known else {}), **(found.options if found.env in (None, env) else {})}
    options = {**trained, **{name: _based(value, name, env, trained) for name, value in options.items()}}
    with closing(_make(env, options)) as envs:
        space: Any = envs.single_observation_space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise refusal("env", "an environment whose observations are terms, such as those of this package", env)
        converted = _convert(model, space, env, vec_normalize, memory, found, allow_pickle)
        if card is None:
            used = brought_by(env) | arguments_of(options)
            card = Card.of(env, used, parameters_of(envs), {**found.training, **converted.training, **(training or {})})
            card = card if found.noise is None else replace(card, noise=found.noise)
        try:
            return write_checked(converted.program, path, card, converted.original, envs, steps=steps)
        except ValueError as error:
            if getattr(converted.original, "one", False):
                raise ValueError(
                    f"model was exported for one observation: export it with a dynamic first axis: {error}"
                ) from error
            raise


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


def _convert(
    model: Any, space: spaces.Box, env: str, vec_normalize: Any, memory: int, found: files.Found, allow_pickle: bool
) -> _Converted:
    """Return a policy of another library as ONNX, and by its library."""
    if isinstance(vec_normalize, (str, Path)) and vec_normalize != NONE:
        vec_normalize = files.load_statistics(Path(vec_normalize), allow_pickle=allow_pickle)
    if _is_sb3(model):
        return _of_sb3(model, space, env, vec_normalize, found.statistics, allow_pickle)
    if vec_normalize is None and found.statistics:
        raise ValueError(
            f"model may need the statistics in {found.statistics[0]}, and does not say so: name them, --vec-normalize FILE, or "
            "--vec-normalize none (vec_normalize=...) if its observations were not normalized."
        )
    layer = None if vec_normalize in (None, NONE) else normalization_of(vec_normalize)
    size, about = space.shape[0], {"normalized": True} if layer else {}
    if layer is not None and layer.size != size:
        raise ValueError(f"vec_normalize must hold statistics of {size} observations, as {env} has, got {layer.size}.")
    if isinstance(model, torch.jit.ScriptModule):
        original = TorchPolicy(model, layer, 0)
        original.try_on(space)
        script = script_model(model, size)
        return _Converted(network_model(script, OnnxPolicy(script, layer), size), original, about)
    if type(model).__name__ == "ModelProto":
        original = OnnxPolicy(model, layer)
        if isinstance(original.size, int) and original.size != size:
            raise other_size(size, env, original.size)
        return _Converted(network_model(model, original, size), original, about)
    if not callable(model):
        rule = "a model of Stable-Baselines3, a torch module, a function of tensors, an ONNX model or a file of one"
        raise refusal("model", rule, model)
    network = model if isinstance(model, nn.Module) else Called(model)
    original = TorchPolicy(network, layer, as_int("memory", memory))
    original.try_on(space)
    staged = Staged([layer] if layer else [], network, memory)
    return _Converted(program_of(staged, size, staged.memory), original, {**about, **({"state": memory} if memory else {})})


def _of_sb3(
    model: Any, space: spaces.Box, env: str, vec_normalize: Any, beside: tuple[Path, ...], allow_pickle: bool
) -> _Converted:
    """Return a model of Stable-Baselines3 as ONNX, and by its own ``predict``."""
    from stable_baselines3.common.vec_env import VecNormalize

    from turtlebot_gym_agents.training import sb3_policy
    from turtlebot_gym_agents.training.sb3_network import network_of

    sb3_policy.require_actions(model)
    wrappers = sb3_policy.wrappers_of(model) if hasattr(model, "get_env") else []
    own = [wrapper for wrapper in wrappers if isinstance(wrapper, VecNormalize)]
    if len(own) > 1:
        raise ValueError("model must be trained within at most one VecNormalize, got several.")
    statistics, doubt = None, ""
    if vec_normalize is None and hasattr(model, "get_env"):
        sb3_policy.require_no_observation_wrapper(model)
    if vec_normalize == NONE:
        doubt = "vec_normalize cannot be none"
    elif vec_normalize is not None:
        statistics = vec_normalize
    elif own:
        statistics = own[0]
    elif (needs := sb3_policy.was_normalized(model, space)) or (
        needs is None and (beside or getattr(model, "num_timesteps", 0))
    ):
        statistics = files.load_statistics(_one_of(beside), allow_pickle=allow_pickle)
    else:
        doubt = "statistics are missing"
    stages = sb3_policy.stages_of(model, space, env, statistics, wrappers)
    if doubt:
        sb3_policy.require_within(model, space, doubt)
    network, width = network_of(model)
    staged = Staged([stage.module for stage in stages], network, width)
    program = program_of(staged, space.shape[0], staged.memory)
    return _Converted(program, sb3_policy.Sb3Policy(model, stages), sb3_policy.library_of(model, stages, width))


def _one_of(beside: tuple[Path, ...]) -> Path:
    """Return the only file of statistics beside a model that needs one."""
    if len(beside) == 1:
        return beside[0]
    found = (
        f"several are beside it: {', '.join(path.name for path in beside)}" if beside else "no vecnormalize.pkl is beside it"
    )
    raise ValueError(
        f"model was trained within VecNormalize, and needs its statistics, but {found}: name them, --vec-normalize FILE "
        "(vec_normalize=...), or none if only rewards were normalized."
    )
