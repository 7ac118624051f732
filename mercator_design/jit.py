"""Compiles functions; with the files of compiling/ the only one that uses numba.

A kernel is a plain Python function in a small subset of the language (floats, tuples, rows of numbers, `math`), marked
`@jittable`. The mark does not change the function: Python, and the robot, call it as it is. `compiled` makes the fast
form of one entry function, in which every call of a marked function is compiled too. So there is one definition of each
behaviour, and control software runs without numba.

Compiled code is cached in folders named by digests of its sources (compiling/kernel_sources.py).
"""

import contextlib
import functools
import importlib
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

from mercator_design.compiling import cache, inlining, kernel_sources, linking
from mercator_design.compiling.advice import advised, reason_of

R = TypeVar("R")
F = TypeVar("F", bound=Callable[..., Any])

_waiting: list[Callable[..., Any]] = []
_marked: set[Callable[..., Any]] = set()
_compiled: dict[Callable[..., Any], Callable[..., Any]] = {}
_lock = threading.RLock()
_listeners: list[Callable[[], None]] = []


def jittable(function: F) -> F:
    """Mark a function as callable from compiled code, and return it unchanged."""
    _marked.add(function)
    _waiting.append(function)
    return function


def is_marked(function: Callable[..., Any]) -> bool:
    """Whether compiled code may call a function."""
    return function in _marked


def marked() -> frozenset[Callable[..., Any]]:
    """The functions marked `@jittable` so far."""
    return frozenset(_marked)


def forget(functions: Iterable[Callable[..., Any]]) -> None:
    """Remove the marks of functions."""
    _marked.difference_update(functions)
    _waiting[:] = [function for function in _waiting if function in _marked]


def dispatcher(functions: Iterable[Callable[..., R]]) -> Callable[..., R]:
    """A kernel `call(which, *arguments)` that calls function number `which`."""
    table = tuple(functions)

    def call(which: int, *arguments: Any) -> R:
        return table[which](*arguments)

    call.links = table  # type: ignore[attr-defined]  # the functions in the compiled form
    return jittable(call)


def type_dispatcher(functions: Mapping[type, Callable[..., R]], argument: int) -> Callable[..., R]:
    """A kernel `call(*arguments)` that calls the function for the type of one argument, a named tuple.

    Args:
        functions: The functions by type.
        argument: The number of the argument.
    """
    table = dict(functions)

    def call(*arguments: Any) -> R:
        return table[type(arguments[argument])](*arguments)

    call.links = tuple(table.values())  # type: ignore[attr-defined]
    call.by_type = table, argument  # type: ignore[attr-defined]
    return jittable(call)


def open_dispatcher(name: str, functions: list[Callable[..., None]], like: Sequence[Any]) -> Callable[..., None]:
    """As `dispatcher`; functions may be added to the list at any time.

    These are compiled apart, and not a part of the code that calls them.

    Args:
        name: The name of the dispatcher, which no other has.
        functions: The functions.
        like: Arguments of the types with which compiled code calls the added ones; arrays, or memory views instead,
            may have any layout.
    """
    links = tuple(functions)

    def call(which: int, *arguments: Any) -> None:
        functions[which](*arguments)

    call.links = links  # type: ignore[attr-defined]
    call.added = _Added(name, functions, len(links), like)  # type: ignore[attr-defined]
    return jittable(call)


class _Added:
    """The functions that were added to those of an open dispatcher."""

    def __init__(self, name: str, functions: list[Callable[..., None]], first: int, like: Sequence[Any]) -> None:
        self._name = name
        self._functions, self._first, self._like = functions, first, like
        self._linked: list[Callable[..., None]] | None = None  # None until the table is made
        self._made: dict[Callable[..., None], tuple[_Entry, int]] = {}  # with addresses, asked for once
        self._failed: dict[Callable[..., None], CompilationError] = {}
        self._linking = threading.Lock()  # not _lock, for which a thread that compiles waits

    @functools.cached_property
    def like(self) -> tuple[Any, ...]:
        """Arguments of the types with which compiled code calls them."""
        import numpy as np

        return tuple(np.asarray(one) if isinstance(one, memoryview) else one for one in self._like)

    @functools.cached_property
    def table(self) -> linking.LinkTable:
        """Their addresses. Only while _lock is held."""
        return linking.LinkTable(f"mercator_design_{self._name}")

    def link(self) -> None:
        """Compile those that are not compiled yet, and enter their addresses; needed before code that may call them."""
        if self._functions[self._first :] == self._linked:
            return
        with self._linking:
            added = self._functions[self._first :]
            addresses = [self._address(function) for function in added]
            with _lock:
                table = self.table
            table.fill(addresses)
            self._linked = added

    def explain(self, error: IndexError) -> None:
        """Raise CompilationError if a function that could not be compiled may have been called."""
        if error.args == (linking.NOT_LINKED,):
            failed = {each: self._failed[each] for each in self._functions[self._first :] if each in self._failed}
            if failed:
                first = next(iter(failed.values()))
                raise CompilationError(str(first), first.places, failed) from None

    def _address(self, function: Callable[..., None]) -> int:
        """Its address; 0 if it cannot be compiled: so it disturbs only those who call it."""
        if function in self._failed:
            return 0
        if function not in self._made:
            with _lock:
                entry = _Entry(function, checked=True)
            try:
                self._made[function] = entry, entry.address(self.like)
            except CompilationError as error:
                self._failed[function] = error
                return 0
        return self._made[function][1]


@functools.cache
def c_call(*arguments: str, result: str = "nothing") -> Callable[[int, tuple[float, ...]], int]:
    """As `linking.c_call`."""
    return jittable(linking.c_call(*arguments, result=result))


