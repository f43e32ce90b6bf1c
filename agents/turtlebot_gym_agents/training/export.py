"""Make a policy bundle of a model of Stable-Baselines3, a torch module, or an ONNX model that fits.

The bundle takes along all that the policy needs: the normalization of observations, and the state of a recurrent network. It is
written only if it acts as the library itself does, in the environment of the training.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from gymnasium import spaces
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorObservationWrapper

from turtlebot_gym import Options
from turtlebot_gym.config import choose, refusal, short_repr
from turtlebot_gym.files import load, replacing
from turtlebot_gym_agents.commands.console import needs
from turtlebot_gym_agents.flags import Text, takes
from turtlebot_gym_agents.ids import arguments_of, brought_by
from turtlebot_gym_agents.outputs import require_outputs
from turtlebot_gym_agents.policies import PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import KEY, BundlePolicy, Card, write_bundle
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.training.config import NAMES, require_env

NONE = "none"
"""Instead of statistics: observations were not normalized."""
ROWS = 8
"""Environments in which a bundle is compared with its original."""
_SEES_NOTHING = ("VecNormalize", "VecMonitor", "VecCheckNan", "VecVideoRecorder")
"""Wrappers of Stable-Baselines3 that leave observations as they are, or are taken along."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ExportedPolicy:
    """A bundle that acts as the policy it was made of; `evaluate` and `compare` take it for its policy."""

    policy: Path
    """The bundle."""
    difference: float
    """Largest difference between its actions and the library's."""
    steps: int
    """Steps of each environment in which they were compared."""

    @property
    def card(self) -> Card:
        """The card: what the policy was trained for."""
        return BundlePolicy(self.policy).card

    def __str__(self) -> str:
        return (
            f"{self.policy}: {self.policy.stat().st_size:,} bytes, for {self.card.env}; its actions differ from the library's "
            f"by at most {self.difference:.1g} over {self.steps:,} steps of {ROWS} environments."
        )

    __repr__ = __str__


@takes(Options, "task")
def export(
    model: tyro.conf.Positional[Text],
    out: str | Path = "policy.onnx",
    *,
    env: str | None = None,
    vec_normalize: tyro.conf.Suppress[Any] = None,
    memory: tyro.conf.Suppress[int] = 0,
    training: tyro.conf.Suppress[Any] = None,
    steps: tyro.conf.Suppress[int] = 1000,
    allow_pickle: bool = False,
    force: bool = True,
    **options: Any,
) -> ExportedPolicy:
    """Make a policy bundle, and check that it returns the same actions, in the environment of the training.

    Args:
        model: The folder of a training by this package, a model in it (.zip), or an ONNX model (.onnx) from observations to
            actions, which gets a card and is not changed; in Python also a model of Stable-Baselines3 or sb3-contrib, with the
            `VecNormalize` of its environment, or a torch module from observations (n, k) to actions (n, 2), which are clipped.
        out: The bundle.
        env: Id or short name of the environment that it was trained in; None for what the model says, else nav.
        vec_normalize: What normalized observations: a `VecNormalize`, Gymnasium's `NormalizeObservation`, or "none"; None for
            what the model's environment has.
        memory: Of a torch module with a state: how many numbers that has. The module then maps observations and the state (n,
            memory), zeros where an episode begins, to actions and the next state.
        training: Entries for the card about the training, such as library, version, algorithm, steps and seed.
        steps: Steps on which the actions are compared, in 8 environments.
        allow_pickle: Confirm that you trust the file: loading a .zip can run any code in it.
        force: Overwrite a bundle that exists.
        **options: The environment's of the training, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If the policy cannot be a bundle, or a part of what it needs is missing; the message says what to do.
        RuntimeError: If the actions differ by more than `TOLERANCE`.
        ImportError: If a library is missing.
    """
    require_outputs([("--out", out, (".onnx",))], inputs=[model], force=force)
    with needs("agents"):
        from turtlebot_gym_agents.training import network
    about: dict[str, Any] = {}
    if isinstance(model, (str, Path)):
        model, about = _read(Path(model), allow_pickle)
        trained_in, given = about.get("config", {}).get("env"), _options_in(about)
        vec_normalize = NONE if about else vec_normalize  # our own trainings normalize in the network
    else:
        trained_in, given = _trained_in(model)
    env = require_env(env or trained_in or "nav")
    options = {**(given if env == require_env(trained_in or env) else {}), **options}
    same_step = {"num_envs": ROWS, "autoreset_mode": AutoresetMode.SAME_STEP}
    with closing(gym.make_vec(env, **same_step, **arguments_of(options))) as envs:
        space: Any = envs.single_observation_space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise refusal("env", "an environment whose observations are terms, such as those of this package", env)
        program, original, kind = _converted(model, space, env, vec_normalize, memory)
        about = {**kind, **about, **(training or {})}
        card = Card.of(env, brought_by(env) | arguments_of(options), parameters_of(envs), about)
        if about.get("config", {}).get("randomize"):
            card = replace(card, noise="randomized")
        with replacing(out) as beside:
            write_bundle(beside, program, card)
            difference = network.difference(BundlePolicy(beside), original, envs, steps)
            if not difference <= network.TOLERANCE:
                raise RuntimeError(f"{out} is not written: its actions would differ from the network's by {difference:.2g}.")
    return ExportedPolicy(policy=Path(out), difference=difference, steps=steps)


