"""Machine code of LLVM's intermediate language, by llvmlite, for this processor: made once, and kept in files."""

from __future__ import annotations

import ctypes
import hashlib
import pickle
import sys
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


def has(feature: str) -> bool:
    """Return whether this processor has a feature, such as "avx512dq"."""
    return _features().get(feature, False)


@cache
def _features() -> Any:
    from llvmlite import binding as llvm

    return llvm.get_host_cpu_features()


def code_of(name: str, identity: str, make: Callable[[], tuple[str, Any]], level: int) -> Code:
    """Return machine code from its file, or make it.

    Args:
        name: What it does, for the notice on a terminal and the name of its file.
        identity: Everything that it is made of, except for processor and compiler.
        make: ``make()`` returns the text for LLVM, and what to keep beside the machine code.
        level: How much LLVM has to optimize it, from 1 to 3.
    """

    def compile_now() -> bytes:
        text, notes = make()
        return pickle.dumps(Code(machine_code(text, level), notes))

    return kept(name, identity, pickle.loads, compile_now)


def machine_code(text: str, level: int) -> bytes:
    """Return the machine code of LLVM's text for this processor."""
    return _machine().emit_object(_optimized(text, level, _machine()))


def ptx(text: str) -> str:
    """Return the PTX of LLVM's text, for NVIDIA's GPUs from 2018 on."""
    from llvmlite import binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple("nvptx64-nvidia-cuda").create_target_machine(cpu="sm_75", opt=3)
    return machine.emit_assembly(_optimized(text, 2, machine))


def kept(name: str, identity: str, load: Callable[[bytes], Any], make: Callable[[], bytes]) -> Any:
    """Return what a file of the cache holds, see `store.kept`; ``identity`` says all but the versions and the processor."""
    import llvmlite
    from llvmlite import binding as llvm

    machine = f"{_machine().triple} {llvm.get_host_cpu_name()} {_features().flatten()}"
    key = f"{identity} {sys.version} {llvmlite.__version__} {machine}"
    return store.kept(name, hashlib.sha256(key.encode()).hexdigest(), load, make)


def simplified(text: str) -> str:
    """Return a text for LLVM with what follows from its constants worked out."""
    return str(_optimized(text, 1, _machine()))


def _optimized(text: str, level: int, machine: Any) -> Any:
    """Return an optimized module: from level 2 on loops become vectors, from 3 on neighbouring instructions, too."""
    from llvmlite import binding as llvm

    if level < 3:  # all in one function, which is sooner done than hundreds that grow together
        text = text.replace(") #0 {", ") alwaysinline #0 {")
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    llvm.set_option("", "-memory-check-merge-threshold=4000")
    options = llvm.create_pipeline_tuning_options(speed_level=level)
    options.loop_vectorization, options.slp_vectorization = level > 1, level > 2
    builder = llvm.create_pass_builder(machine, options)
    early = llvm.create_new_module_pass_manager()
    for name in ("always_inliner", "global_dead_code_eliminate", "sroa", "sccp", "simplify_cfg", "aggressive_dce"):
        getattr(early, f"add_{name}_pass")()
    early.run(module, builder)
    builder.getModulePassManager().run(module, builder)
    return module


_engines: list[Any] = []
"""What holds the machine code in memory."""


def functions_of(machine_code: bytes, *names: str) -> list[Callable[[int], None]]:
    """Return functions of machine code that take the address of their arguments; Python's other threads go on meanwhile."""
    from llvmlite import binding as llvm

    empty = llvm.parse_assembly("")
    empty.triple = _machine().triple
    engine = llvm.create_mcjit_compiler(empty, _machine_for_engine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(machine_code))
    engine.finalize_object()
    _engines.append(engine)
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    return [kind(engine.get_function_address(name)) for name in names]


def _machine_for_engine() -> Any:
    from llvmlite import binding as llvm

    return llvm.Target.from_default_triple().create_target_machine(jit=True)
