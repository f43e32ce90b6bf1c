"""Make a policy bundle of a model of Stable-Baselines3, a torch module, or an ONNX model that fits.

The bundle takes along all that the policy needs: the normalization of observations, and the state of a recurrent network. It is
written only if it acts as the library itself does, in the environment of the training.
"""

from __future__ import annotations

import importlib
import json
import sys
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym
import numpy as np
import tyro
from gymnasium import spaces
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorObservationWrapper
from numpy.typing import NDArray

from turtlebot_gym import Options
from turtlebot_gym.config import choose, refusal, short_repr
from turtlebot_gym.files import load
from turtlebot_gym_agents.commands.console import needs
from turtlebot_gym_agents.flags import Text, takes
from turtlebot_gym_agents.ids import arguments_of, brought_by
from turtlebot_gym_agents.outputs import OutputFile, require_outputs
from turtlebot_gym_agents.policies.bundle import KEY, BundlePolicy, Card
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.training.config import NAMES, require_env

if TYPE_CHECKING:
    from torch import nn

    from turtlebot_gym_agents.training.network import Normalization

NONE = "none"
"""Instead of statistics: observations were not normalized."""
_SEES_NOTHING = ("VecMonitor", "VecCheckNan", "VecVideoRecorder")
"""Wrappers of Stable-Baselines3 that leave observations as they are."""


class _Source(NamedTuple):
    """A model, and what is known of its training."""

    model: Any
    env: str | None = None
    options: Mapping[str, Any] = {}
    """Arguments of its environment."""
    training: Mapping[str, Any] = {}
    """Entries for the card."""
    noise: str | None = None
    """Noise for the card, if it is not that of the options."""


