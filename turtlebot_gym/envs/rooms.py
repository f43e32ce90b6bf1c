"""The environment of rooms: navigation with walls and obstacles around, and a LiDAR."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.envs.common import Room, read_options
from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise, Reward
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.geodesic import MARGIN, UNKNOWN
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.worlds import World, find_lidar, find_world, with_options
from turtlebot_gym.systems import Parameters, make_room
from turtlebot_gym.tasks import ROOM


class RoomsEnv(NavigationEnv):
    """A differential-drive robot that finds its way through a room, on a filter's estimate and LiDAR ranges.

    ## Description

    `NavigationEnv` with walls and obstacles that differ from episode to episode; a path to the goal always exists. The robot
    knows its goal only in the frame of its odometry, and the room only through a LiDAR that turns as the robot drives.

    ## Action Space

    That of `NavigationEnv`.

    ## Observation Space

    ``Box((50,), float32)``, layout 2. The first 13 numbers are those of `NavigationEnv`.

    | # | Observation | Unit | Min | Max |
    |---|---|---|---|---|
    | 0 to 12 | belief and goal, see `NavigationEnv` | | | |
    | 13 to 48 | shortest range of the newest scan in 36 sectors, from ahead to the left, as shares of 3.5 m | | 0 | 1 |
    | 49 | age of that scan, by its stamp | s | 0 | 1 |

    ## Rewards

    Progress along the *shortest path* through the room instead of the straight line; minus 50 for a collision; minus 0.5 per
    step times the share of 0.15 m that the clearance lacks. The rest is as in `NavigationEnv`.

    ## Starting State

    At rest in a randomly drawn room, at least 1.5 m away from the goal. The first scan is complete. The options ``world``,
    ``start`` and ``goal`` of `reset` set them for an episode.

    ## Episode End

    Termination: by the true pose, the robot is within 0.2 m of the goal, or its footprint touches something. Truncation: after
        600
    steps, by Gymnasium's ``TimeLimit``.

    ## Info

    That of `NavigationEnv`, and ``clearance`` (from the footprint to the nearest object, m), ``path_length`` (driven since the
    start, m), ``way_left`` (length of the shortest path to the goal on a grid, at most 8 % too long, m) and ``collision``.

    ## Arguments

    Args:
        world: "clutter", "dense", "corridor", "office", "cellular", "crowd", the path of a Gazebo world (``.world``, ``.sdf``)
            or of a map (``.yaml``), a `turtlebot_gym.rooms.rules.RoomRules` or a `turtlebot_gym.rooms.plan.FloorPlan`.
        lidar: "lds01", "lds02", "a1", "ideal", or a `turtlebot_gym.rooms.lidar.Lidar`.
        robot: See `NavigationEnv`, as for all further arguments.
        noise: See there.
        filter: See there.
        integrator: See there.
        observation: See there.
        reward: See there.
        arrival: See there.
        dt: See there.
        delay: See there.
        fix: See there.
        render_mode: See there.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a given world has no path from start to goal.

    ## Version History

    * v0: first version, observation layout 2.
    """

    def __init__(
        self,
        *,
        world: World = "dense",
        lidar: str | Lidar = "lds01",
        robot: str | Robot = "burger",
        noise: str | Noise = "tutorial",
        filter: str | FilterTuning = "matched",
        integrator: str = "euler",
        observation: str = "ekf",
        reward: Reward | None = None,
        arrival: str = "truth",
        dt: float = 0.1,
        delay: int = 0,
        fix: str | FixNoise | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._room = self._own = Room(find_world(world), find_lidar(lidar))
        self._world = self._own.world
        super().__init__(
            task=ROOM,
            robot=robot,
            noise=noise,
            filter=filter,
            integrator=integrator,
            observation=observation,
            reward=reward,
            arrival=arrival,
            dt=dt,
            delay=delay,
            fix=fix,
            render_mode=render_mode,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode: the first one of a seed, or the next.

        Args:
            seed: Seed of the episodes; None begins the next episode of the seed in use.
            options: For this episode only: ``world``, as the environment takes it; ``start`` and ``goal``, poses (x, y, theta).

        Raises:
            ValueError: If an option is unknown or invalid, or there is no path from start to goal.
        """
        self._enter(read_options(options, ("world", "start", "goal")))
        observation, info = super().reset(seed=seed)
        if info["way_left"] == UNKNOWN:
            self._started = False
            raise ValueError(no_way(self.parameters))
        return observation, info

    def _enter(self, options: dict[str, Any]) -> None:
        """Use the world in a reset's options, or else the environment's own."""
        world = with_options(self._own.world, options)
        if world is not self._world:
            parameters = self.parameters
            room = make_room(world, self._own.lidar, parameters.dt)
            self._batch.set_world(parameters._replace(room=room), world if isinstance(world, FloorPlan) else None)
            self._world = world
            self.close()  # the renderer holds the arrays of the old world


def no_way(parameters: Parameters) -> str:
    """Return why a robot cannot reach its goal."""
    radius = parameters.robot.radius
    return f"No way leads from start to goal for a robot of radius {radius:g} m that keeps {MARGIN:g} m to everything."
