"""Runs plugins, at most one of each name in a process; one that fails leaves nothing behind.

Nothing is run that was not asked for. Names are unique in a process: files, texts and missions refer to what plugins
define by name alone.
"""

import contextlib
import importlib
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mercator_design import jit
from mercator_design.errors import MissionError, described
from mercator_design.plugins import registries
from mercator_design.plugins.importing import IMPORTER, offer
from mercator_design.plugins.registries import REGISTRIES, defined, is_ours
from mercator_design.plugins.sources import Plugin, read_plugin
from mercator_design.system.interruptions import signals_first

_loaded: dict[str, Plugin] = {}  # by name
_loading = threading.RLock()
_refusal: list[str] = []  # why no more are run; empty while they are


def loaded_plugins() -> dict[str, str]:
    """The names and digests of the plugins loaded so far."""
    return {plugin.name: plugin.digest for plugin in _loaded.values()}


def plugins() -> tuple[Plugin, ...]:
    """The plugins loaded so far, in the order of loading."""
    return tuple(_loaded.values())


def plugin_of(function: Callable[..., Any]) -> Plugin | None:
    """The plugin that has defined a function; None for one of this package, or of no plugin."""
    name = registries.module_of(function)
    return next((plugin for plugin in _loaded.values() if name in plugin.modules), None)


def load_plugin(name_or_path: str | Path, digest: str | None = None) -> None:
    """Run a plugin; a second time, or a copy of it, does nothing.

    Args:
        name_or_path: A Python file, to which the modules of its folder belong that it imports; the folder of a package;
            or the name of a plugin of an installed package.
        digest: The digest that the plugin must have; otherwise it is not run.

    Raises:
        MissionError: if it cannot be read or run, has another digest, or defines nothing or a name that is taken.
    """
    plugin = read_plugin(name_or_path)
    if digest not in {None, plugin.digest}:
        raise MissionError(
            f"{name_or_path}: expected a plugin of digest {digest}, found {plugin.digest}; it was not run; put it back "
            "as it was"
        )
    run_plugin(plugin, str(name_or_path))


def run_plugin(plugin: Plugin, label: str = "") -> None:
    """As `load_plugin`, from sources that were read, here or in another process; errors name `label`, or its file."""
    label = label or str(plugin.file)
    with _loading:
        namesake = _loaded.get(plugin.name)
        if namesake is not None and namesake.digest == plugin.digest:
            return
        if _refusal:
            raise MissionError(f"{plugin.name}: {_refusal[0]}")
        if namesake is not None:
            another = f"another plugin of that name (digest {namesake.digest}, not {plugin.digest}) is loaded already"
            raise MissionError(f"{label}: {another}; start this process anew, or give the plugin another name")
        others = {path: source for other in _loaded.values() for path, source in other.files.items()}
        for path, source in plugin.files.items():
            if others.get(path, source) != source:  # a run folder has one file of a name
                raise MissionError(f"{label}: its file {path} differs from that of another plugin with the same name")
        with contextlib.ExitStack() as undo:
            undo.callback(snapshot())
            before = registries.entered()
            offer(plugin)
            _run(plugin, label)
            _enter_files(plugin)
            if before == registries.entered():
                *some, last = [registry.what for registry in REGISTRIES]
                raise MissionError(f"{label}: a plugin that defines nothing; expected {', '.join(some)} or {last}")
            undo.pop_all()
        _loaded[plugin.name] = plugin


def refuse_more(why: str) -> None:
    """Run no more plugins in this process: from now on, those not loaded yet raise a MissionError with this reason."""
    _refusal[:] = [why]


def snapshot() -> Callable[[], None]:
    """A function that restores the present state of everything that plugins define."""
    restore_entries = registries.snapshot()
    tables: list[dict[Any, Any]] = [_loaded, IMPORTER.paths, IMPORTER.sources]
    entries, modules = [{**each} for each in tables], {*sys.modules}
    marked, functions = jit.marked(), registries.functions()

    def restore() -> None:
        added = {*(jit.marked() - marked), *(registries.functions() - functions)}
        foreign = [each for each in added if not is_ours(defined(each))]
        jit.forget(foreign)
        own = [*IMPORTER.paths]
        restore_entries()
        for table, entry in zip(tables, entries, strict=True):
            table.clear()
            table.update(entry)
        registries.forget_modules(map(defined, foreign), modules, own)

    return restore


def _run(plugin: Plugin, label: str) -> None:
    """Run a plugin's file as a module; a MissionError reports what it raises."""
    own, folder = str(plugin.file.parent / plugin.modules[plugin.module_name]), plugin.file.parent
    labels = {str(folder / path): str(folder / path) for path in plugin.files}
    labels[own] = f"{label}/{Path(own).name}" if plugin.is_package else label
    with signals_first():
        try:
            importlib.import_module(plugin.module_name)
        except BaseException as error:  # noqa: BLE001 - whatever it raises, also by sys.exit()
            frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in labels]
            file, line = (frames[-1].filename, frames[-1].lineno) if frames else (own, None)
            if isinstance(error, SyntaxError) and error.filename in labels:
                file, line = error.filename, error.lineno
            place = f"{labels[file]}:{line}" if line else labels[file]
            raise MissionError(f"{place}: a plugin that cannot be run: {described(error)}") from None


def _enter_files(plugin: Plugin) -> None:
    """Enter the flavours in a package's folder."""
    for path, data in plugin.flavours.items():
        for registry in REGISTRIES:
            if registry.enter_file is not None:
                registry.enter_file(data, str(plugin.file.parent / path))
