"""The worlds that there are: presets by name, rules, floor plans, and files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from turtlebot_gym.rooms.gazebo import read_gazebo
from turtlebot_gym.rooms.geodesic import MARGIN, UNKNOWN
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.validation import choose, made, shown
from turtlebot_gym.values import Pose

World = str | Path | RoomRules | FloorPlan | Mapping[str, Any]
"""How a world may be named."""
GAZEBO = (".world", ".sdf")
"""How the names of Gazebo's files end."""
MAPS = (".yaml", ".yml")
"""How the names of maps end."""


def find_world(world: World) -> RoomRules | FloorPlan:
    """Return the rules or the floor plan of a world.

    Args:
        world: A name in `rules.ROOMS`, the path of a Gazebo world or of a map, rules or a mapping of some of their fields, or a
            floor plan.

    Raises:
        ValueError: If there is no such world, or its file cannot be read.
    """
    if isinstance(world, (RoomRules, FloorPlan)):
        return world
    if isinstance(world, Mapping):
        return made(RoomRules, world, "world")
    if isinstance(world, (str, Path)) and Path(world).suffix in GAZEBO:
        return read_gazebo(world)
    if isinstance(world, (str, Path)) and Path(world).suffix in MAPS:
        return read_map(world)
    if not isinstance(world, str) or world not in ROOMS:
        files = ", ".join((*GAZEBO, *MAPS))
        raise ValueError(f"world must be one of {', '.join(map(repr, ROOMS))}, or a file ({files}), got {shown(world)}.")
    return ROOMS[world]


def with_options(world: RoomRules | FloorPlan, options: Mapping[str, Any]) -> RoomRules | FloorPlan:
    """Return the world that options of an episode ask for.

    Args:
        world: The one where they name none.
        options: ``world``, as `find_world` takes it; ``start`` and ``goal``, poses: x, y and heading, m, rad.

    Raises:
        ValueError: If there are other options, or a pose is not one, outside of the room or in an obstacle that is given.
    """
    unknown = sorted(set(options) - {"world", "start", "goal"})
    if unknown:
        raise ValueError(f"options must be among 'world', 'start' and 'goal', got {', '.join(map(repr, unknown))}.")
    world = find_world(options["world"]) if "world" in options else world
    poses = {name: _pose(name, options[name]) for name in ("start", "goal") if name in options}
    if not poses:
        return world
    if isinstance(world, FloorPlan):
        return replace(world, **poses)
    for name, pose in poses.items():
        if not (abs(pose.x) < world.half_length and abs(pose.y) < world.half_width):
            raise ValueError(f"{name} must be in the room, got {pose!r}.")
    near = 0.0 if len(poses) == 2 else world.min_distance
    return replace(world, min_distance=near, **{name: tuple(pose) for name, pose in poses.items()})


def _pose(name: str, value: Any) -> Pose:
    """Return a pose that was given as an option."""
    try:
        pose = Pose(*map(float, value))
    except (TypeError, ValueError):
        pose = Pose(math.nan, math.nan, math.nan)
    if not all(map(math.isfinite, pose)):
        raise ValueError(f"{name} must hold x, y and heading, finite numbers, got {value!r}.")
    return pose


def find_lidar(lidar: str | Lidar | Mapping[str, Any]) -> Lidar:
    """Return a LiDAR: as it is given, as a mapping of some of its fields, or by a name in `lidar.LIDARS`.

    Raises:
        ValueError: If the name is unknown, or a field is unknown or breaks its rule.
    """
    return made(Lidar, lidar, "lidar") if isinstance(lidar, (Lidar, Mapping)) else choose("lidar", lidar, LIDARS)


def require_a_way(plan: FloorPlan, radius: float, way: float) -> None:
    """Refuse a floor plan through which no way leads.

    Args:
        plan: The plan.
        radius: The robot's, m.
        way: What an episode's start has left of it, see `geodesic.way_left`, m.

    Raises:
        ValueError: If there is no way from its start to its goal, or none between any two places that were tried.
    """
    if way == UNKNOWN:
        where = "from its start to its goal" if plan.start and plan.goal else "between the places that were drawn"
        raise ValueError(
            f"The floor plan has no way {where} for a robot of radius {radius:g} m that keeps {MARGIN:g} m to everything."
        )
