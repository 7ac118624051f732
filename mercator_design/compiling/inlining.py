"""How numba compiles the functions that compiled code inlines.

Only compiled code calls them, and they become a part of it. numba would optimise each of them, with all that it calls,
and make machine code that nothing calls: a fourth of the time of compiling. Here it only keeps their code: the entry
function is optimised as a whole.
"""

import functools
from typing import Any, Self


@functools.cache
def options() -> Any:
    """The options of `numba.njit` for such a function."""
    return {
        # Kernels pass tuples of hundreds of numbers; a call that is not inlined copies them all.
        "forceinline": True,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": _pipeline(),
    }


def _pipeline() -> type:
    from numba.core import compiler
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler_machinery import AnalysisPass, register_pass
    from numba.core.typed_passes import AnnotateTypes

    class Inlined(JITCodeLibrary):  # type: ignore[misc]
        """The code of a function, to be linked into its callers."""

        @property
        def codegen(self) -> Self:
            return self  # numba calls its `set_env`; the engine's needs machine code

        def set_env(self, name: str, environment: object) -> None:
            """Set nothing: the environment is a variable of machine code."""

        def get_pointer_to_function(self, name: str) -> int:
            return 0  # there is none

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalized = True

    @register_pass(mutates_CFG=False, analysis_only=True)
    class KeepCode(AnalysisPass):  # type: ignore[misc]
        """Chooses where the code goes, before it is generated."""

        _name = "keep_code"

        def __init__(self) -> None:  # abstract in numba
            super().__init__()

        def run_pass(self, state: Any) -> bool:
            state.library = Inlined(state.targetctx.codegen(), state.func_id.func_qualname)
            return True

    class Pipeline(compiler.CompilerBase):  # type: ignore[misc]
        def define_pipelines(self) -> list[Any]:
            passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.add_pass_after(KeepCode, AnnotateTypes)
            passes.finalize()
            return [passes]

    return Pipeline
