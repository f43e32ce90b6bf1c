"""A robot from several files, each of which states a part of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from turtlebot_gym.files import DESCRIPTIONS, load
from turtlebot_gym.notices import notify
from turtlebot_gym.parameters import Noise
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.ros_files.ekf import read_ekf
from turtlebot_gym.ros_files.nav2 import read_nav2
from turtlebot_gym.ros_files.parameters import nodes_in
from turtlebot_gym.ros_files.urdf import read_urdf
from turtlebot_gym.validation import build, choose

BASE = "burger"
"""The robot whose fields count where no file states them."""


def read_robot(name: str) -> Robot:
    """Read a robot from parts joined by "+", such as "burger.urdf+nav2_params.yaml": what a part states overrides those before.

    Args:
        name: A preset, which must be the first part; a URDF; Nav2's parameters; or a file with fields of a `Robot`.

    Raises:
        ValueError: If a part cannot be read, or states nothing of a robot.

    Warns:
        Notice: Of what was taken from each part, and what was not.
    """
    paths = [name] if Path(name).exists() else name.split("+")
    base = BASE if Path(paths[0]).suffix else paths.pop(0)
    made = choose("robot", base, ROBOTS)
    stated: set[str] = set()
    notices: list[str] = []
    for path in map(Path, paths):
        try:
            values, taken, left_out = _part(path)
            made = replace(made, **values)
        except OSError as error:
            raise ValueError(f"There is no robot file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
        except ValueError as error:
            text = str(error).removeprefix(f"{path}: ").rstrip(".")
            raise ValueError(f"{path}: {text}.") from error
        stated |= values.keys()
        text = "; ".join(
            f"{title}: {', '.join(texts)}" for title, texts in (("taken", taken), ("not taken", left_out)) if texts
        )
        notices.append(f"{path.name}: {text}.")
    rest = [item.name for item in fields(Robot) if item.name not in stated]
    notices[-1] += f" As {base}, since not stated: {', '.join(rest)}." if rest else ""
    notify(notices)
    return made


def _part(path: Path) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return the fields that a file states, what was taken, and what was left out."""
    if path.suffix in DESCRIPTIONS:
        return read_urdf(path)
    content = load(path)
    if nodes := nodes_in(content):
        values, taken, left_out = read_nav2(nodes)
        if not values:
            raise ValueError("it states no limit and no footprint: a velocity_smoother, a controller_server or a costmap must")
        return values, taken, left_out
    values = content if isinstance(content, Mapping) else {}
    whole = build(Robot, {"max_linear": 1.0, "max_angular": 1.0, **values}, "robot")
    return {str(name): getattr(whole, str(name)) for name in values}, [f"{name} {values[name]}" for name in values], []


def noise_of(content: Any, path: str | Path) -> Noise:
    """Return the noise of the parameters of robot_localization, and notify of what was taken.

    Raises:
        ValueError: If there are none, or they are malformed.
    """
    found = read_ekf(nodes_in(content))
    if found is None:
        raise ValueError("it is a file of ROS parameters, and no node in it has an odom0, as robot_localization's ekf_node has")
    noise, taken, left_out = found
    notify([f"{Path(path).name}: taken: {'; '.join(taken)}. Not taken: {'; '.join(left_out)}."])
    return noise
