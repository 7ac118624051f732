"""Imports the modules of plugins from the sources that were read."""

import importlib.util
import sys
from importlib.abc import MetaPathFinder, SourceLoader
from importlib.machinery import ModuleSpec

from mercator_design.errors import MissionError
from mercator_design.plugins.sources import Plugin


class _Importer(MetaPathFinder, SourceLoader):  # type: ignore[misc]  # typeshed says so of SourceLoader itself
    """Imports modules from the sources that were read."""

    def __init__(self) -> None:
        self.paths: dict[str, str] = {}  # paths of modules by name
        self.sources: dict[str, bytes] = {}  # by path

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:  # noqa: ARG002
        return importlib.util.spec_from_loader(fullname, self) if fullname in self.paths else None

    def get_filename(self, fullname: str) -> str:
        if fullname not in self.paths:
            raise ImportError(fullname)
        return self.paths[fullname]

    def get_data(self, path: str | bytes) -> bytes:
        if str(path) not in self.sources:
            raise FileNotFoundError(path)
        return self.sources[str(path)]


IMPORTER = _Importer()


def offer(plugin: Plugin) -> None:
    """Make the modules of a plugin importable from the sources that were read.

    Raises:
        MissionError: if another module has the name of one of them.
    """
    if IMPORTER not in sys.meta_path:
        sys.meta_path.insert(0, IMPORTER)
    folder = plugin.file.parent
    for name, path in plugin.modules.items():
        is_same = IMPORTER.sources.get(IMPORTER.paths.get(name, "")) == plugin.files[path]
        if (name in IMPORTER.paths or name in sys.modules) and not is_same:
            there = f"a module of the name {name} is imported already"
            what = "is a package" if plugin.is_package else f"imports {path} of its folder"
            raise MissionError(f"{plugin.file}: {what}, but {there}")
    for name, path in plugin.modules.items():
        if name not in IMPORTER.paths:
            IMPORTER.paths[name] = str(folder / path)
            IMPORTER.sources[str(folder / path)] = plugin.files[path]
