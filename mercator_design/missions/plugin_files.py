"""The sources of a plugin: its file, and the modules of its folder that it imports.

All sources are read before any runs. From then on the plugin runs from these sources, in this process and in workers,
to which they are sent. So a file that was edited in the meantime is never run.
"""

import ast
import hashlib
import importlib.util
import itertools
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.abc import MetaPathFinder, SourceLoader
from importlib.machinery import ModuleSpec
from pathlib import Path, PurePosixPath

from mercator_design.errors import MissionError
from mercator_design.system.files import contents_of

_MAX_SIZE = 1024 * 1024  # [bytes] of a file
_INSTALLED = {"site-packages", "dist-packages"}  # folders of installed packages


@dataclass(frozen=True, slots=True, kw_only=True)
class Plugin:
    """The sources of a plugin."""

    file: Path  # where it was read; need not exist in other processes
    source: bytes
    modules: Mapping[str, bytes]  # its modules: path in its folder, as "parts/kernels.py", -> source

    @property
    def name(self) -> str:
        """The name of its file."""
        return self.file.name

    @property
    def digest(self) -> str:
        """The digest of all its sources, 16 hexadecimal digits."""
        digest = hashlib.sha256(self.source)
        for path, source in sorted(self.modules.items()):
            digest.update(f"\0{path}\0{hashlib.sha256(source).hexdigest()}".encode())
        return digest.hexdigest()[:16]

    @property
    def files(self) -> dict[str, bytes]:
        """All sources, by path in its folder."""
        return {self.name: self.source, **self.modules}

    @property
    def module_name(self) -> str:
        """The name by which it is imported."""
        return f"mercator_design_plugin_{re.sub(r'[^A-Za-z0-9]', '_', self.file.stem)}_{self.digest}"

    def names(self) -> dict[str, str]:
        """The names of the modules of its folder, with their paths there."""
        return {_module_name(path): path for path in self.modules}


def read_plugin(path: Path) -> Plugin:
    """The sources of a plugin; none of them is run.

    Raises:
        MissionError: if a file cannot be read.
    """
    source = contents_of(path, _MAX_SIZE, MissionError)
    file = path.resolve()
    modules: dict[str, bytes] = {}
    todo = [("", source)]  # packages, and sources of their modules
    while todo:
        package, text = todo.pop()
        for name in _imported(text, package):
            for module in _found(file.parent, name):
                if module not in modules:
                    place = file.parent / module
                    modules[module] = contents_of(place, _MAX_SIZE, MissionError) if place.exists() else b""
                    within = _module_name(module) if module.endswith("/__init__.py") else _module_name(module, up=True)
                    todo.append((within, modules[module]))
    return Plugin(file=file, source=source, modules=modules)


def _module_name(path: str, *, up: bool = False) -> str:
    """The name of a module in a folder, or of its package."""
    parts = PurePosixPath(path).with_suffix("").parts
    return ".".join(parts[:-1] if up or parts[-1] == "__init__" else parts)


def _imported(source: bytes, package: str) -> Iterator[str]:
    """The names that a source imports anywhere, which may be modules or parts of modules."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # reported when it is run
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{base}.{each.name}" for each in node.names)


def _found(folder: Path, name: str) -> Iterator[str]:
    """The paths in a folder of a module and of its packages, as far as they exist.

    A folder without an __init__.py is a package whose __init__.py is empty.
    """
    parts = [part for part in name.split(".") if part]
    if not parts or _is_elsewhere(parts[0]):
        return
    for path in itertools.accumulate(parts, "{}/{}".format):
        if not (folder / path).is_dir():
            if (folder / f"{path}.py").is_file():
                yield f"{path}.py"
            return
        yield f"{path}/__init__.py"


def _is_elsewhere(root: str) -> bool:
    """Whether a module belongs to the standard library, this package, or an installed one."""
    if root in sys.stdlib_module_names or root == __name__.partition(".")[0]:
        return True
    try:
        spec = importlib.util.find_spec(root)
    except (ImportError, ValueError, AttributeError):  # such as __main__
        return False
    places = [] if spec is None else [spec.origin or "", *(spec.submodule_search_locations or [])]
    return any(_INSTALLED & {*Path(place).parts} for place in places)


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
    for name, path in plugin.names().items():
        is_same = IMPORTER.sources.get(IMPORTER.paths.get(name, "")) == plugin.modules[path]
        if (name in IMPORTER.paths or name in sys.modules) and not is_same:
            there = f"a module of the name {name}"
            raise MissionError(f"{plugin.file}: imports {path} of its folder, but {there} is imported already")
    for name, path in plugin.names().items():
        _enter(name, str(plugin.file.parent / path), plugin.modules[path])
    _enter(plugin.module_name, str(plugin.file), plugin.source)


def _enter(name: str, path: str, source: bytes) -> None:
    if name not in IMPORTER.paths:
        IMPORTER.paths[name] = path
        IMPORTER.sources[path] = source
