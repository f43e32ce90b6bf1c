"""Policies of other libraries in files and folders: models, networks, and the statistics and settings that lie beside them."""

from __future__ import annotations

import importlib
import pickle
import re
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
import yaml

from turtlebot_gym import Options
from turtlebot_gym.files import read_bytes, read_text, regular, require_small
from turtlebot_gym.validation import short_repr
from turtlebot_gym_agents.training.config import TrainingConfig, read_record

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

_MARKS = {
    "top_quantiles_to_drop_per_net": "TQC",
    "policy_delay": {"crossq": "CrossQ", "": "TD3"},  # DDPG acts as TD3
    "target_entropy": "SAC",
    "cg_max_steps": "TRPO",
    "delta_std": "ARS",
    "clip_range_vf": {"maskable": "MaskablePPO", "recurrent": "RecurrentPPO", "": "PPO"},
    "gae_lambda": "A2C",
    "exploration_fraction": {"qrdqn": "QRDQN", "": "DQN"},
}
"""Attribute of a saved model that identifies its algorithm, or by a part of its policy's module one of several."""
_DISCRETE = ("DQN", "QRDQN", "MaskablePPO")
_STATISTICS = ("vecnormalize", "vec_normalize")
"""Names of files of `VecNormalize` without their suffix, ``.pkl``."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a file holds, and what lies beside it."""

    model: Any
    """A model of Stable-Baselines3, a torch module or an ONNX model."""
    env: str | None = None
    """Id of the environment that it was trained in; None if nothing says it."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of that environment."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Entries for the card."""
    noise: str | None = None
    """Noise for the card, if it is not that of the options."""
    statistics: tuple[Path, ...] = ()
    """Files of statistics of which one may be the model's."""


def read(path: Path, *, allow_pickle: bool) -> Found:
    """Return the policy in a file, or in the folder of a training by rl-baselines3-zoo or this package.

    Args:
        path: A model of Stable-Baselines3 or sb3-contrib (.zip), a TorchScript file or a saved torch module, an ONNX model, or
            a folder.
        allow_pickle: Whether files may be read that can run code.

    Raises:
        ValueError: If it is none of these, or can run code and ``allow_pickle`` is false.
    """
    file = _model_in(path) if path.is_dir() else path
    beside = _settings(file.parent)
    return Found(model=_model(file, allow_pickle), statistics=statistics_beside(file), **beside)


def _model_in(folder: Path) -> Path:
    """Return the model in a training's folder: the last one of rl-baselines3-zoo, or the best one of this package."""
    names = [*(f"{run.parent.name}.zip" for run in sorted(folder.glob("*/args.yml"))), "best.zip", "best_model.zip"]
    for name in names:
        if (folder / name).is_file():
            return folder / name
    raise ValueError(
        f"{folder} must be the folder of a training, with {' or '.join(names)}: name the model's file, of rl-baselines3-zoo "
        "the run's folder, such as logs/ppo/ENV_1."
    )


def _model(path: Path, allow_pickle: bool) -> Any:
    """Return what a file holds, by its content."""
    if zipfile.is_zipfile(regular(path)):
        require_small(path)
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        if "data" in names and any(name.endswith(".pth") for name in names):
            return load_model(path, allow_pickle=allow_pickle)
        if any("/code/" in name for name in names):
            return _torch_script(path, allow_pickle)
        if any(name.endswith("data.pkl") for name in names):
            return _torch_module(path, allow_pickle)
        if path.suffix == ".zip":
            return load_model(path, allow_pickle=allow_pickle)
        raise ValueError(
            f"{path} must be a model of Stable-Baselines3, a TorchScript file or a saved torch module, but it is another zip "
            "archive: of a program by torch.export, call export(torch.export.load(FILE).module(), ...) in Python."
        )
    if path.suffix == ".onnx":
        return _onnx(path)
    if path.suffix in (".pt", ".pth"):
        return _torch_module(path, allow_pickle)
    return load_model(path, allow_pickle=allow_pickle)


