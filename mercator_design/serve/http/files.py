"""Routes on the files of jobs."""

import os
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from mercator_design.serve.http.context import TheService, VisibleJob
from mercator_design.serve.http.problems import RESPONSES, Missing
from mercator_design.serve.http.schemas import File

router = APIRouter(prefix="/api/v1", tags=["files"], responses=RESPONSES)  # type: ignore[arg-type]

_PAGE_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; frame-ancestors 'self'"
)
"""Pages of a run folder have scripts of their own: they run without the rights of our pages."""


@router.get("/jobs/{id}/files")
def files(service: TheService, row: VisibleJob) -> list[File]:
    """List the files of a job's run folder."""
    folder = service.store.run_folder(row.id)
    return [File(name=name, bytes=path.stat().st_size) for name, path in sorted(files_of(folder).items())]


@router.get("/jobs/{id}/files/{name:path}", response_class=FileResponse)
def file(service: TheService, row: VisibleJob, name: Annotated[str, InPath(max_length=400)]) -> FileResponse:
    """Fetch a file of a job's run folder: fsm.txt, report.html, results.csv, journal.jsonl, ..."""
    path = files_of(service.store.run_folder(row.id)).get(name)
    if path is None:
        raise Missing(f"{row.id} has no file {name}")
    headers = {"Content-Security-Policy": _PAGE_POLICY, "X-Content-Type-Options": "nosniff"}
    if path.suffix not in {".html", ".png"}:
        return FileResponse(path, headers=headers, media_type="text/plain; charset=utf-8")
    return FileResponse(path, headers=headers)


def files_of(folder: Path) -> dict[str, Path]:
    """The regular files of a run folder by their names; links are left out, so no other file is reached."""
    found = {}
    for place, folders, names in os.walk(folder):
        folders[:] = [one for one in folders if not one.startswith(".")]
        for name in names:
            path = Path(place) / name
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                found[path.relative_to(folder).as_posix()] = path
    return found
