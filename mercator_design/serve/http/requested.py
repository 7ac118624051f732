"""Sources of the missions and FSMs that a request names, if the user may see them."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from fastapi import Path as InPath

from mercator_design.serve.accounts.users import User
from mercator_design.serve.designs import FSM, Design
from mercator_design.serve.http.context import TheService, TheUser, visible_job
from mercator_design.serve.http.machines.schemas import FsmBody, MissionBody, StructuredFsm
from mercator_design.serve.http.problems import Missing
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import StudyRequest
from mercator_design.serve.jobs.operations import NotPossible
from mercator_design.serve.jobs.store import MISSION
from mercator_design.serve.service import Service
from mercator_design.serve.workers.machines import Machines
from mercator_design.serve.workers.sources import FsmSource, MissionSource


def visible_design(
    service: TheService, user: TheUser, identity: Annotated[str, InPath(alias="id", max_length=200)]
) -> Design:
    """A design that a user may see: own, shared, or as an administrator.

    Raises:
        Missing: There is none.
    """
    design = service.designs.get(identity)
    if design is None or not (design.shared or user.owns(design.owner)):
        raise Missing(f"there is no design {identity}")
    return design


def requested_mission(service: Service, user: User, body: MissionBody) -> MissionSource:
    """The mission in a request.

    Raises:
        Missing: The user may not see its job or design.
    """
    if body.job:
        found = mission_of_job(service, visible_job(service, user, body.job))
        return replace(found, overrides=(*found.overrides, *body.set))
    if body.design:
        text = service.designs.text(visible_design(service, user, body.design).id, MISSION)
        return MissionSource(text=text, overrides=tuple(body.set))
    return body.source()


def mission_of_job(service: Service, row: IndexRow) -> MissionSource:
    """The mission of a job: that of its run folder; before its race has begun, that of its request.

    Raises:
        NotPossible: Its run folder is not of a mission, or it is a study.
    """
    folder = run_folder(service, row)
    if (folder / MISSION).exists():
        return MissionSource(folder=folder)
    if not row.is_job:
        raise NotPossible(f"{row.id}: expected the run folder of a mission, found one without {MISSION}")
    return requested_of_job(service, row)


def requested_of_job(service: Service, row: IndexRow) -> MissionSource:
    """The mission of a job's request.

    Raises:
        NotPossible: It is a study, which has several.
    """
    request = service.store.request(row.id)
    if isinstance(request, StudyRequest):
        raise NotPossible(f"{row.id}: expected a race, found a study: its missions are in its file")
    return MissionSource.of(request)


def fsm_of_job(service: Service, row: IndexRow, name: str = "") -> FsmSource:
    """The winner of a job, or its best so far."""
    return FsmSource(name=name or row.id, folder=run_folder(service, row))


def requested_machines(service: Service, user: User, mission: MissionBody, fsms: Sequence[FsmBody]) -> Machines:
    """The FSMs in a request, with unique names, and its mission.

    Raises:
        Missing: The user may not see a job or design.
    """
    found = list[FsmSource]()
    for k, body in enumerate(fsms):
        name = body.name or body.job or body.design or f"FSM {k + 1}"
        taken = {one.name for one in found}
        name = next(one for one in (name, *(f"{name} ({n})" for n in range(2, k + 3))) if one not in taken)
        if body.fsm is not None:
            found.append(FsmSource(name=name, text=fsm_text(body.fsm), flavour=body.flavour))
        elif body.job:
            found.append(fsm_of_job(service, visible_job(service, user, body.job), name))
        else:
            text = service.designs.text(visible_design(service, user, body.design).id, FSM)
            found.append(FsmSource(name=name, text=text))
    return Machines(
        fsms=tuple(found), mission=requested_mission(service, user, mission), limits=service.settings.limits
    )


def fsm_text(fsm: str | StructuredFsm) -> str:
    """The text of an FSM; data are an fsm.yaml, as JSON is YAML."""
    return fsm if isinstance(fsm, str) else json.dumps(fsm.model_dump(), ensure_ascii=True)


def run_folder(service: Service, row: IndexRow) -> Path:
    """Absolute path of a job's run folder, for the workers, which run in another folder."""
    return service.store.run_folder(row.id).resolve()
