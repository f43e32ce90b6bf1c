"""The step of open ground, and the start of an episode, traced for a system and its parameters, as machine code.

The kernels are those of `turtlebot_gym.heart`, unchanged. What all environments share is folded into the code; what differs
between them is loaded with their state. The code runs a tile of eight environments at a time, without a call.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym import heart
from turtlebot_gym.compiled import graph, invariants, native
from turtlebot_gym.compiled.cache import fingerprint, sources_of
from turtlebot_gym.compiled.graph import Graph, Node, Untraceable, as_kind, load, make, rebuilt
from turtlebot_gym.compiled.memory import reset_text, step_text
from turtlebot_gym.compiled.packing import Packing, layout_of, mapped, packing
from turtlebot_gym.compiled.trace import merged, traced
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations import observing, runs_of
from turtlebot_gym.rewards import rewarding
from turtlebot_gym.systems.sensors import sensing
from turtlebot_gym.systems.system import System
from turtlebot_gym.values import Pose

one_at_a_time = threading.Lock()
"""Held while a graph is made, since its nodes are numbered."""
_MAKERS = ("graph", "trace", "invariants", "ground", "regions", "emit", "memory", "native", "packing", "values")
"""Modules that make the machine code."""


class Case(NamedTuple):
    """What machine code is made for, beside the system."""

    fixed: tuple[tuple[str, float], ...]
    """Parameters that all environments share, by dotted path."""
    own: tuple[str, ...]
    """Those that each environment has for itself."""
    waypoints: int
    """Number of waypoints."""
    before: tuple[tuple[str, Any], ...] | None = None
    """Classes of the world's numbers that hold already, if episodes go on."""


class Ground(NamedTuple):
    """Machine code of a case, and the layout of its memory."""

    world: Packing
    """The tile: numbers that are always equal share a place."""
    constants: tuple[tuple[int, float], ...]
    """Places of numbers that never change, with their values, which the code neither reads nor writes."""
    own: tuple[str, ...]
    """Parameters of an environment, in the order of their tile."""
    classes: tuple[tuple[str, Any], ...]
    """See `invariants`."""
    step: Callable[[int], None]
    """Takes the address of a block, see `memory.BLOCK`."""
    reset: Callable[[int], None]


class _Waypoints:
    """The waypoints of an environment, in memory."""

    def __init__(self, count: int, first: Any = None) -> None:
        self.count, self.first = count, first

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: Any) -> Any:
        if not isinstance(index, Node) and index == 0 and self.first is not None:
            return self.first
        if self.count == 1:
            return tuple(load(f"goal.{name}") for name in Pose._fields)
        return tuple(Graph.now.node("gather", "f", as_kind(index, "i"), column) for column in range(3))


def _symbols(example: Any, prefix: str) -> Any:
    """Return a value of loads."""
    return mapped(example, lambda path, number: load(prefix + path, graph.kind_of(number)))


def numbers_of(value: Any, prefix: str, example: Any = None) -> dict[str, Any]:
    """Return the numbers of a value by name, in the kinds of an example."""
    found: dict[str, Any] = {}
    mapped(value, lambda path, number: found.setdefault(prefix + path, number))
    if example is None:
        return {name: as_kind(number, "f") for name, number in found.items()}
    like = numbers_of_kinds(example, prefix)
    if like.keys() != found.keys():
        raise Untraceable("a step that changes the structure of the world")
    return {name: as_kind(number, like[name]) for name, number in found.items()}


def numbers_of_kinds(example: Any, prefix: str) -> dict[str, str]:
    """Return the kinds of the numbers of a value by name."""
    found: dict[str, str] = {}
    mapped(example, lambda path, number: found.setdefault(prefix + path, graph.kind_of(number)))
    return found


def _parameters(system: System, case: Case) -> Any:
    fixed = dict(case.fixed)

    def number(path: str, like: Any) -> Any:
        return type(like)(fixed[path]) if path in fixed else load(f"p.{path}", graph.kind_of(like))

    return mapped(layout_of(system).parameters.example, number)


def _shown(system: System, world: Any, outcome: Any, p: Any) -> dict[str, Any]:
    """Return the numbers of an outcome and of the observation of a world."""
    return numbers_of(outcome, "outcome.") | numbers_of(traced(observing(system.terms))(world, p), "shown.")


def _traced_step(system: System, case: Case) -> dict[str, Any]:
    """Return the numbers after a step, in terms of those before it."""
    p, example = _parameters(system, case), layout_of(system).world.example
    command = traced(command_of)(load("action.0"), load("action.1"), p.robot)
    world = _symbols(example, "world.")
    after, outcome = traced(heart.step)(system, world, command, load("key", "i"), _Waypoints(case.waypoints), p, ())
    return numbers_of(after, "world.", example) | _shown(system, after, outcome, p)


def _traced_start(system: System, case: Case) -> dict[str, Any]:
    """Return the numbers of the world at the start of an episode, in terms of its start and goal."""
    p, example = _parameters(system, case), layout_of(system).world.example
    waypoints = _Waypoints(case.waypoints, _symbols(Pose(0.0, 0.0, 0.0), "goal."))
    start = _symbols(Pose(0.0, 0.0, 0.0), "start.")
    if case.waypoints > 1:
        waypoints.first = merged("sel", p.task.random, waypoints.first, _Waypoints(case.waypoints)[0])
    return numbers_of(traced(heart.begin)(system, start, load("key", "i"), waypoints, p, ()), "world.", example)


