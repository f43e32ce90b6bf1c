"""How kernels are compiled: as parts of loops, whose arrays are freed."""

import gc
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import _nrt_python, rtsys

from turtlebot_gym.kernel import kernel


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
