"""Calls of registered functions in missions: objectives and dynamics with their parameters, and files named there.

The contents of these files belong to the mission, like the pixels of a floor's image: they are read with the mission,
are part of its digest, and are copied to run folders and workers. A function receives the path of a copy, so its
contents are the same wherever and whenever it runs.
"""

import atexit
import contextlib
import hashlib
import inspect
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from mercator_design.config.building import is_name
from mercator_design.config.schema import FieldError, FilePath, Kind, mapped, parameters_of, values_in
from mercator_design.errors import described
from mercator_design.missions.plugins import ZoneReference
from mercator_design.plugins.places import first_line, line_of
from mercator_design.system.files import Unreadable, read_small, write_bytes
from mercator_design.system.interruptions import signals_first

_MAX_SIZE = 16 << 20
"""[bytes] of a file."""


class NamedFile(NamedTuple):
    """A file as it was read."""

    path: str
    data: bytes

    @property
    def digest(self) -> str:
        """The digest of its contents."""
        return hashlib.sha256(self.data).hexdigest()[:16]

    @property
    def copy(self) -> str:
        """The path of its copy in a run folder."""
        return f"files/{self.digest}/{Path(self.path).name}"


_lock = threading.Lock()
_folder: list[Path] = []  # the folder of copies, once it is made


def copied(file: NamedFile) -> str:
    """The path of a read-only copy that belongs to this process; it has the name of the file."""
    with _lock:
        if not _folder:
            _folder.append(Path(tempfile.mkdtemp(prefix="mercator_design-")))
            atexit.register(shutil.rmtree, _folder[0], ignore_errors=True)
        copy = _folder[0] / file.digest / Path(file.path).name
        if not copy.exists():
            copy.parent.mkdir(exist_ok=True)
            write_bytes(copy, file.data)
            copy.chmod(0o400)
        return str(copy)


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A function of a registry with its parameters.

    FUNCTIONS: The registry.
    KIND: What its functions are called in messages.

    Raises:
        FieldError: if there is no such function, it does not take the parameters, or a file of theirs cannot be read.
    """

    FUNCTIONS: ClassVar[Mapping[str, Callable[..., Any]]]
    KIND: ClassVar[str]

    name: str
    parameters: Mapping[str, Any]
    files: Mapping[str, NamedFile] = field(init=False, repr=False, compare=False)  # by the path in the parameters

    def __post_init__(self) -> None:
        if self.name not in self.FUNCTIONS:
            raise FieldError("name", f"expected one of {', '.join(self.FUNCTIONS)}, found '{self.name}'")
        try:
            inspect.signature(self.function).bind(None, **self.parameters)
        except TypeError as error:
            raise FieldError("parameters", f"of {self.name}: {error}") from None
        object.__setattr__(self, "files", self._read_files())

    def _read_files(self) -> dict[str, NamedFile]:
        found: dict[str, NamedFile] = {}
        for kind, value, place in self.values():
            if _is_file(kind, value) and value not in found:
                try:
                    found[value] = NamedFile(value, read_small(Path(value), _MAX_SIZE))
                except Unreadable as error:
                    raise FieldError(place, f"{error}: {value}") from None
        return found

    @property
    def function(self) -> Callable[..., Any]:
        return self.FUNCTIONS[self.name]

    def values(self) -> Iterator[tuple[Kind, Any, str]]:
        """All values in the parameters, defaults included, each with its annotation and its path."""
        for name, (kind, default) in parameters_of(self.function).items():
            yield from values_in(kind, self.parameters.get(name, default), name)

    def zones(self) -> Iterator[tuple[str, str]]:
        """The zones that parameters name, each with its path, as ("zones[0]", "nest")."""
        for kind, value, path in self.values():
            if any(isinstance(extra, ZoneReference) for extra in getattr(kind, "__metadata__", ())):
                yield path, value

    def with_paths(self, path: Callable[[NamedFile], str]) -> Mapping[str, Any]:
        """The parameters with other paths of the files that they or their defaults name."""
        if not self.files:
            return self.parameters

        def change(kind: Kind, value: object) -> object:
            return path(self.files[str(value)]) if _is_file(kind, value) else value

        known = parameters_of(self.function)
        return {
            name: mapped(kind, self.parameters.get(name, default), change) for name, (kind, default) in known.items()
        }

    @contextlib.contextmanager
    def reporting(self, error: Callable[[str], Exception], passed: type[Exception]) -> Iterator[None]:
        """Turn exceptions of a plugin's function, except those of class `passed`, into errors that name the line."""
        with signals_first():
            try:
                yield
            except passed:
                raise
            except BaseException as failure:  # also sys.exit()
                place = line_of(failure) or first_line(self.function)
                if not place:  # it is our fault: show the traceback
                    raise
                raise error(f"{place}{self.KIND} {self.name}: {described(failure)}") from failure


def _is_file(kind: Kind, value: object) -> bool:
    """Whether a value of a kind is the path of a file."""
    rules = [rule for rule in getattr(kind, "__metadata__", ()) if isinstance(rule, FilePath)]
    return isinstance(value, str) and any(not (rule.unless_name and is_name(value)) for rule in rules)