def _onnx(path: Path) -> Any:
    import onnx
    from google.protobuf.message import DecodeError

    read_bytes(path)  # refuses what is no regular file
    try:
        return onnx.load(path)
    except (DecodeError, ValueError, OSError) as error:
        raise ValueError(f"{path} is not an ONNX model: {' '.join(str(error).split())}") from error


def _torch_script(path: Path, allow_pickle: bool) -> Any:
    require_trust(path, allow_pickle)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # torch prefers torch.export
        try:
            return torch.jit.load(path, map_location="cpu")
        except RuntimeError as error:
            raise ValueError(f"{path} is not a TorchScript file that torch can read: {short_repr(str(error))}") from error


def _torch_module(path: Path, allow_pickle: bool) -> Any:
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)  # runs nothing
    except (pickle.UnpicklingError, EOFError, RuntimeError, AttributeError):
        require_trust(path, allow_pickle)
        try:
            content = torch.load(path, map_location="cpu", weights_only=False)
        except (AttributeError, ImportError) as error:
            raise ValueError(
                f"{path} holds a module whose class is not here ({error}): run this in the folder of its code, or call "
                "export(module, ...) in the program that defines it."
            ) from error
        except (pickle.UnpicklingError, EOFError, RuntimeError) as error:
            raise ValueError(f"{path} is not a saved torch module: {short_repr(str(error))}") from error
    if isinstance(content, Mapping):
        raise ValueError(
            f"{path} holds weights alone (a state_dict), not the network: make the module, "
            "load_state_dict(torch.load(FILE)), and call export(module, ...) of turtlebot_gym_agents.training.export."
        )
    if not isinstance(content, torch.nn.Module):
        raise ValueError(f"{path} must hold a torch module, got {type(content).__name__}.")
    return content


def load_model(path: Path, *, allow_pickle: bool = False) -> BaseAlgorithm:
    """Load a model saved by Stable-Baselines3 or sb3-contrib, with the algorithm that the file's content says.

    Args:
        path: A zip file.
        allow_pickle: Must be true: the file holds pickled objects, and loading them runs any code in them.

    Raises:
        ValueError: If ``allow_pickle`` is false, the file is not such a model, or its actions are discrete.
        ImportError: If it is a model of sb3-contrib, which is missing.
    """
    require_trust(path, allow_pickle)
    from turtlebot_gym_agents.training.model import data_of
    from turtlebot_gym_agents.training.sb3_policy import discrete

    try:
        keys = data_of(path)
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {' '.join(str(error).split())}") from error
    mark = next((mark for mark in _MARKS if mark in keys), None)
    if mark is None:
        raise ValueError(f"{path} must hold a model of PPO, A2C, SAC, TD3, DDPG, RecurrentPPO, TQC, TRPO, ARS or CrossQ.")
    policy = keys.get("policy_class")
    module = str(policy.get("__module__", "")) if isinstance(policy, dict) else ""
    named = _MARKS[mark]
    name = named if isinstance(named, str) else next(algorithm for part, algorithm in named.items() if part in module)
    if name in _DISCRETE:
        raise discrete(name)
    rates = dict.fromkeys(("learning_rate", "lr_schedule", "clip_range"), 0.0)  # of training, and possibly of unknown classes
    for library in ("stable_baselines3", "sb3_contrib"):
        try:
            algorithm = getattr(importlib.import_module(library), name, None)
        except ModuleNotFoundError as error:
            raise ImportError(f"{path} is a model of {name}: pip install sb3-contrib.") from error
        if algorithm is not None:
            return algorithm.load(path, device="cpu", custom_objects=rates)
    raise ValueError(f"{path} is a model of {name}, which the installed sb3-contrib does not have: update it.")


def require_trust(path: Path, allow_pickle: bool) -> None:
    """Raise ValueError unless a file whose loading can run code is trusted."""
    if not allow_pickle:
        raise ValueError(
            f"{path} holds pickled objects, and loading those can run any code. If you trust its source, add "
            "--allow-pickle (allow_pickle=True); policies are passed on as bundles, which `turtlebot-gym export` makes."
        )


