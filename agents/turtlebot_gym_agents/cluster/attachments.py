"""Files that options name, carried along: a cluster's machines need not have them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import yaml

from turtlebot_gym_agents.policies.named import SAFETY

Attachments = Mapping[str, Mapping[str, bytes]]
"""Of each file that is named: its content and that of those it refers to, by their names beside it."""
SUFFIXES = (".onnx", ".json", ".yaml", ".yml", ".world")
"""Of policies, tuned baselines, presets and maps, and worlds."""
_MODULE = "module "

T = TypeVar("T")


def attach(*names: object) -> dict[str, dict[str, bytes]]:
    """Return the files that are among some names; a module in one file, named "module:callable", counts."""
    found: dict[str, dict[str, bytes]] = {}
    for name in names:
        if not isinstance(name, (str, Path)):
            continue
        bare = str(name).removesuffix(SAFETY)
        path, (module, colon, _) = Path(bare), bare.partition(":")
        if path.suffix in SUFFIXES:
            if path.is_file():
                found[bare] = {beside.name: beside.read_bytes() for beside in (path, *_images(path))}
        elif colon and module.isidentifier():
            source = _source(module)
            if source is not None:
                found[_MODULE + module] = {source.name: source.read_bytes()}
    return found


@contextmanager
def unpacked(attachments: Attachments) -> Iterator[Mapping[str, str]]:
    """Write files into a folder that lasts as long as the block; yields their paths by the names that they had."""
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
        sys.path += modules  # after what is there: a module that is installed, or lies where one is, is the one that was read
        try:
            yield places
        finally:
            for path in modules:
                sys.path.remove(path)


def placed(value: T, places: Mapping[str, str]) -> T:
    """Return what an option says here: the path of a file that was carried along, anything else as it is."""
    if not isinstance(value, (str, Path)):
        return value
    bare = str(value).removesuffix(SAFETY)
    there: Any = places.get(bare)
    return value if there is None else type(value)(there + str(value)[len(bare) :])


def _images(path: Path) -> list[Path]:
    """Return the image of a map; nothing for other files, and for images that are not beside their map."""
    if path.suffix not in (".yaml", ".yml"):
        return []
    try:
        image = yaml.safe_load(path.read_text(encoding="utf-8")).get("image")
    except (AttributeError, ValueError, yaml.YAMLError):
        return []  # whoever reads it will say so
    beside = path.parent / str(image)
    return [beside] if image and Path(str(image)).name == str(image) and beside.is_file() else []


def _source(module: str) -> Path | None:
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return None
    file = Path(str(spec.origin)) if spec and spec.origin else None
    return file if file and file.suffix == ".py" and file.name != "__init__.py" else None
