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

NUMBERS = ("reward", "distance")
"""Rows of the numbers of a step."""
FLAGS = ("is_success", "terminated", "truncated", "ended")
"""Rows of the truths of a step; the last is that the episode was terminated or truncated."""
EXACT = {"fuse_fp": False, "fast_math": False, "enable_backward": False}
"""Options of Warp that keep the bits of each operation."""
_ROWS = """
auto row = [=](long long number) { return number * environments; };
auto at = [=](long long number) { return row(number) + environment; };
"""
_SUCCESS, _TERMINATED, _TRUNCATED, _ENDED = (f"flag[row({at})]" for at in range(len(FLAGS)))
_DISTANCE = f"number[row({NUMBERS.index('distance')})]"


class Kernels(NamedTuple):
    """Kernels of a case; their last arguments are observations (c, N, K), numbers (c, 2, N) and flags (c, 4, N) to write."""

    step: Any
    """Takes the number of environments, the memory, a mask (N,), whether episodes begin at once, and actions (N, 2).

    If so, the next episode begins where one has ended, and c is 2: the results of now, and the last of the episode. Otherwise
    it begins where the mask is true.
    """
    reset: Any
    """Takes the number of environments, the memory, a mask (N,) of what to write, and whether episodes begin there."""
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

    @property
    def arrays(self) -> str:
        """The statement that finds where to write results."""
        return (
            f"float *shown = observations.data + {self.width}LL * environment;\n"
            "double *number = numbers.data + environment; bool *flag = flags.data + environment;"
        )

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
            return f"shown[{self.columns[rest]}]"
        if part == "outcome":
            places = {"number": NUMBERS, "flag": FLAGS}
            return "".join(f"{array}[row({names.index(rest)})]" for array, names in places.items() if rest in names)
        if part == "world":
            return f"memory.state.data[at({self.world[name]})]" if name in self.world else ""
        return "memory.keys.data[environment]" if part == "key" else f"memory.waypoints.data[at({Pose._fields.index(rest)})]"

    def block(self, numbers: Mapping[str, Any]) -> str:
        """Return a block of statements: all numbers, and what keeps those that change."""
        kept = {
            self.target(name): value
            for name, value in numbers.items()
            if self.target(name) and not (isinstance(value, Node) and is_load(value, name))
        }
        stores = [f"{target} = {value_of(value)};" for target, value in kept.items()]
        ended = f"{_ENDED} = {_TERMINATED} || {_TRUNCATED};"
        return "\n".join(["{", *text_of(list(kept.values()), self.load), *stores, ended, "}"])

    def step(self, advance: str, begin: str) -> str:
        """Return the text of the kernel of a step, from the blocks of a step and of a reset."""
        return f"""
{HELPERS} {_ROWS} {self.arrays}
const long long last = at_once;
shown += last * row({self.width}); number += last * row({len(NUMBERS)}); flag += last * row({len(FLAGS)});
if (!isfinite(actions.data[2LL * environment]) || !isfinite(actions.data[2LL * environment + 1]))
    memory.wrong.data[0] = environment + 1;
{advance}
const bool begins = at_once ? {_ENDED} : mask.data[environment];
const double distance = {_DISTANCE};
const bool success = {_SUCCESS};
const float *seen = shown;
if (at_once && !begins) {{ {_DISTANCE} = 0.0; {_SUCCESS} = false; }}
shown -= last * row({self.width}); number -= last * row({len(NUMBERS)}); flag -= last * row({len(FLAGS)});
if (begins) {{
    memory.episodes.data[environment] += 1;
    {begin}
}} else if (at_once) {{
    for (int column = 0; column < {self.width}; column++) shown[column] = seen[column];
    {_DISTANCE} = distance; {_SUCCESS} = success;
}}"""

    def reset(self, begin: str) -> str:
        """Return the text of the kernel of a reset, from its block."""
        return f"if (!mask.data[environment]) return;\n{HELPERS} {_ROWS} {self.arrays}\n{begin}"


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
        begin = places.block(reset)
        return places.step(places.block(step), begin), places.reset(begin), len(world)


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
        mask: wp.array[wp.bool],
        at_once: bool,
        actions: wp.array2d[wp.float32],
        observations: wp.array3d[wp.float32],
        numbers: wp.array3d[wp.float64],
        flags: wp.array3d[wp.bool],
    ): ...

    @wp.func_native(on_reset)
    def begin(
        environment: int,
        environments: int,
        memory: Memory,
        mask: wp.array[wp.bool],
        begins: bool,
        observations: wp.array3d[wp.float32],
        numbers: wp.array3d[wp.float64],
        flags: wp.array3d[wp.bool],
    ): ...

    @wp.kernel(name="turtlebot_gym_step", module="unique", module_options=EXACT)
    def step(
        environments: int,
        memory: Memory,
        mask: wp.array[wp.bool],
        at_once: bool,
        actions: wp.array2d[wp.float32],
        observations: wp.array3d[wp.float32],
        numbers: wp.array3d[wp.float64],
        flags: wp.array3d[wp.bool],
    ):
        advance(wp.tid(), environments, memory, mask, at_once, actions, observations, numbers, flags)

    @wp.kernel(name="turtlebot_gym_reset", module="unique", module_options=EXACT)
    def reset(
        environments: int,
        memory: Memory,
        mask: wp.array[wp.bool],
        begins: bool,
        observations: wp.array3d[wp.float32],
        numbers: wp.array3d[wp.float64],
        flags: wp.array3d[wp.bool],
    ):
        begin(wp.tid(), environments, memory, mask, begins, observations, numbers, flags)

    return Kernels(step, reset, Memory, size)