def _traced_reset(system: System, case: Case, start: dict[str, Any], classes: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers after a reset: of a new episode where one begins, otherwise of the present one."""
    p, example = _parameters(system, case), layout_of(system).world.example
    begins, key = load("begins", "b"), traced(episode_key)(load("seed", "i"), load("episode", "i"))
    pose, goal = traced(system.lay_out)(key, p, ())
    kept = _symbols(Pose(0.0, 0.0, 0.0), "goal.")
    goal = merged("sel", p.task.random, tuple(goal), tuple(kept))
    poses = numbers_of(Pose(*goal), "goal.") | numbers_of(Pose(*pose), "start.")
    begun = rebuilt(start, poses | {"key": key})
    kinds = numbers_of_kinds(example, "world.")
    present = invariants.assumed(classes, kinds)
    new = {name: make("if", begins, begun[name], value, 0) for name, value in present.items()}
    new = {name: new[what] if isinstance(what := classes[name], str) else what for name in new}
    world = mapped(example, lambda path, number: new[f"world.{path}"])
    outcome = traced(heart.start_outcome)(system, world)
    goals = {f"goal.{name}": make("if", begins, poses[f"goal.{name}"], load(f"goal.{name}"), 0) for name in Pose._fields}
    return new | goals | {"key": make("if", begins, key, load("key", "i"), 0)} | _shown(system, world, outcome, p)


def _as_stored(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return numbers as floats, as memory holds them; but a key is an integer."""
    return {name: value if name == "key" else as_kind(value, "f") for name, value in numbers.items()}


def make_graphs(system: System, case: Case) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return the numbers of a step, of a reset, and the classes of the world's numbers: see `invariants`.

    Raises:
        Untraceable: If a kernel cannot be traced; the message says why.
    """
    Graph.now = Graph()
    try:
        start, step = _traced_start(system, case), _traced_step(system, case)
        kinds = numbers_of_kinds(layout_of(system).world.example, "world.")
        goal = {f"goal.{name}": load(f"goal.{name}") for name in Pose._fields}
        kinds |= dict.fromkeys(goal, "f")
        of_world = {name: step[name] for name in kinds if name not in goal} | goal
        before = None if case.before is None else dict(case.before)
        classes = invariants.invariants(start | goal, of_world, kinds, before)
        Graph.now = Graph()
        stepped = _as_stored(rebuilt(step, invariants.assumed(classes, kinds)))
        Graph.now = Graph()
        reset = _as_stored(
            _traced_reset(system, case, start, {name: what for name, what in classes.items() if name not in goal})
        )
    except Untraceable:
        raise
    except Exception as error:
        raise Untraceable(f"{type(error).__name__}: {error}") from error
    return stepped, reset, classes


def places_of(classes: dict[str, Any], names: Iterable[str]) -> tuple[list[int], list[tuple[int, float]]]:
    """Return the place of each number of the world, and those of constants: one for all that are equal, after the others."""
    own = [name for name in names if classes[name] == name]
    order = {name: at for at, name in enumerate(own)}
    constants: dict[float, int] = {}
    places = []
    for name in names:
        what = classes[name]
        places.append(order[what] if isinstance(what, str) else constants.setdefault(float(what), len(order) + len(constants)))
    return places, [(place, value) for value, place in constants.items()]


def _text(system: System, case: Case) -> tuple[str, Any]:
    """Return the text of a case for LLVM, and its classes."""
    step, reset, classes = make_graphs(system, case)
    layout = layout_of(system)
    names = [f"world.{name}" for name in layout.world.names]
    places = dict(zip(names, places_of(classes, names)[0], strict=True))
    own = {f"p.{name}": at for at, name in enumerate(case.own)}
    runs, _ = runs_of(system.terms)
    columns = {at: run.column + at - run.start for run in runs for at in range(run.start, run.stop)}
    shown = {f"shown.{name}": columns[at] for at, name in enumerate(layout.observation.names)}
    rows = {f"outcome.{name}": at for at, name in enumerate(layout.outcome.names)}
    kept = [name for name in names if classes[name] == name]
    size = max(places.values()) + 1
    arguments: Any = places, kept, own, shown, rows, case.waypoints, size, sum(term.size for term in system.terms)
    texts = [step_text(step, *arguments), reset_text(reset, *arguments)]
    return "\n".join([text for text, _ in texts] + sorted(texts[0][1] | texts[1][1])), tuple(classes.items())


@cache
def _identity(system: System) -> str:
    """Return a hash of all kernels of a system, and of what traces them."""
    parts = system._replace(sensors=(), rewards=(), terms=(), example=None)
    kernels = [part for part in parts if callable(part)]
    kernels += [*sensing(system.sensors), rewarding(system.rewards)[0], observing(system.terms)]
    names = layout_of(system)
    kernels += [heart.step, heart.begin, heart.start_outcome, command_of, episode_key]
    return f"{sources_of(*_MAKERS)} {fingerprint(*kernels)} {[part.names for part in names]} {runs_of(system.terms)}"


@cache
def ground_of(system: System, case: Case) -> Ground:
    """Return the machine code of a case, from the cache if it is there.

    Raises:
        Untraceable: If a kernel cannot be traced; the message says why.
        ImportError: If llvmlite is missing.
    """
    with one_at_a_time:
        code = native.code_of("open ground", f"{_identity(system)} {case}", lambda: _text(system, case))
        step, reset = native.functions_of(code, "step", "reset")
    layout = layout_of(system)
    names = [f"world.{name}" for name in layout.world.names]
    places, constants = places_of(dict(code.notes), names)
    world = packing(layout.world.example, places)
    return Ground(world, tuple(constants), case.own, code.notes, step, reset)
