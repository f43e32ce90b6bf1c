"""Machine code of LLVM's intermediate language, by llvmlite, for this processor: made once, and kept in files."""

from __future__ import annotations

import ctypes
import hashlib
import pickle
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.compiled import store


class Code(NamedTuple):
    """Machine code, and what its makers keep beside it."""

    machine_code: bytes
    notes: Any


@cache
def _machine() -> Any:
    """Return LLVM's description of this processor.

    Raises:
        ImportError: If llvmlite is missing.
    """
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=2, jit=True)


def code_of(name: str, identity: str, make: Callable[[], tuple[str, Any]], *, optimized: bool = False) -> Code:
    """Return machine code from its file, or make it.

    Args:
        name: What it does, for the notice on a terminal and the name of its file.
        identity: Everything that it is made of, except for processor and compiler.
        make: ``make()`` returns the text for LLVM, and what to keep beside the machine code.
        optimized: Whether LLVM has to optimize it: functions, variables in memory and loops.
    """
    import llvmlite
    from llvmlite import binding as llvm

    machine = _machine()
    features = llvm.get_host_cpu_features().flatten()
    key = f"{identity} {llvmlite.__version__} {machine.triple} {llvm.get_host_cpu_name()} {features}"

    def compile_now() -> bytes:
        text, notes = make()
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        if optimized:
            _optimize(module, machine)
        return pickle.dumps(Code(machine.emit_object(module), notes))

    return store.kept(name, hashlib.sha256(key.encode()).hexdigest(), pickle.loads, compile_now)


def _optimize(module: Any, machine: Any) -> None:
    from llvmlite import binding as llvm

    llvm.set_option("", "-memory-check-merge-threshold=4000")
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


_engines: list[Any] = []
"""What holds the machine code in memory."""


def functions_of(code: Code, *names: str) -> list[Callable[[int], None]]:
    """Return functions of machine code that take the address of their arguments; Python's other threads go on meanwhile."""
    from llvmlite import binding as llvm

    empty = llvm.parse_assembly("")
    empty.triple = _machine().triple
    engine = llvm.create_mcjit_compiler(empty, _machine_for_engine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code.machine_code))
    engine.finalize_object()
    _engines.append(engine)
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    return [kind(engine.get_function_address(name)) for name in names]


def _machine_for_engine() -> Any:
    from llvmlite import binding as llvm

    return llvm.Target.from_default_triple().create_target_machine(jit=True)