def load_statistics(path: Path, *, allow_pickle: bool) -> Any:
    """Return the object with statistics in a file of `VecNormalize`, which is a pickle.

    Raises:
        ValueError: If ``allow_pickle`` is false, or the file is no pickle.
    """
    require_trust(path, allow_pickle)
    try:
        return pickle.loads(read_bytes(path))
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, ValueError) as error:
        raise ValueError(f"{path} is not a file of VecNormalize: {' '.join(str(error).split())}") from error


def statistics_beside(file: Path) -> tuple[Path, ...]:
    """Return the statistics beside a model that are named most like it: of a checkpoint, of the file, of the folder."""
    folder, stem = file.parent, file.stem
    checkpoint = re.fullmatch(r"(.+)_(\d+)_steps", stem)
    levels = [
        [f"{checkpoint[1]}_vecnormalize_{checkpoint[2]}_steps"] if checkpoint else [],
        [stem, *(f"{stem}_{name}" for name in _STATISTICS)],
        [*_STATISTICS, *(f"{run.parent.name}/vecnormalize" for run in sorted(folder.glob("*/args.yml")))],
    ]
    for level in levels:
        if found := tuple(path for name in level if (path := folder / f"{name}.pkl").is_file()):
            return found
    return ()


def _settings(folder: Path) -> dict[str, Any]:
    """Return what a training has written about itself: this package, or rl-baselines3-zoo."""
    if (record := folder / "config.json").is_file():
        return _own_settings(read_record(record))
    runs = sorted(folder.glob("*/args.yml"))
    if len(runs) != 1:
        return {}
    arguments, hyper = (_zoo(path) if path.is_file() else {} for path in (runs[0], runs[0].with_name("config.yml")))
    for name in ("env_wrapper", "vec_env_wrapper"):
        if wrapper := hyper.get(name):
            raise ValueError(
                f"{runs[0].with_name('config.yml')}: {name} {short_repr(wrapper)} changes what the model sees or does, and a "
                "bundle does not have it: train without it, or call export(model, ...) in Python with what it sees."
            )
    options = arguments.get("env_kwargs") or {}
    return {"env": arguments.get("env"), "options": options, "training": {"framework": "rl-baselines3-zoo"}}


def _own_settings(record: dict[str, Any]) -> dict[str, Any]:
    settings = TrainingConfig().settings() | record.get("config", {})
    options = {item.name: settings[item.name] for item in fields(Options) if item.name in settings}
    # Infinity is null in JSON, and the default of the fields that may be infinite.
    shorn = {
        name: {key: part for key, part in value.items() if part is not None} if isinstance(value, dict) else value
        for name, value in options.items()
    }
    noise = "randomized" if settings["randomize"] else None
    return {"env": settings["env"], "options": Options.of(shorn).changed(), "training": record, "noise": noise}


class _ZooLoader(yaml.SafeLoader):
    """Reads what rl-baselines3-zoo writes, an `OrderedDict` as a mapping and other Python objects as None, and runs nothing."""


def _plain(loader: yaml.SafeLoader, suffix: str, node: yaml.Node) -> Any:
    if suffix.startswith("object/apply:collections.OrderedDict") and isinstance(node, yaml.SequenceNode):
        pairs = loader.construct_sequence(node, deep=True)
        return dict(pairs[0]) if pairs else {}
    return (
        tuple(loader.construct_sequence(node, deep=True)) if suffix == "tuple" and isinstance(node, yaml.SequenceNode) else None
    )


_ZooLoader.add_multi_constructor("tag:yaml.org,2002:python/", _plain)


def _zoo(path: Path) -> dict[str, Any]:
    """Return the content of a file of rl-baselines3-zoo, args.yml or config.yml."""
    try:
        content = yaml.load(read_text(path), _ZooLoader)
    except (yaml.YAMLError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a file of rl-baselines3-zoo: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path} must be a mapping, as rl-baselines3-zoo writes it, got {short_repr(content)}.")
    return content
