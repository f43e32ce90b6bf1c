"""Machine code of LLVM's text, by llvmlite: for this processor, and for NVIDIA's GPUs."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any


@cache
def machine_here() -> Any:
    """Return LLVM's description of this processor."""
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target, features = llvm.Target.from_default_triple(), llvm.get_host_cpu_features().flatten()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=2, jit=True)


def processor() -> str:
    """Return what tells this processor from others."""
    from llvmlite import binding as llvm

    return f"{machine_here().triple} {llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"


def machine_code(text: str, level: int) -> bytes:
    """Return the machine code for this processor."""
    return machine_here().emit_object(optimized(text, level, machine_here()))


def ptx_of(text: str) -> str:
    """Return the assembly for NVIDIA's GPUs from 2018 on."""
    from llvmlite import binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple("nvptx64-nvidia-cuda").create_target_machine(cpu="sm_75", opt=3)
    return machine.emit_assembly(optimized(text, 2, machine))


def optimized(text: str, level: int, machine: Any) -> Any:
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


def entry_of(code: bytes) -> Callable[[int], None]:
    """Return the function "entry" of machine code, of an address; while it runs, other threads of Python go on."""
    from llvmlite import binding as llvm

    empty = llvm.parse_assembly("")
    empty.triple = machine_here().triple
    engine = llvm.create_mcjit_compiler(empty, llvm.Target.from_default_triple().create_target_machine(jit=True))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return ctypes.CFUNCTYPE(None, ctypes.c_void_p)(engine.get_function_address("entry"))
