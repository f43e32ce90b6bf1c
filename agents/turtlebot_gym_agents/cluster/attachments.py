"""Files that options name, sent along with the work, so that a cluster's machines need not have them."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from turtlebot_gym.files import load, read_bytes
from turtlebot_gym_agents.policies.named import bare

Attachments = Mapping[str, Mapping[str, bytes]]
"""Contents of each named file and of the files it refers to, by relative name."""
SUFFIXES = (".onnx", ".json", ".yaml", ".yml", ".world")
"""Endings of policies, tuned baselines, presets, maps and worlds."""
_MODULE = "module "

T = TypeVar("T")


def attach(*names: object) -> dict[str, dict[str, bytes]]:
    """Return the files among some names, including single-file modules named as "module:callable"."""
    attachments: dict[str, dict[str, bytes]] = {}
    for name in _separate(names):
        reference = bare(str(name))
        path, (module, colon, _) = Path(reference), reference.partition(":")
        if path.suffix in SUFFIXES:
            if path.is_file():
                attachments[reference] = {beside.name: read_bytes(beside) for beside in (path, *_images(path))}
        elif colon and module.isidentifier():
            source = _source(module)
            if source is not None:
                attachments[_MODULE + module] = {source.name: read_bytes(source)}
    return attachments


def _separate(names: Iterable[object]) -> Iterator[str | Path]:
    """Yield names, and those within lists and between commas."""
    for name in names:
        if isinstance(name, (list, tuple)):
            yield from _separate(name)
        elif isinstance(name, str) and "," in name:
            yield from _separate(name.split(","))
        elif isinstance(name, (str, Path)):
            yield name


@contextmanager
def unpacked(attachments: Attachments) -> Iterator[Mapping[str, str]]:
    """Write files into a folder within this block; yields their paths by their names."""
    if not attachments:
        yield {}
        return
    with TemporaryDirectory(prefix="turtlebot-gym-") as folder:
        places, modules = {}, []
        for number, (name, files) in enumerate(attachments.items()):
            beside = Path(folder) / str(number)
            beside.mkdir()
            for file, content in files.items():
                (beside / file).write_bytes(content)
            if name.startswith(_MODULE):
                modules.append(str(beside))
            else:
                places[name] = str(beside / next(iter(files)))
        sys.path += modules  # at the end: an installed module of the same name is the one that was read
        try:
            yield places
        finally:
            for path in modules:
                sys.path.remove(path)


def placed(value: T, places: Mapping[str, str]) -> T:
    """Return an option's value here: the path of a file that was sent along, or itself."""
    if not isinstance(value, (str, Path)):
        return value
    reference = bare(str(value))
    path: Any = places.get(reference)
    return value if path is None else type(value)(path + str(value)[len(reference) :])


def hashes(attachments: Attachments) -> dict[str, dict[str, str]]:
    """Return hashes of the files' contents, by name."""
    return {
        name: {file: hashlib.sha256(content).hexdigest() for file, content in files.items()}
        for name, files in sorted(attachments.items())
    }


def _images(path: Path) -> list[Path]:
    """Return the image beside a map, if there is one."""
    if path.suffix not in (".yaml", ".yml"):
        return []
    try:
        image = load(path).get("image")
    except (AttributeError, ValueError):
        return []  # the reader of the file reports the error
    beside = path.parent / str(image)
    return [beside] if image and Path(str(image)).name == str(image) and beside.is_file() else []


def _source(module: str) -> Path | None:
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return None
    file = Path(str(spec.origin)) if spec and spec.origin else None
    return file if file and file.suffix == ".py" and file.name != "__init__.py" else None
