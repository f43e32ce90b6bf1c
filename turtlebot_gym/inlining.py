"""How numba compiles what loops inline: once, as a part of the loop, and without the work that only other functions need.

By itself numba optimizes each function together with all that it calls, so a kernel again for each kernel and loop around it,
and makes machine code of each, which nobody calls. It also visits each number of a nested tuple to count references, whether
or not the tuple holds an array.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.runtime.context import NRTContext
from numba.core.typed_passes import NoPythonSupportedFeatureValidation


class _Part(JITCodeLibrary):
    """A function's code as a part of a loop's, which is optimized and becomes machine code as a whole."""

    @property
    def codegen(self) -> Any:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: only functions that Python calls have an environment."""

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    def _optimize_final_module(self) -> None:
        """Do nothing: the loop's is optimized."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _Counting(NRTContext):
    """Counts the references to arrays in a value."""

    counted: dict[Any, bool] = {}
    """Whether values of a type hold arrays."""

    def get_meminfos(self, builder: Any, ty: Any, val: Any) -> list[Any]:
        if ty not in self.counted:
            self.counted[ty] = self._context.data_model_manager[ty].contains_nrt_meminfo()
        return super().get_meminfos(builder, ty, val) if self.counted[ty] else []


@register_pass(mutates_CFG=False, analysis_only=True)
class _AsPart(FunctionPass):
    _name = "as_part_of_a_loop"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> Any:
        state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)
        context = state.targetctx  # a copy for this function
        context.nrt = _Counting(context, context.enable_nrt)
        return False


class Inlined(CompilerBase):
    """Pipeline of functions that compiled loops inline."""

    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_AsPart, NoPythonSupportedFeatureValidation)
        passes.finalize()
        return [passes]
