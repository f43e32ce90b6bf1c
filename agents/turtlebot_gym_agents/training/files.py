"""Files of which `export` makes a bundle: the best model of a training by this package, and an ONNX model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turtlebot_gym import Options
from turtlebot_gym.config import choose
from turtlebot_gym.files import load
from turtlebot_gym_agents.training.config import NAMES

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a file holds, and what lies beside it."""

    model: Any
    """A model of Stable-Baselines3, or an ONNX model."""
    env: str | None = None
    """Id of the environment that it was trained in; None if nothing says it."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of that environment."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Entries for the card."""
    noise: str | None = None
    """Noise for the card, if it is not that of the options."""


def read(path: Path, *, allow_pickle: bool) -> Found:
    """Return the policy in a file.

    Args:
        path: The folder of a training by this package, or a model (.zip) in it; or an ONNX model.
        allow_pickle: Whether files may be read that can run code.

    Raises:
        ValueError: If it is none of these, or can run code and ``allow_pickle`` is false.
    """
    file = path / "best.zip" if path.is_dir() else path
    if file.suffix == ".onnx":
        return Found(model=_onnx(file))
    record = file.with_name("config.json")
    if file.suffix != ".zip" or not (file.is_file() and record.is_file()):
        raise ValueError(
            f"{path} must be the folder of a training by this package, a model in it, or an ONNX model: load any other one in "
            "Python by its library, as PPO.load(FILE) does, and call export(model, ...)."
        )
    content = read_record(record)
    settings = content["config"]
    options = {item.name: settings[item.name] for item in fields(Options) if item.name in settings}
    # Infinity is null in JSON, and the default of the fields that may be infinite.
    shorn = {
        name: {key: part for key, part in value.items() if part is not None} if isinstance(value, dict) else value
        for name, value in options.items()
    }
    return Found(
        model=load_model(file, settings.get("algo"), allow_pickle=allow_pickle),
        env=settings.get("env"),
        options=Options.of(shorn).changed(),
        training=content,
        noise="randomized" if settings.get("randomize") else None,
    )


def read_record(path: Path) -> dict[str, Any]:
    """Return the config.json of a training.

    Raises:
        ValueError: If the file is something else.
    """
    record = load(path)
    if not isinstance(record, dict) or not isinstance(record.get("config"), dict):
        raise ValueError(f"{path} must be what training leaves: a mapping with a mapping under 'config'.")
    return record


def load_model(path: Path, algo: Any, *, allow_pickle: bool = False) -> BaseAlgorithm:
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
    from turtlebot_gym_agents.training.arguments import ALGORITHMS
    from turtlebot_gym_agents.training.model import data_of

    algorithm = choose("algo", algo, {name: ALGORITHMS[name] for name in NAMES})
    try:
        data_of(path)
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {' '.join(str(error).split())}") from error
    return algorithm.load(path, device="cpu")


def _onnx(path: Path) -> Any:
    import onnx
    from google.protobuf.message import DecodeError

    try:
        return onnx.load(path)
    except (DecodeError, ValueError, OSError) as error:
        raise ValueError(f"{path} is not an ONNX model: {' '.join(str(error).split())}") from error
