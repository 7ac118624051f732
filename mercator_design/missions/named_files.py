"""Files that a mission names in parameters of its objective and dynamics.

Their contents belong to the mission, like the pixels of a floor's image: they are read with the mission, count in its
digest, and are copied to run folders and workers. A function gets the path of a copy, so its contents are the same
wherever and whenever it runs.
"""

import atexit
import hashlib
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mercator_design.config.building import is_name
from mercator_design.config.schema import FieldError, FilePath, Kind, mapped, parameters_of, values_in
from mercator_design.system.files import Unreadable, read_small, write_bytes

_LARGEST = 16 << 20  # bytes of a file


class NamedFile(NamedTuple):
    """A file as it was read."""

    path: str
    data: bytes

    @property
    def digest(self) -> str:
        """Of its contents."""
        return hashlib.sha256(self.data).hexdigest()[:16]

    @property
    def copy(self) -> str:
        """The path of its copy in a run folder."""
        return f"files/{self.digest}/{Path(self.path).name}"


def named_files(function: Callable[..., Any], parameters: Mapping[str, Any]) -> dict[str, NamedFile]:
    """The files that the parameters of a function name, by path.

    Raises:
        FieldError: naming one that cannot be read.
    """
    found: dict[str, NamedFile] = {}
    for name, (kind, default) in parameters_of(function).items():
        for each, value, place in values_in(kind, parameters.get(name, default), name):
            if _is_file(each, value) and value not in found:
                try:
                    found[value] = NamedFile(value, read_small(Path(value), _LARGEST))
                except Unreadable as error:
                    raise FieldError(place, f"{error}: {value}") from None
    return found


def with_paths(
    function: Callable[..., Any],
    parameters: Mapping[str, Any],
    files: Mapping[str, NamedFile],
    path: Callable[[NamedFile], str],
) -> Mapping[str, Any]:
    """The parameters of a function with other paths of the files that they name, also of those in its defaults."""
    if not files:
        return parameters
    known = parameters_of(function)
    given = {name: parameters.get(name, default) for name, (_, default) in known.items()}

    def change(kind: Kind, value: object) -> object:
        return path(files[str(value)]) if _is_file(kind, value) else value

    return {name: mapped(known[name][0], value, change) for name, value in given.items()}


def _is_file(kind: Kind, value: object) -> bool:
    """Whether a value of a kind is the path of a file."""
    rules = [rule for rule in getattr(kind, "__metadata__", ()) if isinstance(rule, FilePath)]
    return isinstance(value, str) and any(not (rule.unless_name and is_name(value)) for rule in rules)


_lock = threading.Lock()
_folder: list[Path] = []  # of copies, once there is one


def copied(file: NamedFile) -> str:
    """The path of a copy, of this process, that nobody else may change; its name is the file's."""
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
