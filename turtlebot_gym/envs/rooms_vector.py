"""The native vector environment of rooms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turtlebot_gym.envs.common import PARTS, Room
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.envs.rooms import no_way
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise, Reward
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.geodesic import UNKNOWN
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.rooms.worlds import World, find_lidar, find_world, with_options
from turtlebot_gym.systems import Parameters, make_room
from turtlebot_gym.tasks import ROOM


class RoomsVectorEnv(NavigationVectorEnv):
    """Many `RoomsEnv`s at once, each with its own room; otherwise like `NavigationVectorEnv`.

    ``info`` always holds ``clearance``, ``path_length``, ``way_left`` and ``collision``, shape (N,).

    Args:
        num_envs: Number of environments.
        max_episode_steps: See `NavigationVectorEnv`, as for the next four arguments.
        autoreset_mode: See there.
        info: See there.
        render_mode: See there.
        render_rows: See there.
        world: See `RoomsEnv`, as for all further arguments.
        lidar: See there.
        robot: See there.
        noise: See there.
        filter: See there.
        integrator: See there.
        observation: See there.
        reward: See there.
        arrival: See there.
        dt: See there.
        delay: See there.
        fix: See there.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a given world has no path from start to goal.
    """

    _options = ("start", "goal")

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        info: str = "default",
        render_mode: str | None = None,
        render_rows: int = 9,
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
    ) -> None:
        self._room = self._own = Room(find_world(world), find_lidar(lidar))
        self._asked: dict[int, Parameters] = {}
        self._usual: dict[int, Parameters] = {}
        super().__init__(
            num_envs,
            max_episode_steps=max_episode_steps,
            autoreset_mode=autoreset_mode,
            info=info,
            render_mode=render_mode,
            render_rows=render_rows,
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
        )

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Use other parameters from the next step on: one for all environments, or one for each."""
        super().set_parameters(parameters)
        self._usual = {}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes.

        Args:
            seed: See `NavigationVectorEnv.reset`.
            options: ``reset_mask``, see there; ``start`` and ``goal``, for the episodes that begin now only: a pose (x, y,
                theta) for all environments, or one for each, shape (N, 3).

        Raises:
            ValueError: If an option is unknown or invalid, or there is no path from start to goal.
        """
        self._asked = asked = self._with_poses(options)
        try:
            observations, infos = super().reset(seed=seed, options=options)
        finally:
            self._asked = {}
        lost = next((row for row in asked if infos["way_left"][row] == UNKNOWN), None)
        if lost is not None:
            self._begun = False
            raise ValueError(f"Environment {lost}: {no_way(asked[lost])}")
        return observations, infos

    def _with_poses(self, options: dict[str, Any] | None) -> dict[int, Parameters]:
        """Return new parameters, by environment, where options set a start or a goal."""
        if isinstance(options, Mapping) and "world" in options:
            raise ValueError("world must be the same in all episodes of a vector environment: make another one with world=...")
        mask = self._reset_mask(options)
        given = {name: value for name, value in (options or {}).items() if name != "reset_mask"}
        for name, value in given.items():
            if name in ("start", "goal") and np.shape(value) not in ((3,), (self.num_envs, 3)):
                raise ValueError(
                    f"{name} must be x, y and heading, or those of each of {self.num_envs}, got {np.asarray(value).tolist()!r}."
                )
        asked: dict[int, Parameters] = {}
        rows = self._rows()
        for row in np.flatnonzero(mask).tolist() if given else ():
            usual = self._usual[row] if row in self._usual else rows[row]
            plan, rules, lidar = self._own.world, *usual.room
            poses = {name: value[row] if np.ndim(value) == 2 else value for name, value in given.items()}
            world = with_options(plan if isinstance(plan, FloorPlan) else rules, poses)
            asked[row] = usual._replace(room=make_room(world, lidar, usual.dt))
        return asked

    def _rows(self) -> list[Parameters]:
        """Return the parameters of each environment."""
        parameters = self._batch.parameters
        return [parameters] * self.num_envs if isinstance(parameters, Parameters) else list(parameters)

    def _begin(self, mask: NDArray[np.bool_], observations: NDArray[np.float32], outcomes: NDArray[np.float64]) -> None:
        if self._asked or self._usual:
            rows = self._rows()
            for row in [row for row in self._usual if mask[row]]:
                rows[row] = self._usual.pop(row)
            for row, parameters in self._asked.items():
                self._usual[row], rows[row] = rows[row], parameters
            self._batch.set_parameters(rows[0] if all(one is rows[0] for one in rows) else rows)
        super()._begin(mask, observations, outcomes)

    def truth(self) -> tuple[Scene, NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground truth: the rooms, the true states (N, 5), and the goals' poses (N, 3)."""
        return self._batch.scenes, self._batch.numbers(PARTS["true_state"]), self._batch.numbers(PARTS["reference"])
