"""How kernels are compiled: as parts of loops, whose arrays are freed, and with the bits of plain Python."""

import gc
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import _nrt_python, rtsys

from turtlebot_gym.kernel import exactly, floor, kernel, load_compiler


class Mixed(NamedTuple):
    """Numbers, and an array among them."""

    numbers: tuple[float, float]
    array: Any


@kernel
def enlarged(mixed):
    larger = np.empty(len(mixed.array) + 1)
    larger[0] = mixed.numbers[0]
    for k in range(len(mixed.array)):
        larger[k + 1] = mixed.array[k]
    return Mixed(mixed.numbers, larger)


@kernel
def enlarged_twice(mixed):
    return enlarged(enlarged(mixed))


def total(first, array):
    mixed, result = enlarged_twice(Mixed((first, 0.0), array)), 0.0
    for k in range(len(mixed.array)):
        result += mixed.array[k]
    return result


def test_kernels_become_machine_code_only_as_parts_of_a_loop_that_frees_their_arrays(monkeypatch):
    made, make = [], JITCodeLibrary._finalize_specific
    monkeypatch.setattr(JITCodeLibrary, "_finalize_specific", lambda self: (made.append(self.name), make(self)))
    load_compiler()
    loop = njit(total)
    assert loop(2.0, np.ones(3)) == total(2.0, np.ones(3)) == 7.0
    assert [name for name in made if "enlarged" in name or "total" in name] == ["total"]
    gc.collect()
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(10):
        loop(2.0, np.ones(3))
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free >= 20


WHOLE = [0.0, 1.0, 2.0**31, 2.0**32 - 1.0, 2.0**52 - 1.0]
NUMBERS = [-0.0, 0.0, 0.5, -0.5, -1e-300, 1e15 + 0.5, -3.0, *np.random.default_rng(0).uniform(-1e6, 1e6, 100).tolist()]


@pytest.mark.parametrize(("function", "numbers"), [(floor, NUMBERS), (exactly, [int(n) for n in WHOLE])])
def test_numbers_are_converted_with_the_bits_of_plain_python(function, numbers):
    def convert(numbers, out):
        for k in range(len(numbers)):
            out[k] = function(numbers[k])

    compiled, plain = np.empty(len(numbers)), np.empty(len(numbers))
    load_compiler()
    njit(convert)(np.array(numbers), compiled)
    for k, number in enumerate(numbers):
        plain[k] = function(number)
    assert compiled.tobytes() == plain.tobytes()
    assert plain.tolist() == [math.floor(number) for number in numbers]
