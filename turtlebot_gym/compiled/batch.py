"""A batch of environments: its buffers, and the compiled loops over them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.loop import loops_of
from turtlebot_gym.compiled.packing import TILE, aligned, as_tuple, flatten, layout_of
from turtlebot_gym.compiled.threads import Pace, Threads, address_of, parallel_loop, sizes_of
from turtlebot_gym.heart import begin_at
from turtlebot_gym.kernel import HAS_NUMBA
from turtlebot_gym.observations import History, size_of
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import arrays_of
from turtlebot_gym.systems import Parameters, RoomParts, Snapshot, System, WithTerms, find_system
from turtlebot_gym.systems.special import GENERAL, Special, special_of
from turtlebot_gym.tasks import StartAndGoal
from turtlebot_gym.values import Pose

PARALLEL_FROM = 64 * TILE
"""Batches below this size run on one thread: splitting costs more than it saves."""
ROOMS_PARALLEL_FROM = 8 * TILE
"""The same in rooms, where a step takes about ten times as long."""


class Batch:
    """Environments that are stepped together, from one to many thousands.

    Args:
        num_envs: Number of environments.
        parameters: One for all environments, or one for each.
        waypoints: The poses to visit, the same for all; a goal that the task draws replaces the first.
        system: The kernels of a step, or what `find_system` takes; None for the system that belongs to the parameters.
        plan: The floor plan of a given room, the same for all.
        shares: Whether outcomes have a row for the share of each term of the reward, too.
    """

    def __init__(
        self,
        num_envs: int,
        parameters: Parameters | Sequence[Parameters],
        waypoints: Sequence[Pose],
        *,
        system: System | str | Callable[[Parameters], System] | WithTerms | None = None,
        plan: FloorPlan | None = None,
        shares: bool = False,
    ) -> None:
        n_tiles = -(-num_envs // TILE)
        self._own, self._by_parameters = system, system is None or (isinstance(system, WithTerms) and system.system is None)
        self.parameters = parameters
        self._find_system()
        layout = self.layout
        self.num_envs = num_envs
        self.seeds = np.zeros(num_envs, np.int64)
        self.episodes = np.zeros(num_envs, np.int64)
        self.waypoints = np.tile(np.array(waypoints, np.float64), (num_envs, 1, 1))
        self._keys = np.zeros((n_tiles, TILE + 2), np.int64)
        self._keys[:, TILE] = np.arange(n_tiles)
        self._tiles = aligned(n_tiles * layout.world.size * TILE).reshape(n_tiles, -1)
        self._plan = plan
        is_large = num_envs >= (ROOMS_PARALLEL_FROM if self._around else PARALLEL_FROM)
        self._parallel = is_large and HAS_NUMBA and self.system.compiled
        self._addresses: dict[str, int] = {}
        """Of the loops that a parallel loop calls, for the present scenes and this process."""
        self._pace = Pace()
        self._parts = 1
        """Parts of the last step's tiles, each for a thread."""
        self.scenes: Any = np.zeros(1)  # numba takes longer to know the type of a tuple, even of an empty one
        rows = layout.outcome.size - (0 if shares else len(self.system.rewards))
        self._shapes = (num_envs, size_of(self.system.terms)), (rows, num_envs)
        history = History(self.system.terms, num_envs)
        self._history = history if history else None  # a test for None takes a tenth of a microsecond less
        self._first = self._tiles[0]
        self._special: Special | None = None
        self._intervals: NDArray[np.float64] = np.empty(0)
        self._selected: list[NDArray[np.intp]] = []
        self._begun = False
        """Whether an episode has begun: its world may be none of another case."""
        self.set_parameters(parameters)

    def _find_system(self) -> None:
        self.system = find_system(self._own, self.parameters_of(0))
        self.layout, self._around = layout_of(self.system, GENERAL), self.system.surroundings

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without views, local functions and addresses."""
        kernels = {"system", "layout", "_around", "_loops", "_first"}
        return {name: value for name, value in self.__dict__.items() if name not in kernels} | {"_addresses": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._find_system()
        assert self._special is not None
        self._loops, self._first = loops_of(self.system, self._special), self._tiles[0]

    def parameters_of(self, row: int) -> Parameters:
        """Return the parameters of one environment."""
        return self.parameters if isinstance(self.parameters, Parameters) else self.parameters[row]

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Use other parameters from the next step on: one for all environments, or one for each.

        Rooms of other sizes are drawn at the next reset; the environments must be reset before the next step.
        """
        same = isinstance(parameters, Parameters)
        rows = [parameters] if same else list(parameters)
        if self._by_parameters and any(find_system(self._own, row) != self.system for row in rows):
            raise ValueError(
                "parameters must be for one system: the kind of filter must be the same in all, and so must the plant; "
                "rooms and fixes must be in all or none; rewards must have the same terms."
            )
        if not same and len(rows) != self.num_envs:
            raise ValueError(f"parameters must be one or {self.num_envs}, got {len(rows)}.")
        self.parameters = parameters
        self._addresses = {}
        numbers = np.array([list(flatten(as_tuple(row))) for row in rows], np.float64)
        self._choose_loops(numbers)
        if self._around:
            self._make_room_for(self._around, rows * self.num_envs if same else rows)
        layout = self._loops.layout.parameters
        varying = [index for index, place in enumerate(layout.places) if place >= 0]
        last, whole = len(rows) - 1, -(-len(rows) // TILE) * TILE
        table = numbers[np.minimum(np.arange(whole), last)][:, varying]  # the last row fills the last tile
        tiles = table.reshape(len(table) // TILE, TILE, layout.size).transpose(0, 2, 1)
        self._parameters = aligned(layout.ahead + tiles.size)
        self._parameters[: len(layout.shared)] = numbers[0, list(layout.shared)]
        self._parameters[layout.ahead :].reshape(tiles.shape)[:] = tiles

    def _choose_loops(self, numbers: NDArray[np.float64]) -> None:
        """Use the loops of a special case, if one holds for some parameters, shape (1, K) or (N, K), and for the world."""
        before, special = self._special, GENERAL
        if self._by_parameters and not (self._begun and before == GENERAL):
            of_each = dict(zip(self.layout.parameters.names, numbers.T, strict=True))
            special = special_of(self.system, of_each, self.waypoints.shape[1])
            intervals, self._intervals = self._intervals, of_each["dt"]
            if before is not None and self._begun:
                # fixes are as many steps late as ever only if those were as long
                alike = not special.late or np.array_equal(intervals[:1], self._intervals[:1])
                special = special if special.allows(before) and alike else GENERAL
        if special == before:
            return
        numbers_at = self._tiles.reshape(len(self._tiles), -1, TILE)
        if before is not None:
            numbers_at = numbers_at[:, self._loops.layout.world.places]
        self._special, self._loops = special, loops_of(self.system, special)
        world = self._loops.layout.world
        self._tiles = aligned(len(numbers_at) * world.size * TILE).reshape(len(numbers_at), -1)
        tiles = self._tiles.reshape(len(self._tiles), -1, TILE)
        tiles[:, world.places] = numbers_at
        if not self._begun:
            for path, value in special.world:
                tiles[:, world.places[world.names.index(path)]] = value
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

    def _make_room_for(self, around: RoomParts, parameters: Sequence[Parameters]) -> None:
        """Allocate scenes for parameters, unless the existing ones have the same sizes."""
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
        given: Mapping[int, StartAndGoal] = MappingProxyType({}),
    ) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where the mask is true, and write their first observations.

        Args:
            mask: Shape (N,).
            observations: Shape (N, K); rows outside the mask are left as they are.
            outcomes: Shape (m, N), see `step`; columns outside the mask are left as they are.
            given: On open ground, start and goal of these rows of the mask, in place of those that their task draws.
        """
        self._begun = True
        self._visit(mask, True, observations, outcomes)
        if given:
            for row, poses in given.items():
                self._begin_at(row, poses)
            at = np.zeros(self.num_envs, np.bool_)
            at[list(given)] = True
            self._visit(at, False, observations, outcomes)
        if self._history is not None:
            self._history.begin(observations, mask)

    def _begin_at(self, row: int, poses: StartAndGoal) -> None:
        """Begin the episode of a row anew, from given poses: in plain Python, which has the bits of the compiled loops."""
        at, lane = divmod(row, TILE)
        world, goal = begin_at(self.system, poses, int(self._keys[at, lane]), self.parameters_of(row))
        self.waypoints[row, 0] = goal
        tile = self._tiles[at].reshape(-1, TILE)
        tile[list(self._loops.layout.world.places), lane] = [*flatten(world)]

    def last(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return observations of the current state, and outcomes as after a reset, in the shapes of `step`."""
        observations, outcomes = self.empty()
        self._visit(np.ones(self.num_envs, np.bool_), False, observations, outcomes)
        if self._history is not None:
            self._history.show(observations)
        return observations, outcomes

    def _visit(
        self,
        mask: NDArray[np.bool_],
        begins: bool,
        observations: NDArray[np.float32],
        outcomes: NDArray[np.float64],
    ) -> None:
        """Write some observations without the past of a history, and begin the episodes first if asked."""
        parallel = self._around is not None and self._parallel and Threads.acquire()
        state = self._tiles, self._keys, self._parameters, self.waypoints, observations, outcomes, self.scenes
        try:
            self._run("reset", Threads.count() if parallel else 1, mask, begins, self.seeds, self.episodes, *state)
        finally:
            if parallel:
                Threads.release()

    def _run(self, name: str, parts: int, *arguments: Any) -> None:
        """Run a loop over all tiles in some parts, each on a thread."""
        loop = getattr(self._loops, name)
        if parts > 1 and name not in self._addresses:
            self._addresses[name] = address_of(loop, *arguments)
        if parts == 1 or not self._addresses[name]:
            loop(*arguments)
            return
        parallel_loop(name, sizes_of(self.scenes))(self._addresses[name], parts, *arguments)

    def empty(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return uninitialized observations and outcomes, in the shapes of `step`, that nobody else holds."""
        shape, shape_of_outcomes = self._shapes
        return np.empty(shape, np.float32), np.empty(shape_of_outcomes)

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), finite; clipped to [-1, 1].

        Returns:
            Observations, shape (N, K), and outcomes, shape (m, N), with a row for each field of `Judgement` after one for the
            reward, and for each term's share if asked for. Both are new arrays.
        """
        observations, outcomes = self.empty()
        if self.num_envs > 1 and not actions.flags.carray:  # the loop would be compiled anew for each kind of array
            actions = actions.copy()
        if not self._parallel or Threads.limit == 1 or Threads.count() == 1:
            self._parts = 1
            self._loops.step(
                actions, self._tiles, self._keys, self._parameters, self.waypoints, observations, outcomes, self.scenes
            )
        else:
            self._step_at_pace(actions, observations, outcomes)
        if self._history is not None:
            self._history.advance(observations)
        return observations, outcomes

    def _step_at_pace(
        self, actions: NDArray[np.float32], observations: NDArray[np.float32], outcomes: NDArray[np.float64]
    ) -> None:
        """Step on one thread or on all, as the measured times say, unless another Python thread uses all."""
        state = self._tiles, self._keys, self._parameters, self.waypoints, observations, outcomes, self.scenes
        parallel, start = self._pace.parallel, time.perf_counter()
        shared = parallel and Threads.acquire()
        try:
            self._parts = Threads.count() if shared else 1
            self._run("step", self._parts, actions, *state)
        finally:
            if shared:
                Threads.release()
        if shared or not parallel:  # otherwise the pace's choice was not tried
            self._pace.tell(time.perf_counter() - start)

    def is_flagged(self) -> bool:
        """Return whether the last step has set a flag of any environment: success, termination or truncation."""
        parts, last = self._parts, len(self._keys)
        if parts == 1:
            return self._keys[-1, TILE + 1] > 0
        return any(self._keys[(part + 1) * last // parts - 1, TILE + 1] > 0 for part in range(parts))

    def numbers(self, path: str) -> NDArray[np.float64]:
        """Return a copy of one part of all worlds by dotted path, such as "body.true_state": (N, k), or (N,) for a number."""
        world = self._loops.layout.world
        single = path in world.names
        places = world.places[world.names.index(path)] if single else world.places[world.slices[path]]
        part = self._tiles.reshape(len(self._tiles), -1, TILE)[:, np.atleast_1d(places)]
        rows = part.transpose(0, 2, 1).reshape(-1, part.shape[1])[: self.num_envs]
        return rows[:, 0].copy() if single else rows.copy()

    def select(self, *parts: ArrayLike) -> None:
        """Choose numbers of a world for `selected` and `first_selected`: arrays of any shape of their indices in the layout."""
        self._selected = [np.asarray(part, np.intp) for part in parts]
        at = np.array(self._loops.layout.world.places, np.intp)
        places = [at[part] for part in self._selected]
        self._selected_places = np.concatenate([at[:0], *map(np.ravel, places)])
        self._first_places = tuple(part * TILE for part in places)

    def selected(self) -> NDArray[np.float64]:
        """Return a copy of the k chosen numbers of all worlds, shape (k, N).

        Each tile's run is copied as a whole; rows of k numbers would take five times as long.
        """
        tiles = self._tiles.reshape(len(self._tiles), -1, TILE)
        return tiles.transpose(1, 0, 2)[self._selected_places].reshape(len(self._selected_places), -1)[:, : self.num_envs]

    def put(self, path: str, values: NDArray[np.float64]) -> None:
        """Write one part of all worlds, shape (N, k), as `numbers` returns it: to carry robots elsewhere, for example."""
        world, index = self._loops.layout.world, np.arange(self.num_envs)
        part = self._tiles.reshape(len(self._tiles), -1, TILE)
        for column, place in zip(values.T, world.places[world.slices[path]], strict=True):
            part[index // TILE, place, index % TILE] = column

    def first_selected(self) -> tuple[NDArray[np.float64], tuple[NDArray[np.intp], ...]]:
        """Return the numbers of the first environment, and where each chosen part stands in them.

        ``numbers[part]`` is a copy of a part, in its shape; all parts take a fifth of the time of `selected`.
        """
        return self._first, self._first_places

    def world(self, index: int) -> Snapshot:
        """Return one environment's world in Python numbers."""
        return self._loops.layout.world.load(self._tiles[index // TILE].tolist(), index % TILE)