_PARTS = {
    "normalization": "normalized",
    "the state of a recurrent network": "state",
}
"""Parts of a bundle as its maker is told of them, and their entries on the card."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ExportedPolicy:
    """A bundle that acts as the policy it was made of; `evaluate` and `compare` take it for its policy."""

    policy: Path
    """The bundle."""
    difference: float
    """Largest difference between its actions and the library's."""
    steps: int
    """Steps of each environment in which they were compared."""
    rows: int
    """Number of these environments."""

    @property
    def card(self) -> Card:
        """The card: what the policy was trained for."""
        return BundlePolicy(self.policy).card

    def __str__(self) -> str:
        card = self.card
        parts = "".join(f", with {name}" for name, there in _PARTS.items() if card.training.get(there))
        return (
            f"{self.policy}: {self.policy.stat().st_size:,} bytes, for {card.env}{parts}; its actions differ from the "
            f"library's by at most {self.difference:.1g} over {self.steps:,} steps of {self.rows} environments."
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
    card: tyro.conf.Suppress[Any] = None,
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
        card: Card to write; None for that of the environment.
        steps: Steps on which the actions are compared, in 8 environments.
        allow_pickle: Confirm that you trust the file: loading a .zip can run any code in it.
        force: Overwrite a bundle that exists.
        **options: The environment's of the training, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If the policy cannot be a bundle, or a part of what it needs is missing; the message says what to do.
        RuntimeError: If the actions differ by more than `network.TOLERANCE`.
        ImportError: If a library is missing.
    """
    require_outputs([("--out", out, OutputFile((".onnx",)))], inputs=[model], force=force)
    with needs("agents"):
        from turtlebot_gym_agents.training import network
    source = _read(Path(model), allow_pickle) if isinstance(model, (str, Path)) else _trained_in(model)
    env = require_env(env or source.env or "nav")
    options = {**(source.options if env == require_env(source.env or env) else {}), **options}
    given = {"num_envs": network.ROWS, "autoreset_mode": AutoresetMode.SAME_STEP, **arguments_of(options)}
    with closing(gym.make_vec(env, **given)) as envs:
        space: Any = envs.single_observation_space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise refusal("env", "an environment whose observations are terms, such as those of this package", env)
        program, original, about = _convert(source.model, space, env, NONE if source.training else vec_normalize, memory)
        if card is None:
            about = {**source.training, **about, **(training or {})}
            card = Card.of(env, brought_by(env) | arguments_of(options), parameters_of(envs), about)
            card = card if source.noise is None else replace(card, noise=source.noise)
        difference = network.write_checked(program, out, card, original, envs, steps=steps)
    return ExportedPolicy(policy=Path(out), difference=difference, steps=steps, rows=network.ROWS)


def _read(path: Path, allow_pickle: bool) -> _Source:
    """Return the policy in a file: an ONNX model, or a model (.zip) in the folder of a training by this package."""
    file = path / "best.zip" if path.is_dir() else path
    if file.suffix == ".onnx":
        import onnx
        from google.protobuf.message import DecodeError

        try:
            return _Source(onnx.load(file))
        except DecodeError as error:
            raise ValueError(f"{path} is not an ONNX model: {error}") from error
    record = file.with_name("config.json")
    if file.suffix != ".zip" or not (file.is_file() and record.is_file()):
        raise ValueError(
            f"{path} must be the folder of a training by this package, a model in it, or an ONNX model: load any other one in "
            "Python by its library, as PPO.load(FILE) does, and call export(model, ...)."
        )
    content = load(record)
    settings = content["config"]
    given = {item.name: settings[item.name] for item in fields(Options) if item.name in settings}
    # Infinity is null in JSON, and the default of the fields that may be infinite.
    finite = {
        name: {key: part for key, part in value.items() if part is not None} if isinstance(value, dict) else value
        for name, value in given.items()
    }
    noise = "randomized" if settings.get("randomize") else None
    model = load_model(file, settings.get("algo"), allow_pickle=allow_pickle)
    return _Source(model, settings.get("env"), Options.of(finite).changed(), content, noise)


def load_model(path: Path, algo: Any, *, allow_pickle: bool = False) -> Any:
    """Load a model of Stable-Baselines3.

    Args:
        path: A zip file.
        algo: Its algorithm, a name in `config.NAMES`.
        allow_pickle: Must be true: the file holds pickled objects, and loading them runs any code in them.

    Raises:
        ValueError: If ``allow_pickle`` is false, or the file is not such a model.
    """
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


def _is_sb3(model: Any) -> bool:
    """Return whether an object is a model or a policy of Stable-Baselines3, which then is imported."""
    if "stable_baselines3" not in sys.modules:
        return False
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.policies import BasePolicy

    return isinstance(model, (BaseAlgorithm, BasePolicy))


def _trained_in(model: Any) -> _Source:
    """Return a model with id and options of the environment that it was trained in, as far as it has one."""
    venv = model.get_env() if _is_sb3(model) and hasattr(model, "get_env") else None
    try:
        spec = None if venv is None else venv.get_attr("spec")[0]
    except AttributeError:
        spec = None
    if spec is None or spec.id not in registry:
        return _Source(model)
    names, own = {item.name for item in fields(Options)}, registry[spec.id].kwargs
    return _Source(
        model, spec.id, {name: value for name, value in spec.kwargs.items() if name in names and own.get(name) is not value}
    )


def _convert(model: Any, space: spaces.Box, env: str, vec_normalize: Any, memory: int) -> tuple[Any, Any, dict[str, Any]]:
    """Return a policy as ONNX, as its library drives it (None for ONNX), and entries for the card."""
    from torch import nn

    from turtlebot_gym_agents.training.network import Program, TorchPolicy, normalization_of, program_of

    size = space.shape[0]
    if type(model).__name__ == "ModelProto":
        if any(entry.key == KEY for entry in model.metadata_props):
            raise ValueError("model is a policy bundle already: drive it as it is, --policy FILE.onnx.")
        return model, None, {}
    is_sb3 = _is_sb3(model)
    if not is_sb3 and not isinstance(model, nn.Module):
        raise refusal("model", "a model of Stable-Baselines3, a torch module or an ONNX model", model)
    statistics = _statistics_of(model, vec_normalize) if is_sb3 else vec_normalize
    layer = None if statistics in (None, NONE) else normalization_of(statistics)
    if layer is not None and layer.size != size:
        raise ValueError(f"vec_normalize must hold statistics of {size} observations, as {env} has, got {layer.size}.")
    about: dict[str, Any] = {"normalized": True} if layer else {}
    if is_sb3:
        _require_spaces(model, space, env, bounds=layer is None or hasattr(statistics, "normalize_obs"))
        network = _network_of(model)
        memory = getattr(network, "memory", 0)
        program, original = Program(network, layer, memory), _Sb3Policy(model, layer, statistics)
        about = {**_library_of(model), **about}
    else:
        program = Program(model.cpu(), layer, memory)
        original = TorchPolicy(program, memory)
        original.try_on(space)
    return program_of(program, size, memory), original, {**about, **({"state": memory} if memory else {})}


class _Sb3Policy:
    """A model as its library drives it: with its normalization, and the state that it carries."""

    def __init__(self, model: Any, layer: Normalization | None, statistics: Any) -> None:
        self._model, self._begins, self._state = model, np.ones(0, np.bool_), None
        own = getattr(statistics, "normalize_obs", None)
        self._normalize = own if own is not None or layer is None else layer.of_rows

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._begins) != len(mask):
            self._begins, self._state = np.ones(len(mask), np.bool_), None
        self._begins = self._begins | mask

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = observations if self._normalize is None else self._normalize(observations)
        starts = self._begins
        actions, self._state = self._model.predict(seen, state=self._state, episode_start=starts, deterministic=True)
        self._begins = np.zeros(len(starts), np.bool_)
        return actions


def _network_of(model: Any) -> nn.Module:
    """Return the network of a model from an observation to the deterministic action."""
    from turtlebot_gym_agents.training.network import Predicting, Recurrent

    policy: Any = getattr(model, "policy", model)
    policy.set_training_mode(False)
    return Recurrent(policy) if hasattr(policy, "lstm_actor") else Predicting(policy)


def _layers_of(model: Any) -> Iterator[Any]:
    """Yield the environment of a model, and all that it wraps."""
    env = model.get_env() if hasattr(model, "get_env") else None
    while env is not None:
        yield env
        env = next((getattr(env, name) for name in ("venv", "env", "envs") if hasattr(env, name)), None)
        env = env[0] if isinstance(env, list) else env


def _statistics_of(model: Any, given: Any) -> Any:
    """Return what normalizes a model's observations: what is given, else the `VecNormalize` of its environment.

    Raises:
        ValueError: If that is unknown, or another wrapper changes the observations.
    """
    from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

    found = list[Any]()
    layers = list(_layers_of(model))
    for layer in layers:
        if isinstance(layer, VecNormalize):
            found.append(layer)
            continue
        changes = isinstance(layer, VecEnvWrapper) and type(layer).__name__ not in _SEES_NOTHING
        if changes or (given is None and isinstance(layer, (gym.ObservationWrapper, VectorObservationWrapper))):
            raise _lost(layer)
    if given is not None:
        return given
    if not layers:
        raise ValueError(
            "model has no environment, which would say what normalized its observations: name their VecNormalize, "
            "export(model, ..., vec_normalize=...), or 'none'."
        )
    if len(found) > 1:
        raise ValueError("model must be trained within at most one VecNormalize, got several.")
    return found[0] if found else NONE


def _lost(layer: Any) -> ValueError:
    return ValueError(
        f"model was trained within {type(layer).__name__}, which a bundle does not have, and would act on other observations: "
        "train it with VecNormalize or the option observation=..., which an export takes along, and without that wrapper."
    )


def _require_spaces(model: Any, space: spaces.Box, env: str, *, bounds: bool) -> None:
    """Refuse a model of other observations than an environment's, or of other actions than two numbers in [-1, 1]."""
    seen, acts = model.observation_space, model.action_space
    if not (isinstance(acts, spaces.Box) and acts.shape == (2,) and np.all(acts.low == -1.0) and np.all(acts.high == 1.0)):
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


def _library_of(model: Any) -> dict[str, Any]:
    """Return what a card says of a model of Stable-Baselines3."""
    kind = next(kind for kind in type(model).__mro__ if kind.__module__.startswith(("stable_baselines3", "sb3_contrib")))
    library = importlib.import_module(kind.__module__.partition(".")[0])
    return {
        "library": f"{library.__name__} {library.__version__}",
        "algorithm": type(model).__name__,
        "steps": getattr(model, "num_timesteps", None),
    }
