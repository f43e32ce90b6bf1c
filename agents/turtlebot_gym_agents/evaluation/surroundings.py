"""The surroundings of a vector environment's first robot, as a drive keeps them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from turtlebot_gym.drive import RoomData
from turtlebot_gym.rooms.grid import grid_in
from turtlebot_gym.rooms.scan import obstacles_of
from turtlebot_gym.rooms.scene import Scene, scene_at
from turtlebot_gym.systems.scans import TrackedScene
from turtlebot_gym_agents.policies.fit import parameters_of


def _scenes_of(envs: VectorEnv) -> Any:
    """Return the surroundings of all robots; None on open ground."""
    env: Any = envs.unwrapped
    return env.truth()[0] if env.parameters.room else None


def scene_of(envs: VectorEnv) -> Scene | None:
    """Return the surroundings of the first robot; None on open ground."""
    scenes = _scenes_of(envs)
    return None if scenes is None else scene_at(scenes, 0)


def tracks_of(envs: VectorEnv) -> NDArray[np.float32] | None:
    """Return what the first robot observes by `observations.TRACKS`, shape (40,); None if it does not track."""
    scenes = _scenes_of(envs)
    return scenes.tracker.seen[0].copy() if isinstance(scenes, TrackedScene) else None


def room_of(envs: VectorEnv, label: str) -> RoomData:
    """Return what stays the same during the first robot's episode; its walkers stand where they are now."""
    p, scene = parameters_of(envs), scene_of(envs)
    return RoomData(
        label=label,
        room=None if scene is None else obstacles_of(scene),
        grid=None if scene is None else grid_in(scene),
        robot_radius=p.robot.radius,
        goal_radius=p.task.radius,
    )


def walkers_of(scene: Scene | None) -> NDArray[np.float64]:
    """Return x, y and radius of all circles if any of them walks, shape (C, 3), m; else none, shape (0, 3)."""
    if scene is None or not scene.room.circles[: scene.room.counts[0], 3:].any():
        return np.empty((0, 3))
    return scene.room.circles[: scene.room.counts[0], :3].copy()
