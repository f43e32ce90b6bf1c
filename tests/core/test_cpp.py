"""Graphs as C++ have the bits of Python, and the compiler for GPUs keeps them: it fuses no products with sums."""

import math

import numpy as np
import pytest
from graphs import computed

from turtlebot_gym.compiled import cpp, device, graph
from turtlebot_gym.compiled.graph import Graph, load
from turtlebot_gym.compiled.ground import Case
from turtlebot_gym.compiled.packing import as_tuple, flatten, layout_of
from turtlebot_gym.systems import Options, find_system

wp = pytest.importorskip("warp", reason="NVIDIA Warp is not installed: pip install '.[gpu]'")


def fused(tmp_path, options):
    """Return how many fused operations the default system's step has on a GPU, compiled with some options of Warp."""
    setup = Options().setup()
    system = find_system(setup.system, setup.parameters)
    names = layout_of(system).parameters.names
    case = Case(tuple(zip(names, flatten(as_tuple(setup.parameters)), strict=True)), (), len(setup.waypoints))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(device, "EXACT", device.EXACT | options)
        kernels = device.kernels_of.__wrapped__(system, case)
    files = wp.compile_aot_module(kernels.step.module, arch=90, module_dir=tmp_path, use_ptx=True)
    text = b"".join(file.read_bytes() for file in files if file.suffix == ".ptx")
    assert b"mul.rn.f64" in text or b"fma.rn.f64" in text
    return text.count(b"fma.rn.f64")


def test_the_compiler_for_gpus_fuses_nothing(tmp_path):
    assert fused(tmp_path / "exact", {}) == 0
    assert fused(tmp_path / "fused", {"fuse_fp": True}) > 50


@pytest.mark.nightly
def test_each_operation_has_the_bits_of_python():
    numbers = np.array([[-7.25, 3.0], [7.25, -0.0], [1e300, 0.7], [5.0, 2.5], [-0.5, 1e-310]])
    wholes = np.array([[-7, 3], [2**62 + 12345, 2**62 + 999], [-(2**63), 5], [40, 2], [0, 1]])
    Graph.now = Graph()
    x, y, i, j = load("x"), load("y"), load("i", "i"), load("j", "i")
    make = graph.make
    reals = [x + y, x - y, x * y, x / (y + 9.0), -x, x % 0.3, x < y, x <= y, x == 3.0, x != 3.0, abs(x), make("floor", x)]
    parts = [make(op, abs(x)) for op in ("sqrt", "mantissa", "exponent")]
    integers = [i + j, i - j, i * 0x3C79AC492BA7B653, -i, i % 7, i & -16, i | j, i ^ j, i >> 27, i < j, i == j]
    truths = [make("not", x < y), (x < y) & (i < j), (x < y) | (i < j), (x < y) ^ (i < j)]
    converted = [make("tofloat", i), make("toint", y), make("tofloat", x < y)]
    chosen = [make("sel", x < y, math.inf, x), make("sel", i < j, -(2**63), i)]
    values = [*reals, *parts, *integers, *truths, *converted, *chosen]
    is_real = [graph.kind_of(value) == "f" for value in values]
    loads = {"x": "numbers.data[2 * row]", "y": "numbers.data[2 * row + 1]", "i": "wholes.data[2 * row]"}
    lines = cpp.text_of(values, lambda node: loads.get(node.args[0], "wholes.data[2 * row + 1]"))
    for at, value in enumerate(values):
        lines.append(f"{'reals' if is_real[at] else 'others'}.data[{len(values)} * row + {at}] = {cpp.value_of(value)};")

    @wp.func_native("\n".join([cpp.HELPERS, *lines]))
    def program(
        row: int,
        numbers: wp.array2d[wp.float64],
        wholes: wp.array2d[wp.int64],
        reals: wp.array2d[wp.float64],
        others: wp.array2d[wp.int64],
    ): ...

    @wp.kernel(module="unique", module_options={"fuse_fp": False, "enable_backward": False})
    def run(
        numbers: wp.array2d[wp.float64],
        wholes: wp.array2d[wp.int64],
        reals: wp.array2d[wp.float64],
        others: wp.array2d[wp.int64],
    ):
        program(wp.tid(), numbers, wholes, reals, others)

    shape = len(numbers), len(values)
    found, others = wp.zeros(shape, dtype=wp.float64, device="cpu"), wp.zeros(shape, dtype=wp.int64, device="cpu")
    given = wp.array(numbers, dtype=wp.float64, device="cpu"), wp.array(wholes, dtype=wp.int64, device="cpu")
    wp.launch(run, len(numbers), inputs=[*given, found, others], device="cpu")
    for row, ((a, b), (m, n)) in enumerate(zip(numbers.tolist(), wholes.tolist(), strict=True)):
        for at, want in enumerate(computed(values, x=a, y=b, i=m, j=n)):
            got = (found if is_real[at] else others).numpy()[row, at]
            assert got == want, (values[at].op, row)
            assert not is_real[at] or math.copysign(1.0, got) == math.copysign(1.0, want), (values[at].op, row)
