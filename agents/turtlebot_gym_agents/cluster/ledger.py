"""What is finished: a folder with a line of JSON for each finished job, and with the code and settings that all jobs share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import turtlebot_gym
import turtlebot_gym_agents
from turtlebot_gym.config import short_repr
from turtlebot_gym.files import load, write_text
from turtlebot_gym_agents.policies.named import bare, pretrained_folder
from turtlebot_gym_agents.provenance import libraries, plain, replace_json
from turtlebot_gym_agents.training.hyperparameters import configs_folder


@cache
def origin() -> dict[str, str]:
    """Return the versions of this package and its libraries, and a hash of this package's code and data."""
    digest = hashlib.sha256()
    packages = [Path(str(package.__file__)).parent for package in (turtlebot_gym, turtlebot_gym_agents)]
    for folder in (*packages, pretrained_folder(), configs_folder()):
        for path in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".onnx", ".yaml")):
            digest.update(f"{path.relative_to(folder).as_posix()} {_hash(path)}".encode())
    versions = {name: str(version) for name, version in libraries().items()}
    return {"turtlebot_gym": turtlebot_gym.__version__, **versions, "code": digest.hexdigest()[:16]}


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Describe the first difference between two descriptions; empty if there is none."""
    for name in {**here, **there}:
        if there.get(name) != here.get(name):
            return f"another {name}, {short_repr(there.get(name))}, here it is {short_repr(here.get(name))}"
    return ""


def files_in(values: Iterable[object]) -> dict[str, str]:
    """Return hashes of the files among some option values, by their names.

    Values may be paths, policies such as "mine.onnx+safety" or "module:callable", or lists of them. A map includes its image.
    """
    hashes: dict[str, str] = {}
    for value in values:
        if isinstance(value, Mapping):  # a variant of what its base names
            hashes |= files_in([value.get("base")])
        elif isinstance(value, (list, tuple)):
            hashes |= files_in(value)
        elif isinstance(value, (str, Path)):
            hashes |= {str(path): _hash(path) for path in _paths_of(bare(str(value)))}
    return hashes


def _paths_of(name: str) -> list[Path]:
    path, (module, colon, _) = Path(name), name.partition(":")
    if colon and module.isidentifier():
        spec = find_spec(module)
        path = Path(str(spec.origin)) if spec else path
    if not path.is_file():
        return []
    content = load(path) if path.suffix in (".yaml", ".yml") else None
    image = path.parent / str(content.get("image")) if isinstance(content, Mapping) else path
    return [path, image] if image != path and image.is_file() else [path]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def require_same(path: Path, settings: Mapping[str, Any]) -> None:
    """Write settings and `origin` to a file; if the file exists, require that it holds the same.

    Raises:
        ValueError: If it holds other settings, other code or other versions.
    """
    about = plain({**settings, **origin()})
    if not path.exists():
        replace_json(path, about)
    elif other := difference(load(path), about):
        raise ValueError(f"{path.parent} holds work with {other}: choose another folder, or remove this one.")


class Ledger:
    """Results of finished jobs by name, each a line of ``finished.jsonl``; ``settings.json`` says what all jobs share.

    Args:
        folder: The folder; created if missing.
        settings: Settings on which all results depend.

    Raises:
        ValueError: If the folder holds work of other settings, code or versions, or a line is damaged.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        require_same(folder / "settings.json", settings)
        self._path = folder / "finished.jsonl"
        self.results: dict[str, Any] = {}
        text = self._path.read_text("utf-8") if self._path.exists() else ""
        whole, _, broken = text.rpartition("\n")
        if broken:  # this process was killed while it wrote
            write_text(self._path, whole + "\n" if whole else "")
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                self._read(line)
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{self._path}, line {number} is damaged: remove it to repeat its job.") from error

    def add(self, name: str, result: Any) -> None:
        """Append the result of a job, of JSON types; NaN and infinity are allowed."""
        line = json.dumps({"job": name, "result": result})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        self._read(line)

    def _read(self, line: str) -> None:
        content = json.loads(line)
        self.results[content["job"]] = content["result"]