@functools.cache
def memory_access() -> tuple[Callable[[int], float], Callable[[int, float], None]]:
    """As `linking.memory_access`."""
    load, store = linking.memory_access()
    return jittable(load), jittable(store)


def jit_wanted() -> bool:
    """Whether compiled code is used: NUMBA_DISABLE_JIT=1 selects plain Python."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in {"", "0"}


class CompilationError(Exception):
    """A kernel cannot be compiled; `places` are files and lines of calls, the last one in this kernel.

    If it is not known which kernel was called, `others` has the errors of all that cannot be compiled.
    """

    def __init__(
        self,
        reason: str,
        places: Sequence[tuple[str, int]] = (),
        others: "Mapping[Callable[..., None], CompilationError] | None" = None,
    ) -> None:
        super().__init__(reason)
        self.places, self.others = places, others or {}


def compiled(function: F) -> F:
    """The compiled form of an entry function, which runs without holding the GIL.

    The first call compiles it, and raises CompilationError if this is not possible.
    """
    if not jit_wanted():
        return function
    if function not in _compiled:
        with _lock:
            if function not in _compiled:
                _compiled[function] = _compile(function)
    return cast("F", _compiled[function])


def _compile(function: Callable[..., Any]) -> Callable[..., Any]:
    entry = _Entry(function)
    added = [kernel.added for kernel in kernel_sources.reached(function, _marked) if hasattr(kernel, "added")]

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        for each in added:
            each.link()
        try:
            return entry(*arguments)
        except IndexError as error:
            for each in added:
                each.explain(error)
            raise

    return call


class _Entry:
    """An entry function, which is compiled at its first call for arguments of some types."""

    def __init__(self, function: Callable[..., Any], *, checked: bool = False) -> None:
        """With `checked`, an index out of range and a division by zero are errors, as in Python."""
        import numba

        _load_array_functions()
        # Kernels make no arrays, they only fill those of their caller. So reference counts are not needed, and counting
        # the references to all passed arrays would take two thirds of the time.
        options: dict[str, Any] = {"nogil": True, "_nrt": False, "error_model": "python" if checked else "numpy"}
        if checked:
            options["boundscheck"] = True
        part = kernel_sources.foreign_part(function, _marked)
        self._function = kernel_sources.renamed(function, part) if part else function
        self._entry: Any = numba.njit(**options)(self._function)
        self._cache = cache.cache_of(self._function, cache_folder(), part, _missed)
        self._entry._cache = self._cache  # noqa: SLF001 - no other way
        self._errors = (numba.core.errors.NumbaError, numba.core.errors.UnsupportedBytecodeError)

    def __call__(self, *arguments: Any) -> Any:
        return self._tried(self._entry, *arguments)

    def address(self, like: Sequence[Any]) -> int:
        """The address of the code for arguments of these types; valid as long as this object exists.

        Raises:
            CompilationError: also if it returns something.
        """
        import numba

        types = tuple(linking.any_layout(numba.typeof(one)) for one in like)
        self._tried(self._entry.compile, types)
        made = self._entry.overloads[types]
        if made.signature.return_type != numba.types.none:
            raise CompilationError(f"it returns {made.signature.return_type}; it must return nothing", self._places)
        return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))

    @property
    def _places(self) -> list[tuple[str, int]]:
        return [(self._function.__code__.co_filename, self._function.__code__.co_firstlineno)]

    def _tried(self, use: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return use(*arguments)
        except BaseException as error:
            self._cache.turn.close()
            if not isinstance(error, self._errors):
                raise
            found = re.findall(r'File "([^"\n]+)", line (\d+)|(?:at|from) (\S+\.py) \((\d+)\)', str(error))
            places = [(file or other, int(line or number)) for file, line, other, number in found]
            raise CompilationError(advised(reason_of(str(error))), places or self._places) from error


@functools.cache
def _load_array_functions() -> None:
    """Load numba's functions of arrays without scipy.linalg.

    numba would import scipy.linalg, which is slow, only to find out whether it is there. Those of its functions that
    need scipy.linalg import it when they are compiled.
    """
    from numba.np import linalg

    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ensure_blas


@contextlib.contextmanager
def announced(announce: Callable[[], None]) -> Iterator[None]:
    """In this context, call `announce` once before something is compiled that is not in the cache."""
    waiting = [announce]

    def once() -> None:
        with contextlib.suppress(IndexError):  # it was called
            waiting.pop()()

    _listeners.append(once)
    try:
        yield
    finally:
        _listeners.remove(once)


def _missed() -> None:
    """Announce that something is compiled, and let compiled code call all functions marked so far."""
    for listener in [*_listeners]:
        listener()
    with _lock:
        while _waiting:
            inlining.register(_waiting.pop(0))


def compiling(what: str) -> str:
    """A message that something is compiled, with the reason if that is for this run only."""
    fate = f" for this run only: {problem}" if (problem := cache_warning()) else "; later runs find it in the cache"
    return f"Compiling {what}{fate} ..."


def cache_folder() -> Path | None:
    """The folder of compiled code: one for each version of the kernels, or one of this process; or None."""
    return _cache().folder


def cache_warning() -> str:
    """Why compiled code is lost when this process ends, and what to do; empty if it is kept."""
    return _cache().problem if jit_wanted() else ""


@functools.cache
def _cache() -> cache.Place:
    return cache.place(kernel_sources.digest(kernel_sources.package_files(), ())[:16])


def kernels_digest() -> str:
    """A digest of all sources of compiled code, as hexadecimal text."""
    return kernel_sources.digest(kernel_sources.package_files(), _foreign())


def _foreign() -> list[Callable[..., Any]]:
    """The marked functions outside this package."""
    return [function for function in _marked if kernel_sources.is_foreign(function)]