def _read(path: Path, allow_pickle: bool) -> tuple[Any, dict[str, Any]]:
    """Return the policy in a file, an ONNX model or a model (.zip) of a training by this package, and what is said of that."""
    file = path / "best.zip" if path.is_dir() else path
    if file.suffix == ".onnx":
        import onnx
        from google.protobuf.message import DecodeError

        try:
            return onnx.load(file), {}
        except DecodeError as error:
            raise ValueError(f"{path} is not an ONNX model: {error}") from error
    record = file.with_name("config.json")
    if file.suffix != ".zip" or not (file.is_file() and record.is_file()):
        raise ValueError(
            f"{path} must be the folder of a training by this package, a model in it, or an ONNX model: load any other one in "
            "Python by its library, as PPO.load(FILE) does, and call export(model, ...)."
        )
    content = load(record)
    return load_model(file, content["config"].get("algo"), allow_pickle=allow_pickle), content


def _options_in(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the environments of a training by this package."""
    settings = record.get("config", {})
    given = {item.name: settings[item.name] for item in fields(Options) if item.name in settings}
    # Infinity is null in JSON, and the default of the fields that may be infinite.
    finite = {
        name: {key: part for key, part in value.items() if part is not None} if isinstance(value, dict) else value
        for name, value in given.items()
    }
    return Options.of(finite).changed()


def load_model(path: Path, algo: Any, *, allow_pickle: bool = False) -> Any:
    """Load a model of Stable-Baselines3, whose algorithm is a name in `config.NAMES`; ``allow_pickle`` must be true."""
    if not allow_pickle:
        raise ValueError(
            f"{path} holds pickled objects, and loading those can run any code. If you trust its source, add "
            "--allow-pickle (allow_pickle=True); policies are passed on as bundles, which `turtlebot-gym export` makes."
        )
    import stable_baselines3

    try:
        return getattr(stable_baselines3, choose("algo", algo, {name: name.upper() for name in NAMES})).load(path, device="cpu")
    except (zipfile.BadZipFile, json.JSONDecodeError, KeyError, ValueError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {' '.join(str(error).split())}") from error


def _trained_in(model: Any) -> tuple[str | None, dict[str, Any]]:
    """Return id and options of the environment that a model was trained in, as far as it has one."""
    from stable_baselines3.common.base_class import BaseAlgorithm

    venv = model.get_env() if isinstance(model, BaseAlgorithm) else None
    try:
        spec = None if venv is None else venv.get_attr("spec")[0]
    except AttributeError:
        spec = None
    if spec is None or spec.id not in registry:
        return None, {}
    names, own = {item.name for item in fields(Options)}, registry[spec.id].kwargs
    return spec.id, {name: value for name, value in spec.kwargs.items() if name in names and own.get(name) is not value}


def _converted(
    model: Any, space: spaces.Box, env: str, vec_normalize: Any, memory: int
) -> tuple[Any, PolicyWithMemory | None, dict[str, Any]]:
    """Return a policy as ONNX, as its library drives it (None for ONNX), and entries for the card."""
    from stable_baselines3.common.base_class import BaseAlgorithm
    from torch import nn

    from turtlebot_gym_agents.training import network as library

    size = space.shape[0]
    if type(model).__name__ == "ModelProto":
        if any(entry.key == KEY for entry in model.metadata_props):
            raise ValueError("model is a policy bundle already: drive it as it is, --policy FILE.onnx.")
        return model, None, {}
    is_sb3 = isinstance(model, BaseAlgorithm)
    if not is_sb3 and not isinstance(model, nn.Module):
        raise refusal("model", "a model of Stable-Baselines3, a torch module or an ONNX model", model)
    statistics = _statistics_of(model, vec_normalize) if is_sb3 else vec_normalize
    layer = None
    if statistics not in (None, NONE) and getattr(statistics, "norm_obs", True):
        layer = library.Normalization(statistics)
        if layer.size != size:
            raise ValueError(f"vec_normalize must hold statistics of {size} observations, as {env} has, got {layer.size}.")
    about: dict[str, Any] = {"normalized": True} if layer else {}
    if is_sb3:
        _require_spaces(model, space, env, bounds=layer is None or hasattr(statistics, "normalize_obs"))
        policy: Any = model.policy
        policy.set_training_mode(False)
        part = library.Recurrent(policy) if hasattr(policy, "lstm_actor") else library.Predicting(policy)
        memory = getattr(part, "memory", 0)
        program, original = library.PolicyProgram(part, layer), library.Sb3Policy(model, statistics, layer)
        kind = type(model).__name__
        about |= {
            "library": f"stable_baselines3 {version('stable-baselines3')}",
            "algorithm": kind,
            "steps": model.num_timesteps,
        }
    else:
        program = library.PolicyProgram(model.cpu().eval(), layer)
        original = library.TorchPolicy(program, memory)
    return library.program_of(program, size, memory), original, {**about, **({"state": memory} if memory else {})}


def _statistics_of(model: Any, given: Any) -> Any:
    """Return what normalizes a model's observations: what is given, else the `VecNormalize` of its environment.

    Refuse a model of which that is unknown, or that another wrapper gives other observations.
    """
    from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

    layer, found = model.get_env(), list[Any]()
    if layer is None and given is None:
        raise ValueError(
            "model has no environment, which would say what normalized its observations: name their VecNormalize, "
            "export(model, ..., vec_normalize=...), or 'none'."
        )
    while layer is not None:
        changes = isinstance(layer, (VecEnvWrapper, gym.ObservationWrapper, VectorObservationWrapper)) and layer is not given
        found += [layer] if isinstance(layer, VecNormalize) else []
        if (changes and type(layer).__name__ not in _SEES_NOTHING) or len(found) > 1:
            raise ValueError(
                f"model was trained within {type(layer).__name__}, which a bundle does not have, and would act on other "
                "observations: train it within at most one VecNormalize, or with the option observation=..., which an export "
                "takes along, and without that wrapper."
            )
        layer = next((getattr(layer, name) for name in ("venv", "env", "envs") if hasattr(layer, name)), None)
        layer = layer[0] if isinstance(layer, list) else layer
    return given if given is not None else found[0] if found else NONE


def _require_spaces(model: Any, space: spaces.Box, env: str, *, bounds: bool) -> None:
    """Refuse a model of other observations than an environment's, or of other actions than two numbers in [-1, 1]."""
    seen, acts = model.observation_space, model.action_space
    if acts != spaces.Box(-1.0, 1.0, (2,), np.float32):
        raise ValueError(
            f"model of {type(model).__name__} must have actions (2,) in [-1, 1], shares of the robot's limits, got "
            f"{short_repr(acts)}: train PPO, SAC or TD3 in the environment itself, without a wrapper of its actions."
        )
    fits = isinstance(seen, spaces.Box) and seen.shape == space.shape
    if not fits or (bounds and not (np.allclose(seen.low, space.low) and np.allclose(seen.high, space.high))):
        raise ValueError(
            f"model must read the {space.shape[0]} numbers that {env} shows, within their bounds, got {short_repr(seen)}: name "
            "the task that it was trained in with --env, its terms with --observation; for Gymnasium's NormalizeObservation "
            "call export(model, ..., vec_normalize=WRAPPER) in Python."
        )
