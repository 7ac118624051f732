"""Routes on the files of jobs."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, BinaryIO

from fastapi import APIRouter
from fastapi import Path as InPath
from fastapi.responses import StreamingResponse

from mercator_design.results.files import JOURNAL
from mercator_design.serve.http.context import TheService, VisibleJob
from mercator_design.serve.http.problems import RESPONSES, Missing
from mercator_design.serve.http.schemas import File
from mercator_design.serve.jobs.races import end_of

router = APIRouter(prefix="/api/v1", tags=["files"], responses=RESPONSES)

_PAGE_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; frame-ancestors 'self'"
)
"""Content policy of the pages in run folders: their scripts run without the rights of the service's pages."""
_KINDS = {".html": "text/html; charset=utf-8", ".png": "image/png", ".pdf": "application/pdf"}
_CHUNK = 256 * 1024  # bytes that are sent at a time


@router.get("/jobs/{id}/files")
def files(service: TheService, row: VisibleJob) -> list[File]:
    """List the files of a job's folder, with those in folders in it."""
    found = []
    for name, path in sorted(files_of(service.store.run_folder(row.id)).items()):
        with contextlib.suppress(FileNotFoundError):  # just removed
            found.append(File(name=name, bytes=path.stat().st_size))
    return found


@router.get("/jobs/{id}/files/{name:path}", response_class=StreamingResponse)
def file(service: TheService, row: VisibleJob, name: Annotated[str, InPath(max_length=400)]) -> StreamingResponse:
    """Fetch a file of a job's folder: fsm.txt, report.html, results.csv, journal.jsonl, ..."""
    try:
        path = _file_of(service.store.run_folder(row.id), name)
        opened = path.open("rb")
    except FileNotFoundError:
        raise Missing(f"{row.id} has no file {name}") from None
    # A journal grows while it is sent, and other files are replaced: what is sent is as long as the answer says.
    length = end_of(opened) if path.name == JOURNAL else os.fstat(opened.fileno()).st_size
    headers = {
        "Content-Length": str(length),
        "Content-Security-Policy": _PAGE_POLICY,
        "X-Content-Type-Options": "nosniff",
    }
    if path.suffix == ".pdf":  # browsers show none in a sandbox
        headers["Content-Disposition"] = "attachment"
    kind = _KINDS.get(path.suffix, "text/plain; charset=utf-8")
    return StreamingResponse(_first_bytes(opened, length), headers=headers, media_type=kind)


def _first_bytes(file: BinaryIO, length: int) -> Iterator[bytes]:
    """First bytes of a file; closes it."""
    with file:
        file.seek(0)
        while length > 0 and (data := file.read(min(_CHUNK, length))):
            length -= len(data)
            yield data


def _file_of(folder: Path, name: str) -> Path:
    """One of `files_of`, without a look at the others: a study has thousands.

    Raises:
        FileNotFoundError: There is none of this name.
    """
    path = folder
    for part in name.split("/"):
        path /= part
        if not part or not _is_shown(part) or os.path.islink(path):  # noqa: PTH114 - which raises for names that cannot be
            raise FileNotFoundError(name)
    if not os.path.isfile(path):  # noqa: PTH113 - the same
        raise FileNotFoundError(name)
    return path


def files_of(folder: Path) -> dict[str, Path]:
    """The regular files of a run folder by their names.

    Left out are links, so no other file is reached, and names that are not UTF-8, which no address can have.
    """
    found = {}
    for place, folders, names in os.walk(folder):
        folders[:] = filter(_is_shown, folders)
        for name in filter(_is_shown, names):
            path = Path(place) / name
            if path.is_file() and not path.is_symlink():
                found[path.relative_to(folder).as_posix()] = path
    return found


def _is_shown(name: str) -> bool:
    return not name.startswith(".") and os.fsencode(name).decode(errors="ignore") == name
