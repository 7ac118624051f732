"""Routes on jobs."""

from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from mercator_design.serve.http.context import OwnJob, TheService, TheUser, VisibleJob
from mercator_design.serve.http.problems import RESPONSES
from mercator_design.serve.http.schemas import (
    JobAnswer,
    JobChange,
    JobPage,
    JobRequest,
    Order,
    StudyToSubmit,
    Submitted,
)
from mercator_design.serve.jobs.job import State, StudyRequest
from mercator_design.serve.workers.missions import check_request
from mercator_design.serve.workers.studies import check_study

router = APIRouter(prefix="/api/v1", tags=["jobs"], responses=RESPONSES)

Key = Annotated[str, Header(alias="Idempotency-Key", max_length=200, pattern=r"^[\x21-\x7e]*$")]


@router.post("/jobs", status_code=201)
def submit(service: TheService, user: TheUser, body: JobRequest, response: Response, key: Key = "") -> Submitted:
    """Submit a design job. With the same Idempotency-Key, the same job is returned, and none is added."""
    request = body.request()
    if key and (row := service.index.find_by_key(user.name, key)) is not None:
        response.status_code = 200
        return Submitted(job=JobAnswer.of(service.jobs.resubmitted(row, request)), warnings=[])
    service.jobs.check_disk(user.name)
    checked = service.workers.run(check_request, request, service.settings.limits)
    row = service.jobs.submit(user.name, checked.name, checked.direction, request, key)
    response.headers["Location"] = f"{router.prefix}/jobs/{row.id}"
    return Submitted(job=JobAnswer.of(row), warnings=list(checked.warnings))


@router.post("/studies", status_code=201)
def submit_study(
    service: TheService, user: TheUser, body: StudyToSubmit, response: Response, key: Key = ""
) -> Submitted:
    """Submit a study as a job. With the same Idempotency-Key, the same job is returned, and none is added."""
    if key and service.index.find_by_key(user.name, key) is not None:
        response.status_code = 200
    else:
        service.jobs.check_disk(user.name)
    given = (body.study, body.study_text, body.study_name, body.files)
    checked = service.workers.run(check_study, *given, service.settings.limits)
    name = body.study_name if body.study_name == checked.name else ""
    request = StudyRequest(**body.model_dump() | {"study_name": name}, budget=checked.experiments)
    row = service.jobs.submit(user.name, checked.name, "", request, key)
    response.headers["Location"] = f"{router.prefix}/jobs/{row.id}"
    return Submitted(job=JobAnswer.of(row), warnings=list(checked.warnings))


@router.get("/jobs")
def find(
    service: TheService,
    user: TheUser,
    state: Annotated[list[State] | None, Query()] = None,
    owner: Annotated[str, Query(max_length=100)] = "",
    text: Annotated[str, Query(max_length=200, description="In the id or the name of the mission.")] = "",
    shared: bool = False,
    order: Order = "submitted",
    descending: bool = True,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    offset: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> JobPage:
    """List jobs that you may see."""
    rows, total = service.index.find(
        user.viewer,
        states=state or (), owner=owner, text=text, shared=shared, order=order, descending=descending,
        limit=limit, offset=offset,
    )  # fmt: skip
    return JobPage(jobs=[JobAnswer.of(row) for row in rows], total=total)


@router.get("/jobs/{id}")
def show(row: VisibleJob) -> JobAnswer:
    """Show a job."""
    return JobAnswer.of(row)


@router.patch("/jobs/{id}")
def change(service: TheService, row: OwnJob, body: JobChange) -> JobAnswer:
    """Extend the budget of a job, change its priority, share it."""
    return JobAnswer.of(service.jobs.change(row.id, **body.model_dump()))


@router.post("/jobs/{id}/pause")
def pause(service: TheService, row: OwnJob) -> JobAnswer:
    """Stop a job until it is resumed; running experiments finish."""
    return JobAnswer.of(service.jobs.pause(row.id))


@router.post("/jobs/{id}/resume")
def resume(service: TheService, row: OwnJob) -> JobAnswer:
    """Resume a job that was paused or has failed."""
    return JobAnswer.of(service.jobs.resume(row.id))


@router.post("/jobs/{id}/cancel")
def cancel(service: TheService, row: OwnJob) -> JobAnswer:
    """Stop a job for good; its results so far stay."""
    return JobAnswer.of(service.jobs.cancel(row.id))


@router.delete("/jobs/{id}", status_code=204)
def delete(service: TheService, row: OwnJob) -> None:
    """Delete a job that does not run, with all its files."""
    service.jobs.delete(row.id)
