"""A batch of environments: its buffers, and the compiled loops over them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.loop import loops_of
from turtlebot_gym.compiled.packing import TILE, Packing, access, aligned, as_tuple, layout_of
from turtlebot_gym.compiled.proof import Case
from turtlebot_gym.compiled.threads import TileLoop
from turtlebot_gym.compiled.values import Untraceable, numbers_of
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.observations.columns import History, size_of
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import arrays_of
from turtlebot_gym.systems import Parameters, Snapshot, System, system_of
from turtlebot_gym.tasks import draw_goal, start_pose
from turtlebot_gym.values import Pose

FEW = 16
"""Most environments whose results are faster to copy than the addresses of new arrays are to find."""
PARALLEL_FROM = 8192
"""Batches below this size run on one thread: splitting costs more than it saves."""
ROOMS_PARALLEL_FROM = 256
"""The same in rooms, where a step takes about ten times as long."""
FOLDED_FROM = 512
"""Batches below this size load shared parameters that are not whole numbers: code of their own would never pay for itself."""
CHANGING = {"step": (5, 6), "reset": (1, 2, 9, 10)}
"""Arguments of the loops that differ from call to call: results, and of a reset how many episodes, and whether they begin."""


class Batch:
    """Environments that are stepped together, from one to many thousands.

    Args:
        num_envs: Number of environments.
        parameters: One for all environments, or one for each.
        waypoints: The poses to visit, the same for all; a goal that the task draws replaces the first.
        system: The kernels of a step; None for those of the parameters.
        plan: The floor plan of a given room, the same for all.
        shares: Whether outcomes have a row for the share of each term of the reward, too.

    Attributes:
        flagged: Number of flags that the last step has set: success, termination or truncation.
        first: The numbers of the first environment, and the places of each chosen part in them: ``numbers[part]`` is a copy of
            a part, in its shape; all parts take a fifth of the time of `selected`.
    """

    first: tuple[NDArray[np.float64], tuple[NDArray[np.intp], ...]]

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
        self.layout, self._plan, self._shares = layout_of(system), plan, shares
        self._is_compiled = system.compiled and HAS_LLVM
        self._shapes = size_of(system.terms), self.layout.outcome.size - (0 if shares else len(system.rewards))
        self.seeds = np.zeros(num_envs, np.int64)
        self.episodes = np.zeros(num_envs, np.int64)
        self._rows = np.zeros(num_envs, np.int64)
        self.waypoints = np.tile(np.array(waypoints, np.float64), (num_envs, 1, 1))
        self._keys = np.zeros((self._n_tiles, TILE), np.int64)
        self.scenes: Any = ()
        history = History(system.terms, num_envs)
        self._history = history if history else None  # a test for None takes a tenth of a microsecond less
        self._asked = np.zeros(2 * self._n_tiles * TILE, np.float32)
        self.given = self._asked[: 2 * num_envs].reshape(-1, 2)
        self._world: Packing | None = None
        self._selected: list[NDArray[np.intp]] = []
        self._begun = False
        self.flagged = 0
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
        numbers = np.array([numbers_of(as_tuple(row)) for row in rows], np.float64)
        try:
            self._lay_out(numbers)
        except Untraceable as error:
            self._give_up(error)
            return
        whole = -(-len(rows) // TILE) * TILE
        table = numbers[np.minimum(np.arange(whole), len(rows) - 1)]  # the last row fills the last tile
        self._parameters = aligned(table.reshape(-1, TILE, numbers.shape[1]).transpose(0, 2, 1).reshape(whole // TILE, -1))

    def _lay_out(self, numbers: NDArray[np.float64]) -> None:
        """Find the loops for parameters, shape (1, K) or (N, K), and move the numbers of all worlds to their places there."""
        self._case, waypoints = None, self.waypoints.shape[1]
        if self._is_compiled and not self.system.in_room:
            pairs = zip(numbers[0].tolist(), (numbers == numbers[0]).all(axis=0), strict=True)
            folds, begun = self.num_envs >= FOLDED_FROM, self._begun  # begun with other parameters
            known = (value if same and (folds or value.is_integer()) and not begun else None for value, same in pairs)
            self._case = Case(tuple(known), waypoints, whole=begun)
        world, before, shape = self._use_loops(), self._world, (self._n_tiles, -1, TILE)
        if before is None or world.places != before.places:
            tiles = np.zeros((self._n_tiles, world.size, TILE))
            known = np.array([[0.0 if value is None else value] for value in world.known])
            tiles[:, world.places] = known if before is None else self._tiles.reshape(shape)[:, before.places]
            self._world, self._tiles = world, aligned(tiles.reshape(self._n_tiles, -1))
            self.select(*self._selected)

    def _use_loops(self) -> Packing:
        """Use the loops of the case, with other arguments than before; return the layout of their worlds."""
        world, *loops = loops_of(self.system._replace(compiled=self._is_compiled), self._case, self._shares)
        in_room, self._loops = self.system.in_room, dict[str, TileLoop]()
        is_parallel = self.num_envs >= (ROOMS_PARALLEL_FROM if in_room else PARALLEL_FROM)
        for (name, places), loop in zip(CHANGING.items(), loops, strict=True):
            # on open ground few episodes begin at a time, in less time than a thread needs to wake up
            self._loops[name] = TileLoop(loop, self._n_tiles, places, is_parallel=is_parallel and (in_room or name == "step"))
        self._few: tuple[Callable[[], int], NDArray[np.float32], NDArray[np.float64]] | None = None
        self._load, self._store = access(world)
        return world

    def _give_up(self, error: Untraceable) -> None:
        """Use loops in plain Python from now on, after a warning."""
        warnings.warn(f"turtlebot_gym: environments run as plain Python, since {error}.", RuntimeWarning, stacklevel=6)
        self._is_compiled = False
        self.set_parameters(self.parameters)

    def set_world(self, parameters: Parameters, plan: FloorPlan | None) -> None:
        """Use another world, with the rules in parameters; the environments must be reset before the next step."""
        self._plan, self.scenes = plan, ()
        self.set_parameters(parameters)

    def _make_room_for(self, parameters: Sequence[Parameters]) -> None:
        """Allocate scenes for parameters, unless the existing ones have the same sizes."""
        around = self.system.surroundings
        scenes = around.make(parameters)
        if self._plan:
            scenes = self._plan.share(scenes)
        if [part.shape for part in arrays_of(scenes)] != [part.shape for part in arrays_of(self.scenes)]:
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
        self._visit(np.flatnonzero(mask), True, observations, outcomes)
        if poses:  # in plain Python, which has the bits of the compiled loops
            p, key = self.parameters_of(0), int(self._keys[0, 0])
            start = poses.get("start") or start_pose(key, p.task)
            self.waypoints[0, 0] = goal = poses.get("goal") or draw_goal(key, start, p.task)
            self._store(self._tiles[0], 0, step_of(self.system).begin(start, key, (goal,), p, ()))
            self._visit(np.zeros(1, np.int64), False, observations, outcomes)
        if self._history is not None:
            self._history.begin(observations, mask)

    def last(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return observations of the current state, and outcomes as after a reset, in the shapes of `step`."""
        observations, outcomes = self.empty()
        self._visit(np.arange(self.num_envs), False, observations, outcomes)
        if self._history is not None:
            self._history.show(observations)
        return observations, outcomes

    def _visit(self, rows: NDArray[np.int64], begins: bool, *results: NDArray[Any]) -> None:
        """Begin the episodes of some environments if asked, and write their present results."""
        self._rows[: rows.size] = rows
        self._run("reset", (self._rows, rows.size, begins, self.seeds, self.episodes), *results)

    def _run(self, name: str, first: tuple[Any, ...], *results: NDArray[Any]) -> int:
        """Run a loop, with arguments before those that both loops have; return how many flags are set."""
        state = self._tiles, self._keys, self._parameters, self.waypoints
        try:
            return self._loops[name](*first, *state, *results, self.scenes)
        except Untraceable as error:  # at the first call, before anything has run
            self._give_up(error)
            return self._run(name, first, *results)

    def empty(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return uninitialized observations and outcomes, in the shapes of `step`, that nobody else holds."""
        (width, rows), count, whole = self._shapes, self.num_envs, self._n_tiles * TILE
        return np.empty((whole, width), np.float32)[:count], np.empty((rows, whole + TILE))[:, :count]

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), finite; clipped to [-1, 1].

        Returns:
            Observations, shape (N, K), and outcomes, shape (m, N), with a row for each field of `Outcome`, shares if asked for.
            Both are new arrays.
        """
        if actions is not self.given:
            self.given[:] = actions
        if self._few is not None:
            count, observations, outcomes = self._few
            self.flagged = count()
            return observations.copy(), outcomes.copy()
        observations, outcomes = self.empty()
        self.flagged = self._run("step", (self._asked,), observations, outcomes)
        if self._history is not None:
            self._history.advance(observations)
        elif self.num_envs <= FEW and (again := self._loops["step"].again()):
            self._few = again, observations, outcomes
            return observations.copy(), outcomes.copy()
        return observations, outcomes

    def numbers(self, path: str) -> NDArray[np.float64]:
        """Return a copy of one part of all worlds by dotted path, such as "body.true_state": (N, k), or (N,) for a number."""
        assert self._world is not None
        names, slices, places = self._world.names, self._world.slices, self._world.places
        if path in names:
            return self._numbers_at([places[names.index(path)]])[0].copy()
        return self._numbers_at(places[slices[path]]).T.copy()

    def _numbers_at(self, places: Any) -> NDArray[np.float64]:
        """Return the numbers of all worlds at k places, shape (k, N).

        Each tile's run is copied as a whole; rows of k numbers would take five times as long.
        """
        tiles = self._tiles.reshape(len(self._tiles), -1, TILE).transpose(1, 0, 2)
        return tiles[np.asarray(places, np.intp)].reshape(len(places), len(self._tiles) * TILE)[:, : self.num_envs]

    def select(self, *parts: ArrayLike) -> None:
        """Choose numbers of a world for `selected` and `first`: arrays of any shape of their indices in the layout."""
        assert self._world is not None
        self._selected, at = [np.asarray(part, np.intp) for part in parts], np.array(self._world.places)
        self._places = np.concatenate([at[:0], *(at[part].ravel() for part in self._selected)])
        self.first = self._tiles[0], tuple(at[part] * TILE for part in self._selected)

    def selected(self) -> NDArray[np.float64]:
        """Return a copy of the k chosen numbers of all worlds, shape (k, N)."""
        return self._numbers_at(self._places)

    def world(self, index: int) -> Snapshot:
        """Return one environment's world in Python numbers."""
        return self._load(self._tiles[index // TILE], index % TILE)
