"""Origin of a result: this package's code and the numerical libraries. Units of different origins are different units."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import turtlebot_gym
import turtlebot_gym_agents
from turtlebot_gym_agents.policies.named import pretrained_folder
from turtlebot_gym_agents.provenance import libraries
from turtlebot_gym_agents.training.hyperparameters import configs_folder


@cache
def origin() -> dict[str, Any]:
    """Return the version, a hash of the code and data that this package computes with, and the libraries' versions."""
    digest = hashlib.sha256()
    for package in (turtlebot_gym, turtlebot_gym_agents):
        digest.update(_content(Path(str(package.__file__)).parent, ".py"))
    digest.update(_content(pretrained_folder(), ".onnx"))
    digest.update(_content(configs_folder(), ".yaml"))
    return {"version": turtlebot_gym.__version__, "code": digest.hexdigest(), "libraries": libraries()}


def difference(here: dict[str, Any], there: dict[str, Any]) -> str:
    """Describe how another origin differs from the local one; empty if it does not."""
    if there["version"] != here["version"]:
        return f"turtlebot_gym {there['version']}, here it is {here['version']}"
    for name, version in here["libraries"].items():
        found = there["libraries"].get(name)
        if found != version:
            return f"{name} {found}, here it is {version}" if found else f"no {name}, here it is {version}"
    return "" if there["code"] == here["code"] else "turtlebot_gym with other code than here"


def _content(folder: Path, suffix: str) -> bytes:
    """Return a hash of the names and contents of files with a suffix below a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob(f"*{suffix}")):
        digest.update(f"{path.relative_to(folder).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.digest()
