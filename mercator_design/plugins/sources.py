"""The sources of a plugin: a file and the modules of its folder that it imports, or all files of a package.

All sources are read before any runs. From then on the plugin runs from these sources, in this process and in workers,
to which they are sent. So a file that was edited in the meantime is never run.
"""

import ast
import hashlib
import importlib.util
import itertools
import keyword
import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path, PurePosixPath

from mercator_design.config import spelling
from mercator_design.errors import MissionError, excerpt
from mercator_design.system.files import contents_of

ENTRY_POINTS = "mercator_design.plugins"
"""The group of entry points by which installed packages offer plugins."""
_MAX_SIZE = 1024 * 1024  # [bytes] of a file
_MAX_FILES = 500  # of a package
_INSTALLED = {"site-packages", "dist-packages"}  # folders of installed packages
_INIT = "__init__.py"


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """The sources of a plugin."""

    file: Path  # a file, or the folder of a package, where it was read; need not exist in other processes
    files: Mapping[str, bytes]  # all its files: path in the folder in which it lies, as "parts/kernels.py" -> contents

    @property
    def name(self) -> str:
        """The name of its file or folder."""
        return self.file.name

    @property
    def is_package(self) -> bool:
        """Whether it is a folder."""
        return self.name not in self.files

    @cached_property
    def digest(self) -> str:
        """The digest of all its files, 16 hexadecimal digits."""
        digest = hashlib.sha256(self.files.get(self.name, b""))
        for path, source in sorted(self.files.items()):
            if path != self.name:
                digest.update(f"\0{path}\0{hashlib.sha256(source).hexdigest()}".encode())
        return digest.hexdigest()[:16]

    @property
    def module_name(self) -> str:
        """The name by which it is imported: of a file one of its own, as files of any name may be plugins."""
        if self.is_package:
            return self.name
        return f"mercator_design_plugin_{re.sub(r'[^A-Za-z0-9]', '_', self.file.stem)}_{self.digest}"

    @cached_property
    def modules(self) -> dict[str, str]:
        """The names of its modules, with their paths."""
        names = {_module_name(path): path for path in self.files if path.endswith(".py") and path != self.name}
        return names if self.is_package else {**names, self.module_name: self.name}

    @property
    def flavours(self) -> dict[str, bytes]:
        """The flavour files of a package: those in its folder `flavours`."""
        within = PurePosixPath(self.name, "flavours")
        return {path: data for path, data in self.files.items() if PurePosixPath(path).match(f"{within}/*.yaml")}


def read_plugin(name_or_path: str | Path) -> Plugin:
    """The sources of a plugin, none of which is run: of a file, a folder, or an installed package by its name.

    Raises:
        MissionError: There is none, or a file cannot be read.
    """
    path = Path(name_or_path)
    text = str(name_or_path)
    if not (text.endswith(".py") or is_plugin(path)) and re.fullmatch(r"[\w.-]*\w", text):
        path = _installed(text, is_folder=_is_folder(path))
    return _read_package(path) if _is_folder(path) else _read_file(path)


def _is_folder(path: Path) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 - which raises for names that cannot be


def is_plugin(path: Path) -> bool:
    """Whether there is a file or the folder of a package; the names of files that cannot be are those of none."""
    return os.path.isfile(path) or os.path.isfile(path / _INIT)  # noqa: PTH113 - which raises for such names


def _installed(name: str, *, is_folder: bool) -> Path:
    """The file or folder of the installed plugin of a name; it is not imported."""
    known = {point.name: point for point in metadata.entry_points(group=ENTRY_POINTS)}
    if name not in known:
        if is_folder:
            raise MissionError(f"{name}: expected a folder with {_INIT}, found none in it")
        near = spelling.nearest(name, known)
        there = f"installed are: {', '.join(sorted(known))}" if known else "no installed package has plugins"
        raise MissionError(
            f"{excerpt(name)}: no such file, and no such plugin of an installed package; "
            + (f"did you mean '{near}'?" if near else there)
        )
    module = known[name].value
    place = f"{name}: the entry point of the group {ENTRY_POINTS}: "
    if not module.isidentifier():
        raise MissionError(f"{place}expected the name of a package or module at the top level, found {excerpt(module)}")
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise MissionError(f"{place}module {module} cannot be found: {error}") from None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        raise MissionError(f"{place}expected a module of Python sources, found none of the name {module}")
    return Path(spec.origin).parent if spec.submodule_search_locations else Path(spec.origin)


def _read_package(path: Path) -> Plugin:
    folder = path.resolve()
    if not folder.name.isidentifier() or keyword.iskeyword(folder.name):
        raise MissionError(f"{path}: expected a folder with the name of a package, found {excerpt(folder.name)}")
    if not (folder / _INIT).is_file():
        raise MissionError(f"{path}: expected a folder with {_INIT}, found none in it")
    try:
        found = [*itertools.islice(_files_of(folder), _MAX_FILES + 1)]
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(found) > _MAX_FILES:
        raise MissionError(f"{path}: expected a package of at most {_MAX_FILES} files, found more")
    files = {one.relative_to(folder.parent).as_posix(): contents_of(one, _MAX_SIZE, MissionError) for one in found}
    return Plugin(file=folder, files=files)


def _files_of(folder: Path) -> Iterator[Path]:
    """The modules and flavour files in a folder and those below it."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == "__pycache__":
            continue
        if path.is_dir():
            if path.is_symlink():  # it may lead to a folder above
                raise MissionError(f"{path}: expected a folder, found a link")
            yield from _files_of(path)
        elif path.suffix == ".py" or (path.suffix == ".yaml" and path.parent.name == "flavours"):
            yield path


def _read_file(path: Path) -> Plugin:
    """A file, with the modules of its folder that it imports."""
    source = contents_of(path, _MAX_SIZE, MissionError)
    file = path.resolve()
    files = {file.name: source}
    todo = [("", source)]  # packages, and sources of their modules
    while todo:
        package, text = todo.pop()
        for name in _imported(text, package):
            for module in _found(file.parent, name):
                if module not in files:
                    place = file.parent / module
                    files[module] = contents_of(place, _MAX_SIZE, MissionError) if place.exists() else b""
                    within = _module_name(module) if module.endswith(f"/{_INIT}") else _module_name(module, up=True)
                    todo.append((within, files[module]))
    return Plugin(file=file, files=files)


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
        yield f"{path}/{_INIT}"


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
