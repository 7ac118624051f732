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
from pathlib import Path
from typing import NamedTuple

from mercator_design.system.files import write_bytes

MAX_SIZE = 16 << 20
"""[bytes] of a file."""


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
