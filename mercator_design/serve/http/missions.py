"""Routes on missions: shipped missions, and checks, pictures and estimates before submission."""

from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any

from fastapi import APIRouter, Response
from fastapi import Path as InPath
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel

from mercator_design.config import shipped
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError
from mercator_design.serve.http.context import TheService, TheUser, VisibleJob
from mercator_design.serve.http.problems import RESPONSES, Missing
from mercator_design.serve.http.requested import mission_of_job, requested_of_job
from mercator_design.serve.http.schemas import JobRequest, MissionToCheck, MissionToShow, TextToComplete
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import Job
from mercator_design.serve.jobs.scheduler import Wait, remaining_seconds, wait_of
from mercator_design.serve.service import Service
from mercator_design.serve.workers.completion import Completions, completions
from mercator_design.serve.workers.estimates import Cost, cost_of
from mercator_design.serve.workers.missions import MissionReview, mission_schema, mission_text, picture, review
from mercator_design.show.text.missions import missions_facts

router = APIRouter(prefix="/api/v1", tags=["missions"], responses=RESPONSES)

_TYPES = {"svg": "image/svg+xml", "png": "image/png"}
_PICTURE = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'",
}


class ShippedMission(BaseModel):
    """A mission that comes with the program."""

    name: str
    description: str
    source: str
    robots: int
    duration: float
    robot_model: str
    objective: str
    direction: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Estimated time of a job on an otherwise idle machine.

    cost: Cost of its race.
    cores: Number of experiments of a race at the same time.
    wait: Jobs before it, and the waiting time.
    """

    cost: Cost
    cores: int
    wait: Wait


@cache
def shipped_missions() -> MappingProxyType[str, ShippedMission]:
    """Name -> facts of the shipped missions."""
    return MappingProxyType({name: ShippedMission.model_validate(one) for name, one in missions_facts().items()})


@router.get("/missions")
def missions() -> list[ShippedMission]:
    """List the shipped missions."""
    return [*shipped_missions().values()]


@router.get("/missions/{name}", response_class=PlainTextResponse)
def mission(name: Annotated[str, InPath(max_length=200)]) -> PlainTextResponse:
    """Fetch the YAML of a shipped mission, with its comments."""
    file = shipped.missions().get(name)
    if file is None:
        raise Missing(f"there is no shipped mission {name}")
    return PlainTextResponse(text_of(file, error=MissionError))


@router.get("/jobs/{id}/mission", response_class=PlainTextResponse)
def mission_to_submit(service: TheService, row: VisibleJob) -> PlainTextResponse:
    """Fetch the mission of a job as a YAML that can be submitted again; its overrides are in it."""
    return PlainTextResponse(text_of_job(service, row))


@router.post("/missions/check")
def check(service: TheService, body: MissionToCheck) -> MissionReview:
    """Check a mission: all mistakes and warnings with their places, and its facts if it can be read."""
    return service.workers.run(review, body.source(), body.flavour, service.settings.limits)


@router.post(
    "/missions/preview",
    response_class=Response,
    responses={
        200: {"content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in _TYPES.values()}}
    },
)
def preview(service: TheService, body: MissionToShow) -> Response:
    """Draw a mission from above: floor, zones, arena, where robots may start and what they can reach."""
    data = service.workers.run(picture, body.source(), service.settings.limits, body.seed, body.kind)
    return Response(data, media_type=_TYPES[body.kind], headers=_PICTURE)


@router.post("/missions/complete")
def complete(service: TheService, body: TextToComplete) -> Completions:
    """List what may be written at a place of a mission file, which may be unfinished."""
    return service.workers.run(completions, body.text, body.line, body.column)


@router.post("/missions/estimate")
def estimate(service: TheService, user: TheUser, body: JobRequest) -> Estimate:
    """Estimate how long a job will take and wait, from a few of its experiments, which are run and timed."""
    request, settings = body.request(), service.settings
    cost = service.workers.run(cost_of, request, settings.limits, service.cores)
    queued, _ = service.index.find(None, states=("queued",), descending=False, limit=-1)
    running, _ = service.index.find(None, states=("running",), limit=-1)
    usual = sum(cost.seconds) / 2.0 / request.budget
    new = Job(id="", owner=user.name, name="", direction="", request=request, submitted="")
    wait = wait_of(
        IndexRow(job=new, state="queued"),
        queued,
        running,
        seconds=lambda row: remaining_seconds(row, usual),
        races=settings.races,
        max_running=settings.limits.running,
    )
    return Estimate(cost=cost, cores=service.cores, wait=wait)


@router.get("/schema/mission")
def schema(service: TheService) -> dict[str, Any]:
    """Fetch the JSON Schema of mission files, for editors."""
    return service.workers.run(mission_schema)


def text_of_job(service: Service, row: IndexRow) -> str:
    """The mission of a job as a text that can be submitted again.

    Raises:
        MissionError: It cannot be submitted, for example because it has an image.
        NotPossible: Its run folder is not of a mission, or it is a study.
    """
    source = requested_of_job(service, row) if row.is_job else mission_of_job(service, row)
    return service.workers.run(mission_text, source, service.settings.limits)
