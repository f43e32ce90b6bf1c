"""Kernels with loops and arrays as machine code: the results of plain Python, to the bit."""

import re

import numpy as np
import pytest

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.program import compiled, text_of
from turtlebot_gym.compiled.values import Untraceable, form_of
from turtlebot_gym.kernel import HAS_LLVM, kernel, lanes
from turtlebot_gym.values import Pose

pytestmark = pytest.mark.skipif(not HAS_LLVM, reason="needs llvmlite")


@kernel
def first_above(numbers, least):
    for k in range(len(numbers)):
        if numbers[k] > least:
            return k, numbers[k]
    return -1, 0.0


@kernel
def swap(numbers, out):
    now, then = numbers.copy(), np.zeros(len(numbers))
    for _ in range(3):
        for k in range(len(now)):
            then[k] = now[k - 1] + 0.1 * now[(k + 1) % len(now)]
        now, then = then, now
    out[:] = now


def search(numbers, least):
    at, found = first_above(numbers, least)
    return Pose(float(at), found, 1.0 if found > 0.5 and at != 2 else -1.0)


def count(numbers, least):
    total, k = 0.0, 0
    while True:
        k += 1
        if k >= len(numbers):
            break
        if numbers[k] < least:
            continue
        total = total + 0.5 if k % 3 == 0 else total + k // 2 - (-k) // 3
    return total


def turned(numbers, least):
    swap(numbers.copy(), numbers)
    table = np.full((2, 3), least)
    table[1] = numbers[:3]
    rows, columns = table.T.shape
    return table.T[2, 1] + rows - columns, min(max(numbers[-1], least), 0.7)


@pytest.mark.parametrize("function", [search, count, turned])
@pytest.mark.parametrize("least", [-1.0, 0.3, 2.0])
def test_machine_code_gives_the_bits_of_plain_python(function, least):
    numbers = np.random.default_rng(0).random(9)
    own, others = numbers.copy(), numbers.copy()
    assert compiled(function, "a function in tests")(own, least) == function(others, least)
    np.testing.assert_array_equal(own, others)


@kernel
def ahead(x, v, dt):
    return x + v * dt


def move(xs, v, dt):
    for lane in lanes(len(xs)):
        xs[lane] = ahead(xs[lane], v, dt)


def test_one_kernel_from_python_to_machine_code():
    xs, fractions = np.random.default_rng(0).random((2, 37))
    wanted = [ahead(x, 0.3, fractions[0]) for x in xs.tolist()]
    text, _ = text_of(move, tuple(map(form_of, (xs, 0.3, fractions[0]))))
    assert re.search(r"(%\w+) = fmul double .*\n.*fadd double %\w+, \1\n", text)  # no flag lets LLVM fuse them
    width = next(numbers for has, numbers in (("+avx512f", 8), ("+avx,", 4), ("", 2)) if has in native.processor())
    assert f"fadd <{width} x double>" in str(native.optimized(text, 3, native.machine_here()))
    compiled(move, "a function in tests")(xs, 0.3, fractions[0])
    assert xs.tolist() == wanted


@kernel
def array_of(numbers):
    return numbers.copy()


@kernel
def summed(numbers):
    total = 0
    for k in range(len(numbers)):
        total += numbers[k]
    return total


@kernel
def after_a_loop(numbers):
    for k in range(len(numbers)):
        last = numbers[k]
    return last


REFUSED = {
    "holds a whole number, and then a float": lambda numbers: summed(numbers),
    "the syntax Dict": lambda numbers: {"least": numbers[0]},
    "the kernel 'array_of' returns an array: let it take one to write to": lambda numbers: array_of(numbers)[0],
    "the function 'sorted'": lambda numbers: sorted(numbers)[0],
    "holds a tuple, and then a float": lambda numbers: (1.0, 2.0) if numbers[0] > 0.0 else numbers[0],
    "the variable 'last', which has no value here": lambda numbers: after_a_loop(numbers),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_translated_is_named_with_its_place(what):
    with pytest.raises(Untraceable, match=rf"test_translate\.py, line \d+ of the kernel .*{what}.*; kernels use numbers"):
        compiled(REFUSED[what], "a function in tests")(np.zeros(2))
