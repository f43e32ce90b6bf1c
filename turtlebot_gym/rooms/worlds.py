"""Worlds: presets by name, rules, floor plans and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from turtlebot_gym.config import did_you_mean, given, refusal, short_repr, split
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.geodesic import MARGIN
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.tasks import given_pose

World = str | Path | RoomRules | FloorPlan | Mapping[str, Any]
"""Types that specify a world."""
_GAZEBO, _MAPS = (".world", ".sdf"), (".yaml", ".yml")


def find_world(world: World) -> RoomRules | FloorPlan:
    """Return the rules or the floor plan of a world.

    It is a name in `rules.ROOMS`, the path of a Gazebo world or of a map, a floor plan, or rules and what else
    `turtlebot_gym.config.given` takes; a ``ValueError`` refuses others, and files that cannot be read.
    """
    if isinstance(world, FloorPlan):
        return world
    if isinstance(world, (str, Path)) and Path(world).suffix in _GAZEBO:
        from turtlebot_gym.rooms.gazebo import read_gazebo  # slow to import, and rarely needed

        return read_gazebo(world)
    if isinstance(world, (str, Path)) and Path(world).suffix in _MAPS:
        return read_map(world)
    base, changes = split(world)
    if changes and isinstance(find_world(base), FloorPlan):
        raise ValueError(f"world: {short_repr(base)} is given and has no rules, so {', '.join(changes)} must be left out.")
    if isinstance(world, (RoomRules, Mapping)) or (isinstance(world, str) and world in ROOMS):
        return given(RoomRules, world, ROOMS, "world")
    error = refusal("world", f"one of {', '.join(map(repr, ROOMS))}, or a file ({', '.join(_GAZEBO + _MAPS)})", world)
    raise ValueError(f"{error}{did_you_mean(world, ROOMS)}")


def with_options(world: RoomRules | FloorPlan, options: Mapping[str, Any]) -> RoomRules | FloorPlan:
    """Return the world of an episode: another ``world``, as `find_world` takes it, and with a given ``start`` or ``goal``.

    A ``ValueError`` refuses a pose, see `turtlebot_gym.tasks.given_pose`, outside of the room or inside a given obstacle.
    """
    world = find_world(options["world"]) if "world" in options else world
    poses = {name: given_pose(name, options[name]) for name in ("start", "goal") if name in options}
    if not poses:
        return world
    if isinstance(world, FloorPlan):
        return replace(world, **poses)
    for name, pose in poses.items():
        if not (abs(pose.x) < world.half_length and abs(pose.y) < world.half_width):
            raise ValueError(f"{name} must be in the room, got {pose!r}.")
    near = 0.0 if len(poses) == 2 else world.min_distance
    return replace(world, min_distance=near, **{name: tuple(pose) for name, pose in poses.items()})


def find_lidar(lidar: str | Path | Mapping[str, Any] | Lidar) -> Lidar:
    """Return a LiDAR: a name in `lidar.LIDARS`, or what else `turtlebot_gym.config.given` takes."""
    return given(Lidar, lidar, LIDARS, "lidar")


def no_way(robot: Robot) -> ValueError:
    """Return the error for a robot that no way leads to its goal: `geodesic.way_left` is unknown."""
    rule = f"for a robot of radius {robot.radius:g} m that keeps {MARGIN:g} m to everything"
    return ValueError(f"No way leads from start to goal {rule}.")
