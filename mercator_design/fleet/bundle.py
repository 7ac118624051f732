"""mercator-robot as one file that only needs Python: a zip application."""

import ast
import functools
import io
import marshal
import zipfile
from collections.abc import Iterator
from importlib import metadata
from importlib.util import MAGIC_NUMBER, source_hash
from pathlib import Path

from mercator_design.config import shipped
from mercator_design.errors import RobotError
from mercator_design.robot.cli import VERBS

_PACKAGE = Path(__file__).parents[1]
_ENTRY = f"{_PACKAGE.name}.robot.cli"
NEEDED_PACKAGES = ("click", "PyYAML", "pyserial")
_MAIN = f"""\
import sys

if sys.version_info < (3, 11):
    sys.exit("Error: mercator-robot needs Python 3.11 or later, this is " + sys.version.split()[0])

from {_ENTRY} import main

main()
"""


def bundle() -> bytes:
    """A zip application with the modules and flavours for the robot, the packages that they need, and licences.

    Beside the sources there is byte code. With it, this version of Python starts in less than half of the time; others
    ignore it. The same sources and version give the same bytes anywhere: names are sorted, there are no dates, and
    nothing is compressed, because versions of zlib differ.

    Raises:
        RobotError: if the files of an installed package are unknown.
    """
    files = {"__main__.py": _MAIN.encode()}
    files |= {str(path.relative_to(_PACKAGE.parent)): path.read_bytes() for path in _modules()}
    files |= {
        f"{_PACKAGE.name}/scenarios/flavours/{name}.yaml": file.read_bytes()
        for name, file in shipped.flavours().items()
    }
    packaged = _PACKAGE / "LICENSE"
    licence = packaged if packaged.is_file() else _PACKAGE.parent / "LICENSE"  # beside the package in a clone
    files["licences/mercator-design.txt"] = licence.read_bytes()
    files["licences/pyserial.txt"] = (_PACKAGE / "fleet/LICENSE-pyserial.txt").read_bytes()  # its wheel has none
    for name in NEEDED_PACKAGES:
        files |= _taken_from(name)
    files |= {f"{place}c": _byte_code(place, data) for place, data in files.items() if place.endswith(".py")}
    archive = io.BytesIO()
    archive.write(b"#!/usr/bin/env python3\n")
    with zipfile.ZipFile(archive, "w") as writer:
        for place, data in sorted(files.items()):
            entry = zipfile.ZipInfo(place)
            entry.external_attr = 0o644 << 16
            writer.writestr(entry, data)
    return archive.getvalue()


def _byte_code(place: str, source: bytes) -> bytes:
    """A module as Python keeps it compiled, valid whatever the date of its source (PEP 552)."""
    code = compile(source, place, "exec", dont_inherit=True, optimize=0)
    unchecked = (1).to_bytes(4, "little")
    # Later versions of marshal write references, which depend on what else this process has in memory.
    return MAGIC_NUMBER + unchecked + source_hash(source) + marshal.dumps(code, 2)


def is_bundle(path: Path) -> bool:
    """Whether a file is a zip application, as `bundle` makes it."""
    with path.open("rb") as file:
        return file.read(2) == b"#!" and zipfile.is_zipfile(file)


@functools.cache
def _modules() -> set[Path]:
    """The files of this package that the robot's command imports, at start or later."""
    found: set[Path] = set()
    waiting = [_ENTRY, *(verb.module for verb in VERBS.values() if verb.is_light)]
    while waiting:
        name = waiting.pop()
        folder = _PACKAGE.parent.joinpath(*name.split("."))
        for path in (folder / "__init__.py", folder.with_suffix(".py")):
            if path.is_file() and path not in found:
                found.add(path)
                names = (name.rpartition(".")[0], *_imports(path))
                waiting += [each for each in names if each.partition(".")[0] == _PACKAGE.name]
    return found


def _imports(path: Path) -> Iterator[str]:
    """Names of imported modules, and of names in them that may be modules."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _taken_from(distribution: str) -> dict[str, bytes]:
    """The Python modules of a distribution, without extension modules, which depend on the machine; and its licence."""
    try:
        files = metadata.files(distribution)
    except metadata.PackageNotFoundError:
        files = None
    if not files:
        raise RobotError(f"{distribution}: its files are not known; install it with pip")
    taken = {}
    for file in files:
        if file.suffix == ".py" and file.parts[0] != "..":  # scripts are outside
            taken[file.as_posix()] = file.read_binary()
        elif file.name.upper().startswith(("LICENSE", "LICENCE", "COPYING")):
            taken[f"licences/{distribution}.txt"] = file.read_binary()
    return taken
