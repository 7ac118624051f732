"""The tables in which plugins enter what they define; each is registered where it is made."""

import importlib
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_ROOMS = {
    "mercator_design.modules.flavour": "",
    "mercator_design.missions.objectives": "numpy",
    "mercator_design.missions.dynamics": "numpy",
}
"""Modules that make the tables and enter what this package ships, with a package that robots may lack."""


@dataclass(frozen=True, kw_only=True)
class Registry:
    """A table that plugins may add to."""

    what: str  # an entry, as "an @objective"
    table: dict[str, Any]  # the entries by name
    others: tuple[dict[Any, Any] | list[Any], ...] = ()  # tables that go with it
    functions: Callable[[], Iterable[Callable[..., Any]]] = tuple  # those that are entries
    enter_file: Callable[[bytes, str], object] | None = None  # enters a file of a package's folder `flavours`


REGISTRIES: list[Registry] = []


_caches: list[Any] = []


def by_entries(cached: F) -> F:
    """Clear the cache of a function, whose results depend on entries, when entries are taken out again."""
    _caches.append(cached)
    return cached


def register(registry: Registry) -> None:
    """Let plugins add to a table."""
    REGISTRIES.append(registry)


def load_shipped() -> None:
    """Enter what this package ships: their names are taken, and their kernels come first."""
    for room, package in _ROOMS.items():
        try:
            importlib.import_module(room)
        except ModuleNotFoundError as error:  # a robot has no missions
            if not package or error.name not in {package, *_parts(room)}:
                raise


def _parts(module: str) -> list[str]:
    names = module.split(".")
    return [".".join(names[: n + 1]) for n in range(1, len(names))]


def is_ours(function: Callable[..., Any]) -> bool:
    """Whether a function is of this package, not of a plugin."""
    return module_of(function).startswith("mercator_design.")


def defined(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The function for whose call a kernel was made; otherwise the kernel itself."""
    return getattr(kernel, "calls", kernel)


def module_of(function: Callable[..., Any]) -> str:
    """The name of a function's module; empty for a function from a text without a name."""
    return function.__module__ or ""


def entered() -> list[str]:
    """The entries of all tables."""
    return [f"{registry.what} {name}" for registry in REGISTRIES for name in registry.table]


def functions() -> set[Callable[..., Any]]:
    """The functions in all tables."""
    return {function for registry in REGISTRIES for function in registry.functions()}


def snapshot() -> Callable[[], None]:
    """A function that restores the present entries of all tables."""
    load_shipped()
    tables = [table for registry in REGISTRIES for table in (registry.table, *registry.others)]
    before = [table.copy() for table in tables]

    def restore() -> None:
        if tables == before:
            return
        for table, entries in zip(tables, before, strict=True):
            table.clear()
            if isinstance(table, list):
                table.extend(entries)
            else:
                table.update(entries)
        for cached in _caches:
            cached.cache_clear()

    return restore


def forget_modules(functions: Iterable[Callable[..., Any]], before: set[str], own: Iterable[str]) -> None:
    """Let modules be imported again that were imported after `before`: those of these functions, and these names.

    A module that stays imported would not define its functions again.
    """
    packages, names = {module_of(each).partition(".")[0] for each in functions}, {*own}
    for name in {*sys.modules} - before:
        if name.partition(".")[0] in packages or name in names:
            del sys.modules[name]
