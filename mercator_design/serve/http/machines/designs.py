"""Routes on designs: FSMs that users keep."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query
from fastapi.responses import PlainTextResponse
from pydantic import AfterValidator, BaseModel, Field

from mercator_design.api import fresh_instances
from mercator_design.config.schema import Name, unwrapped
from mercator_design.designer import TEST_SEED
from mercator_design.serve.designs import FSM, Design
from mercator_design.serve.http.context import TheService, TheUser
from mercator_design.serve.http.machines.schemas import CheckedFsm, FsmBody, MissionBody
from mercator_design.serve.http.problems import RESPONSES, NotAllowed
from mercator_design.serve.http.requested import requested_machines, visible_design
from mercator_design.serve.http.schemas import Body
from mercator_design.serve.jobs.store import MISSION
from mercator_design.serve.workers.machines import check_fsm, new_design, run_experiments
from mercator_design.serve.workers.process import TooMuchWork
from mercator_design.serve.workers.sources import FsmSource, MissionSource

router = APIRouter(prefix="/api/v1", tags=["designs"], responses=RESPONSES)

_RUNS = 10
"""Instances on which a design is measured when it is saved."""
_MEASURING = 0.25
"""Share of the workers' time limit after which no further experiment starts."""


def _as_in_files(name: str) -> str:
    """A name that is also valid in a design's file, whose pattern knows fewer letters than pydantic's.

    Raises:
        ValueError: It may not have this one.
    """
    _, rules = unwrapped(Name)
    for rule in rules:
        if not rule.allows(name):
            raise ValueError(f"expected {rule.says('a text')}")
    return name


_Name = Annotated[
    str,
    Field(min_length=1, max_length=100, pattern=r"^\w[\w .+\-]*$", description="Letters, digits, spaces, . _ + -"),
    AfterValidator(_as_in_files),
]


class DesignRequest(Body):
    """A design to save."""

    name: _Name
    mission: MissionBody
    fsm: FsmBody
    shared: Annotated[bool, Field(description="Whether all users may see it.")] = False


class DesignChange(Body):
    """Changes of a design; what is not given stays."""

    name: _Name | None = None
    shared: bool | None = None


class DesignAnswer(BaseModel):
    """A design."""

    id: str
    owner: str
    name: str
    mission: str
    direction: str
    mean: float | None
    """Mean of its scores on the first instances of `mdesign evaluate`."""
    runs: int
    created: str
    shared: bool

    @classmethod
    def of(cls, design: Design) -> "DesignAnswer":
        names = cls.model_fields.keys() - {"runs"}
        return cls(runs=len(design.scores), **{name: getattr(design, name) for name in names})


class DesignPage(BaseModel):
    """A page of a list of designs."""

    designs: list[DesignAnswer]
    total: int


class WholeDesign(BaseModel):
    """A design with its FSM, and the text of its mission."""

    design: DesignAnswer
    mission_text: str
    fsm: CheckedFsm


VisibleDesign = Annotated[Design, Depends(visible_design)]


def _changeable(user: TheUser, design: VisibleDesign) -> Design:
    if not user.owns(design.owner):
        raise NotAllowed(f"{design.id} is not yours: only its owner and administrators may change it")
    return design


OwnDesign = Annotated[Design, Depends(_changeable)]


@router.post("/designs", status_code=201)
def save(service: TheService, user: TheUser, body: DesignRequest) -> DesignAnswer:
    """Save an FSM with its mission; it is measured on a few instances first."""
    service.designs.check_number(user.name)
    machines = requested_machines(service, user, body.mission, [body.fsm])
    new = service.workers.run(new_design, machines)
    seeds = fresh_instances(TEST_SEED, _RUNS)
    try:
        scores, _ = service.workers.run(
            run_experiments, machines, seeds, 0, _MEASURING * service.settings.worker_seconds
        )
    except TooMuchWork:  # one experiment is too much: the score is not known
        scores = ()
    design = Design(
        id="-", owner=user.name, name=body.name, mission=new.mission_name, direction=new.direction, scores=scores,
        created="", shared=body.shared,
    )  # fmt: skip
    return DesignAnswer.of(service.designs.create(design, new.fsm, new.mission))


@router.get("/designs")
def find(
    service: TheService,
    user: TheUser,
    owner: Annotated[str, Query(max_length=100)] = "",
    text: Annotated[str, Query(max_length=200, description="In the name, or in that of the mission.")] = "",
    shared: bool = False,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    offset: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> DesignPage:
    """List the designs that you may see, the newest first."""
    found = service.designs.find(user.viewer, owner=owner, text=text, shared=shared)
    return DesignPage(designs=[DesignAnswer.of(one) for one in found[offset : offset + limit]], total=len(found))


@router.get("/designs/{id}")
def show(service: TheService, design: VisibleDesign) -> WholeDesign:
    """Show a design with its FSM."""
    fsm = FsmSource(name=design.name, text=service.designs.text(design.id, FSM))
    text = service.designs.text(design.id, MISSION)
    forms = service.workers.run(check_fsm, fsm, MissionSource(text=text), service.settings.limits)
    return WholeDesign(design=DesignAnswer.of(design), mission_text=text, fsm=CheckedFsm(**forms))


@router.get("/designs/{id}/fsm.txt", response_class=PlainTextResponse)
def fetch(service: TheService, design: VisibleDesign) -> PlainTextResponse:
    """Fetch the fsm.txt of a design."""
    headers = {"Content-Disposition": f'attachment; filename="{FSM}"'}
    return PlainTextResponse(service.designs.text(design.id, FSM), headers=headers)


@router.patch("/designs/{id}")
def change(service: TheService, design: OwnDesign, body: DesignChange) -> DesignAnswer:
    """Rename a design, or share it."""
    changes = {name: value for name, value in body.model_dump().items() if value is not None}
    return DesignAnswer.of(service.designs.update(design.id, **changes))


@router.delete("/designs/{id}", status_code=204)
def delete(service: TheService, design: OwnDesign) -> None:
    """Delete a design."""
    service.designs.delete(design.id)
