"""How numba compiles the functions that compiled code inlines.

Only compiled code calls them, and they become a part of it. numba would optimise each of them, with all that it calls,
and make machine code that nothing calls: a fourth of the time of compiling. Here it only keeps their code: the entry
function is optimised as a whole.
"""

import functools
from collections.abc import Callable
from typing import Any, Self, cast


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
    from numba.core.targetconfig import ConfigStack
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
        def __init__(self, *arguments: Any) -> None:  # the last but one are the flags
            caller = ConfigStack.top_or_none()
            if caller is not None and caller.is_set("boundscheck"):
                arguments[-2].boundscheck = caller.boundscheck  # numba inherits other options, not this one
            super().__init__(*arguments)

        def define_pipelines(self) -> list[Any]:
            passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.add_pass_after(KeepCode, AnnotateTypes)
            passes.finalize()
            return [passes]

    return Pipeline


def register(function: Callable[..., Any]) -> None:
    """Let compiled code call a marked function."""
    from numba import njit
    from numba.extending import intrinsic, overload, register_jitable

    if types_and_code := getattr(function, "intrinsic", None):
        inner = intrinsic(types_and_code)

        def run(*arguments: Any) -> Any:
            return inner(*arguments)

        _name(run, "intrinsic", (function,))
        overload(function, jit_options=options(), strict=False)(lambda *arguments: run)
        return
    if by_type := getattr(function, "by_type", None):
        table, argument = by_type
        kernels = {kind: njit(**options())(kernel) for kind, kernel in table.items()}

        def chosen(*arguments: Any) -> Any:
            kernel = kernels[arguments[argument].instance_class]

            def run(*arguments: Any) -> Any:
                return kernel(*arguments)

            _name(run, "typed", (table[arguments[argument].instance_class],))
            return run

        overload(function, jit_options=options(), strict=False)(chosen)
        return
    links = getattr(function, "links", None)
    if links is None:
        register_jitable(**options())(function)
        return

    chain = chain_of(links)
    added = getattr(function, "added", None)
    if added is None:

        def dispatch(which: Any, *arguments: Any) -> Any:
            return chain(which, *arguments)

    else:
        n, call_added = len(links), added.table.call(added.like)

        def dispatch(which: Any, *arguments: Any) -> Any:
            if which < n:
                chain(which, *arguments)
            else:
                call_added(which - n, arguments)

    _name(dispatch, "dispatch", links)
    overload(function, jit_options=options(), strict=False)(lambda which, *arguments: dispatch)


def chain_of(functions: tuple[Callable[..., Any], ...]) -> Callable[..., Any]:
    """Compiled `if which == 0: ... else: ...` over functions, made of nested closures that numba inlines."""
    import numba

    head = functions[0]
    if len(functions) == 1:

        def link(which: int, *arguments: Any) -> Any:
            return head(*arguments)

    else:
        tail = chain_of(functions[1:])

        def link(which: int, *arguments: Any) -> Any:
            if which == 0:
                return head(*arguments)
            return tail(which - 1, *arguments)

    _name(link, "chain", functions)
    return cast("Callable[..., Any]", numba.njit(**options())(link))


def _name(closure: Callable[..., Any], role: str, functions: tuple[Callable[..., Any], ...]) -> None:
    """Name a closure by the functions that it calls.

    numba names machine code by the function's name and a number that counts within a process. Code from the cache has
    numbers of another process and is linked by these names, so two closures of one name could be confused.
    """
    closure.__qualname__ = closure.__name__ = f"{role}_{'_'.join(function.__name__ for function in functions)}"
