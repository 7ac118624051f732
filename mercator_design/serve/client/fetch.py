"""Fetches the files of a job."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO
from urllib.parse import quote

from mercator_design.errors import excerpt
from mercator_design.results.files import JOURNAL
from mercator_design.serve.client.connection import ClientError, Connection
from mercator_design.system.files import sync_folder

_MAX_FILES = 10_000


def file_names(connection: Connection, job: str) -> list[str]:
    """Names of the files of a job's folder; journals are last, so that they are not older than the others.

    Raises:
        ClientError: There is no such job, or its files cannot be written here.
    """
    answer = connection.call("GET", f"/jobs/{quote(job, safe='')}/files")
    try:
        names = [str(one["name"]) for one in answer]
    except (TypeError, KeyError):
        raise ClientError(f"{connection.server}: expected a list of files, found something else") from None
    if len(names) > _MAX_FILES:
        raise ClientError(f"{connection.server}: expected at most {_MAX_FILES} files, found {len(names)}")
    for name in names:
        path = PurePosixPath(name)
        if path.is_absolute() or not path.parts or ".." in path.parts or "\0" in name or str(path) != name:
            raise ClientError(f"{connection.server}: expected the name of a file, found {excerpt(name)}")
    return sorted(names, key=lambda name: (PurePosixPath(name).name == JOURNAL, name))


def fetch_file(connection: Connection, job: str, name: str, to: BinaryIO) -> None:
    """Write a file of a job's run folder.

    Raises:
        ClientError: There is no such job or file, or the connection was lost.
        OSError: It cannot be written.
    """
    path = f"/jobs/{quote(job, safe='')}/files/{quote(name)}"
    with connection.stream("GET", path, headers={"Accept": "*/*"}) as answer:
        to.writelines(answer.iter_bytes())


def fetch_folder(connection: Connection, job: str, folder: Path) -> list[str]:
    """Fetch the whole run folder of a job to a new or empty folder: it is complete, or not there. Returns its files.

    Raises:
        ClientError: The folder has files, there is no such job, it has no files, or the connection was lost.
        OSError: The files cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ClientError(f"{folder}: expected a new or empty folder, found files in it")
    names = file_names(connection, job)
    if not names:
        raise ClientError(f"{job}: has no files yet: it has not begun")
    with _draft(folder) as draft:
        for name in names:
            path = draft / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("xb") as file:
                fetch_file(connection, job, name, file)
    return names


@contextmanager
def _draft(folder: Path) -> Iterator[Path]:
    """Temporary folder that gets its final name when it is complete."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{folder.name[:100]}-", dir=folder.parent))
    try:
        yield draft
        draft.chmod(0o755)
        draft.replace(folder)
        sync_folder(folder.parent)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise
