"""The step and the reset of open ground as two kernels of NVIDIA Warp, for a GPU or this processor: a thread per environment.

The graphs are those of `ground`. A number of all environments is a row of the state.
"""

# A struct of Warp is a value to pyright, and no type.
# pyright: reportGeneralTypeIssues=false

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.compiled.cpp import HELPERS, text_of, value_of
from turtlebot_gym.compiled.graph import Node
from turtlebot_gym.compiled.ground import Case, make_graphs, one_at_a_time
from turtlebot_gym.compiled.memory import is_load
from turtlebot_gym.compiled.packing import layout_of
from turtlebot_gym.observations import runs_of, size_of
from turtlebot_gym.systems import System
from turtlebot_gym.values import Pose

OUTCOMES = ("reward", "distance", "is_success", "terminated", "truncated")
"""Rows of the outcomes of a step."""
EXACT = {"fuse_fp": False, "fast_math": False, "enable_backward": False}
"""Options of Warp that keep the bits of each operation."""
_AT = "auto at = [=](long long row) { return row * environments + environment; };"


class Kernels(NamedTuple):
    """Kernels of a case."""

    step: Any
    """Takes the number of environments, the memory, actions (N, 2), observations (N, K) and outcomes (m, N)."""
    reset: Any
    """Takes the number of environments, the memory, a mask (N,), whether episodes begin, observations and outcomes."""
    memory: Any
    """A struct of arrays that stay: state, keys, waypoints, seeds, episodes, and the number of an environment, from 1, whose
    action was not finite."""
    size: int
    """Rows of the state."""


class _Places(NamedTuple):
    """Where numbers stand in memory."""

    world: Mapping[str, int]
    """Rows of the state."""
    columns: Mapping[str, int]
    """Of an observation."""
    width: int
    """Columns of an observation."""
    waypoints: int
    """Number of waypoints."""

    def load(self, node: Node) -> str:
        """Return the expression of a number in memory."""
        if node.op == "gather":
            index = f"(unsigned long long){value_of(node.args[0])}"
            row = f"({index} < {self.waypoints}ULL ? {index} : {self.waypoints - 1}ULL)"
            return f"memory.waypoints.data[at(3 * {row} + {node.args[1]})]"
        part, _, rest = node.args[0].partition(".")
        if part == "action":
            return f"(double)actions.data[2LL * environment + {rest}]"
        if part == "goal":
            return f"memory.waypoints.data[at({Pose._fields.index(rest)})]"
        if part == "world":
            return f"memory.state.data[at({self.world[node.args[0]]})]" + " != 0.0" * (node.kind == "b")
        return part if part == "begins" else f"memory.{part}s.data[environment]"  # keys, seeds, episodes

    def target(self, name: str) -> str:
        """Return where a number is kept, an empty text if nowhere."""
        part, _, rest = name.partition(".")
        if part == "shown":
            return f"observations.data[{self.width}LL * environment + {self.columns[rest]}]"
        if part == "outcome":
            return f"outcomes.data[at({OUTCOMES.index(rest)})]" if rest in OUTCOMES else ""
        if part == "world":
            return f"memory.state.data[at({self.world[name]})]" if name in self.world else ""
        return "memory.keys.data[environment]" if part == "key" else f"memory.waypoints.data[at({Pose._fields.index(rest)})]"

    def program(self, first: str, numbers: Mapping[str, Any]) -> str:
        """Return the text of a kernel: a statement, all numbers, and the statements that keep those that change."""
        kept = {
            self.target(name): value
            for name, value in numbers.items()
            if self.target(name) and not (isinstance(value, Node) and is_load(value, name))
        }
        stores = [f"{target} = {value_of(value)};" for target, value in kept.items()]
        return "\n".join([HELPERS, _AT, first, *text_of(list(kept.values()), self.load), *stores])


def texts_of(system: System, case: Case) -> tuple[str, str, int]:
    """Return the C++ of a step and of a reset, and the size of the state of an environment.

    Raises:
        Untraceable: If a kernel cannot be traced; the message says why.
    """
    with one_at_a_time:
        step, reset, classes = make_graphs(system, case)
        world = [name for name in classes if classes[name] == name and name.startswith("world.")]
        runs, _ = runs_of(system.terms)
        columns = [run.column + at - run.start for run in runs for at in range(run.start, run.stop)]
        shown = dict(zip(layout_of(system).observation.names, columns, strict=True))
        places = _Places({name: at for at, name in enumerate(world)}, shown, size_of(system.terms), case.waypoints)
        finite = "if (!isfinite(actions.data[2LL * environment]) || !isfinite(actions.data[2LL * environment + 1]))"
        return (
            places.program(f"{finite} memory.wrong.data[0] = environment + 1;", step),
            places.program("if (!mask.data[environment]) return;", reset),
            len(world),
        )


@cache
def kernels_of(system: System, case: Case) -> Kernels:
    """Return the kernels of a case, which Warp compiles at their first launch on a device, or finds in its cache.

    Raises:
        Untraceable: If a kernel cannot be traced; the message says why.
    """
    import warp as wp

    on_step, on_reset, size = texts_of(system, case)

    @wp.struct
    class Memory:
        state: wp.array[wp.float64]
        keys: wp.array[wp.int64]
        waypoints: wp.array[wp.float64]
        seeds: wp.array[wp.int64]
        episodes: wp.array[wp.int64]
        wrong: wp.array[wp.int32]

    @wp.func_native(on_step)
    def advance(
        environment: int,
        environments: int,
        memory: Memory,
        actions: wp.array2d[wp.float32],
        observations: wp.array2d[wp.float32],
        outcomes: wp.array2d[wp.float64],
    ): ...

    @wp.func_native(on_reset)
    def begin(
        environment: int,
        environments: int,
        memory: Memory,
        mask: wp.array[wp.bool],
        begins: bool,
        observations: wp.array2d[wp.float32],
        outcomes: wp.array2d[wp.float64],
    ): ...

    @wp.kernel(name="turtlebot_gym_step", module="unique", module_options=EXACT)
    def step(
        environments: int,
        memory: Memory,
        actions: wp.array2d[wp.float32],
        observations: wp.array2d[wp.float32],
        outcomes: wp.array2d[wp.float64],
    ):
        advance(wp.tid(), environments, memory, actions, observations, outcomes)

    @wp.kernel(name="turtlebot_gym_reset", module="unique", module_options=EXACT)
    def reset(
        environments: int,
        memory: Memory,
        mask: wp.array[wp.bool],
        begins: bool,
        observations: wp.array2d[wp.float32],
        outcomes: wp.array2d[wp.float64],
    ):
        begin(wp.tid(), environments, memory, mask, begins, observations, outcomes)

    return Kernels(step, reset, Memory, size)
