"""A batch of environments: its buffers, and the compiled loops over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.loop import Loops
from turtlebot_gym.compiled.packing import TILE, Packing, access, aligned, as_tuple, flatten, layout_of
from turtlebot_gym.compiled.program import address_of
from turtlebot_gym.compiled.runner import Runner
from turtlebot_gym.compiled.values import Untraceable
from turtlebot_gym.heart import step_of
from turtlebot_gym.observations.columns import History, size_of
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import arrays_of
from turtlebot_gym.systems import Parameters, Snapshot, System, system_of
from turtlebot_gym.tasks import draw_goal, start_pose
from turtlebot_gym.values import Pose

FEW = 16
"""Most environments whose results are faster to copy than the addresses of new arrays are to find."""


class Batch:
    """Environments that are stepped together, from one to many thousands.

    Args:
        num_envs: Number of environments.
        parameters: One for all environments, or one for each.
        waypoints: The poses to visit, the same for all; a goal that the task draws replaces the first.
        system: The kernels of a step; None for those of the parameters.
        plan: The floor plan of a given room, the same for all.
        shares: Whether outcomes have a row for the share of each term of the reward, too.
    """

    def __init__(
        self,
        num_envs: int,
        parameters: Parameters | Sequence[Parameters],
        waypoints: Sequence[Pose],
        *,
        system: System | None = None,
        plan: FloorPlan | None = None,
        shares: bool = False,
    ) -> None:
        self.num_envs, self.parameters, self._n_tiles = num_envs, parameters, -(-num_envs // TILE)
        self.system = system = system or system_of(self.parameters_of(0))
        self.layout, self._plan = layout_of(system), plan
        self._runner = Runner(system, num_envs, shares)
        self._shapes = size_of(system.terms), self.layout.outcome.size - (0 if shares else len(system.rewards))
        self.seeds = np.zeros(num_envs, np.int64)
        self.episodes = np.zeros(num_envs, np.int64)
        self.waypoints = np.tile(np.array(waypoints, np.float64), (num_envs, 1, 1))
        self._keys = np.zeros((self._n_tiles, TILE), np.int64)
        self.scenes: Any = ()
        history = History(system.terms, num_envs)
        self._history = history if history else None  # a test for None takes a tenth of a microsecond less
        self._world: Packing | None = None
        self._selected: list[NDArray[np.intp]] = []
        self._begun = False
        self._flagged = 0
        self.set_parameters(parameters)

    def parameters_of(self, row: int) -> Parameters:
        """Return the parameters of one environment."""
        return self.parameters if isinstance(self.parameters, Parameters) else self.parameters[row]

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Use other parameters from the next step on: one for all environments, or one for each.

        Rooms of other sizes are drawn at the next reset; the environments must be reset before the next step.
        """
        same = isinstance(parameters, Parameters)
        rows = [parameters] if same else list(parameters)
        now = system_of(self.parameters_of(0))
        if any(system_of(row) != now for row in rows):
            raise ValueError(
                "parameters must be for one system: the kind of filter must be the same in all; "
                "rooms and fixes must be in all or none; rewards must have the same terms."
            )
        if not same and len(rows) != self.num_envs:
            raise ValueError(f"parameters must be one or {self.num_envs}, got {len(rows)}.")
        self.parameters = parameters
        self._make_room_for(rows * self.num_envs if same else rows)
        numbers = np.array([list(flatten(as_tuple(row))) for row in rows], np.float64)
        varying = self._runner.find(numbers, self.waypoints.shape[1], self._begun)
        self._lay_out(self._runner.loops)
        last, whole = len(rows) - 1, -(-len(rows) // TILE) * TILE
        table = numbers[np.minimum(np.arange(whole), last)][:, varying]  # the last row fills the last tile
        tiles = table.reshape(len(table) // TILE, TILE, len(varying)).transpose(0, 2, 1)
        self._parameters = aligned(tiles.size)
        self._parameters.reshape(tiles.shape)[:] = tiles
        self._asked = np.zeros(2 * self._n_tiles * TILE, np.float32)
        self.given = self._asked[: 2 * self.num_envs].reshape(-1, 2)
        self._copies = self.num_envs <= FEW or self.num_envs % TILE > 0
        """Whether actions are copied: loops read those of whole tiles."""

    def _lay_out(self, loops: Loops) -> None:
        """Move the numbers of all worlds to the places of other loops."""
        world, before = loops.world, self._world
        self._access = access(world)
        if before is not None and world.places == before.places:
            return
        tiles = aligned(self._n_tiles * world.size * TILE).reshape(self._n_tiles, world.size, TILE)
        if before is not None:
            tiles[:, world.places] = self._tiles.reshape(self._n_tiles, -1, TILE)[:, before.places]
        if not self._begun:
            for place, value in loops.constants.items():
                tiles[:, place] = value
        self._world, self._tiles = world, tiles.reshape(self._n_tiles, -1)
        self._first = self._tiles[0]
        self.select(*self._selected)

    def set_world(self, parameters: Parameters, plan: FloorPlan | None) -> None:
        """Use another world; the environments must be reset before the next step.

        Args:
            parameters: For all environments, with the rules of the world.
            plan: Its floor plan, if it has one.
        """
        self._plan, self.scenes = plan, None
        self.set_parameters(parameters)

    def _make_room_for(self, parameters: Sequence[Parameters]) -> None:
        """Allocate scenes for parameters, unless the existing ones have the same sizes."""
        around = self.system.surroundings
        scenes = around.make(parameters)
        if self._plan:
            scenes = self._plan.share(scenes)
        if self.scenes is None or [part.shape for part in arrays_of(scenes)] != [part.shape for part in arrays_of(self.scenes)]:
            self.scenes = scenes
            if self._plan:
                for index in range(self.num_envs):
                    self._plan.put(around.at(scenes, index))

    def reset(
        self,
        mask: NDArray[np.bool_],
        observations: NDArray[np.float32],
        outcomes: NDArray[np.float64],
        *,
        poses: Mapping[str, Pose] = MappingProxyType({}),
    ) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where the mask is true, and write their first observations.

        Args:
            mask: Shape (N,).
            observations: Shape (N, K); rows outside the mask are left as they are.
            outcomes: Shape (m, N), see `step`; columns outside the mask are left as they are.
            poses: On open ground, ``start`` and ``goal`` of a batch of one, in place of those that its task draws.
        """
        self._begun = True
        self._visit(np.ascontiguousarray(mask), True, observations, outcomes)
        if poses:
            self._begin_at(poses)
            self._visit(mask, False, observations, outcomes)
        if self._history is not None:
            self._history.begin(observations, mask)

    def _begin_at(self, poses: Mapping[str, Pose]) -> None:
        """Begin the first episode anew, from given poses: in plain Python, which has the bits of the compiled loops."""
        p, key = self.parameters_of(0), int(self._keys[0, 0])
        start = poses.get("start") or start_pose(key, p.task)
        self.waypoints[0, 0] = goal = poses.get("goal") or draw_goal(key, start, p.task)
        self._access.store(self._first, 0, step_of(self.system).begin(start, key, (goal,), p, ()))

    def last(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return observations of the current state, and outcomes as after a reset, in the shapes of `step`."""
        observations, outcomes = self.empty()
        self._visit(np.ones(self.num_envs, np.bool_), False, observations, outcomes)
        if self._history is not None:
            self._history.show(observations)
        return observations, outcomes

    def _visit(
        self, mask: NDArray[np.bool_], begins: bool, observations: NDArray[np.float32], outcomes: NDArray[np.float64]
    ) -> None:
        """Write some observations without the past of a history, and begin the episodes first if asked."""
        state = self._tiles, self._keys, self._parameters, self.waypoints, observations, outcomes, self.scenes
        words = address_of(mask), int(begins), address_of(observations), address_of(outcomes)
        try:
            self._runner.run("reset", words, mask, begins, self.seeds, self.episodes, *state)
        except Untraceable as error:
            self._give_up(error)
            self._visit(mask, begins, observations, outcomes)

    def _give_up(self, error: Untraceable) -> None:
        """Go on in plain Python, for which all numbers of parameters and worlds are laid out."""
        self._runner.give_up(error)
        self.set_parameters(self.parameters)

    def empty(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return uninitialized observations and outcomes, in the shapes of `step`, that nobody else holds."""
        return self._new()[1]

    def _new(self) -> tuple[tuple[NDArray, NDArray], tuple[NDArray[np.float32], NDArray[np.float64]]]:
        """Return buffers of whole tiles, which loops write, and the parts of them that are observations and outcomes."""
        (width, rows), count, whole = self._shapes, self.num_envs, self._n_tiles * TILE
        shown, told = np.empty((whole, width), np.float32), np.empty((rows, whole + TILE))
        return (shown, told), (shown[:count], told[:, :count])

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), finite; clipped to [-1, 1].

        Returns:
            Observations, shape (N, K), and outcomes, shape (m, N), with a row for each field of `Judgement` after one for the
            reward, and for each term's share if asked for. Both are new arrays.
        """
        copies = self._copies or not actions.flags.carray
        if copies and actions is not self.given:
            self.given[:] = actions
        if (runner := self._runner).few is not None:
            count, observations, outcomes = runner.few
            self._flagged = count()
            return observations.copy(), outcomes.copy()
        given, state = self._asked if copies else actions.reshape(-1), (self._tiles, self._keys, self._parameters)
        buffers, (observations, outcomes) = self._new()
        words = address_of(given), address_of(buffers[0]), address_of(buffers[1])
        try:
            self._flagged = runner.run("step", words, given, *state, self.waypoints, observations, outcomes, self.scenes)
        except Untraceable as error:
            self._give_up(error)
            return self.step(actions)
        if self._history is not None:
            self._history.advance(observations)
        elif self.num_envs <= FEW:
            runner.keep(self._asked, *state, self.waypoints, *self.empty(), self.scenes)
        return observations, outcomes

    def is_flagged(self) -> bool:
        """Return whether the last step has set a flag of any environment: success, termination or truncation."""
        return self._flagged > 0

    def numbers(self, path: str) -> NDArray[np.float64]:
        """Return a copy of one part of all worlds by dotted path, such as "body.true_state": (N, k), or (N,) for a number."""
        world = self._world
        assert world is not None
        single = path in world.names
        places = world.places[world.names.index(path)] if single else world.places[world.slices[path]]
        part = self._tiles.reshape(len(self._tiles), -1, TILE)[:, np.atleast_1d(places)]
        rows = part.transpose(0, 2, 1).reshape(-1, part.shape[1])[: self.num_envs]
        return rows[:, 0].copy() if single else rows.copy()

    def select(self, *parts: ArrayLike) -> None:
        """Choose numbers of a world for `selected` and `first_selected`: arrays of any shape of their indices in the layout."""
        self._selected = [np.asarray(part, np.intp) for part in parts]
        at = np.array(self.layout.world.places if self._world is None else self._world.places, np.intp)
        places = [at[part] for part in self._selected]
        self._selected_places = np.concatenate([at[:0], *map(np.ravel, places)])
        self._first_places = tuple(part * TILE for part in places)

    def selected(self) -> NDArray[np.float64]:
        """Return a copy of the k chosen numbers of all worlds, shape (k, N).

        Each tile's run is copied as a whole; rows of k numbers would take five times as long.
        """
        tiles = self._tiles.reshape(len(self._tiles), -1, TILE)
        return tiles.transpose(1, 0, 2)[self._selected_places].reshape(len(self._selected_places), -1)[:, : self.num_envs]

    def first_selected(self) -> tuple[NDArray[np.float64], tuple[NDArray[np.intp], ...]]:
        """Return the numbers of the first environment, and where each chosen part stands in them.

        ``numbers[part]`` is a copy of a part, in its shape; all parts take a fifth of the time of `selected`.
        """
        return self._first, self._first_places

    def world(self, index: int) -> Snapshot:
        """Return one environment's world in Python numbers."""
        return self._access.load(self._tiles[index // TILE], index % TILE)
