"""Routes on FSMs: their modules, checks, evaluations, replays; and the winner of a job."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, TypeVar

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool

from mercator_design.api import fresh_instances
from mercator_design.serve.http.context import TheService, TheUser, VisibleJob
from mercator_design.serve.http.machines.schemas import (
    CheckedFsm,
    CheckRequest,
    EvaluationAnswer,
    EvaluationRequest,
    Modules,
    ReplayRequest,
    Winner,
)
from mercator_design.serve.http.problems import RESPONSES
from mercator_design.serve.http.requested import (
    fsm_of_job,
    fsm_text,
    mission_of_job,
    requested_machines,
    requested_mission,
    run_folder,
)
from mercator_design.serve.http.schemas import MAX_SEED, Flavour
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.workers.machines import (
    Machines,
    check_fsm,
    compare_fsms,
    replays,
    run_experiments,
    winner_of,
)
from mercator_design.serve.workers.pool import Busy
from mercator_design.serve.workers.process import TooMuchWork
from mercator_design.serve.workers.sources import FsmSource

router = APIRouter(prefix="/api/v1", tags=["fsms"], responses=RESPONSES)

PART_OF_LIMIT = 0.05
"""Share of the workers' time limit after which an evaluation lets other work go first."""
MAX_OF_LIMIT = 10.0
"""Multiple of the workers' time limit above which an evaluation is refused."""
_PAUSE = 1.0
"""Seconds between two attempts of an evaluation to get a worker."""

T = TypeVar("T")


@router.get("/modules")
def modules(flavour: Flavour = "watermelon") -> Modules:
    """List the behaviours and conditions of a flavour, with their parameters."""
    return Modules.of(flavour)


@router.post("/fsms/check")
def check(service: TheService, user: TheUser, body: CheckRequest) -> CheckedFsm:
    """Check an FSM: its mistakes; or if there are none, its text, explanation, diagram and findings."""
    source = FsmSource(name="", text=fsm_text(body.fsm), flavour=body.flavour)
    mission = None if body.mission is None else requested_mission(service, user, body.mission)
    return CheckedFsm(**service.workers.run(check_fsm, source, mission, service.settings.limits, narrow=body.narrow))


@router.post("/fsms/evaluate")
async def evaluate(request: Request, service: TheService, user: TheUser, body: EvaluationRequest) -> EvaluationAnswer:
    """Measure FSMs on the same fresh instances of a mission, and compare them by paired tests."""
    limits, seconds = service.settings.limits, service.settings.worker_seconds
    if body.runs > limits.runs:
        raise LimitReached(f"runs: expected at most {limits.runs}, the limit of this service, found {body.runs}")
    machines = requested_machines(service, user, body.mission, body.fsms)
    seeds, scores, spent = fresh_instances(body.seed, body.runs), list[float](), 0.0
    while len(scores) < (total := len(seeds) * len(machines.fsms)):
        work = partial(service.workers.run, run_experiments, machines, seeds, len(scores), PART_OF_LIMIT * seconds)
        part, taken = await _done(request, work, has_begun=bool(scores))
        scores, spent = [*scores, *part], spent + taken
        if (expected := spent * total / len(scores)) > MAX_OF_LIMIT * seconds:
            raise TooMuchWork(
                f"{total} experiments would take about {expected:.0f} s; "
                f"the service allows {MAX_OF_LIMIT * seconds:.0f} s: ask for fewer runs"
            )
    last = partial(service.workers.run, compare_fsms, machines, seeds, body.seed, scores)
    return EvaluationAnswer(**await _done(request, last, has_begun=True))


async def _done(request: Request, work: Callable[[], T], *, has_begun: bool) -> T:
    """Result of a part of an evaluation. Once begun, an evaluation waits for a worker as long as its client is there.

    Raises:
        NotPossible: Nobody waits for it.
        MercatorError: What the work raises.
    """
    while True:
        if await request.is_disconnected():
            raise NotPossible("nobody waits for this any more")
        try:
            return await run_in_threadpool(work)
        except Busy:
            if not has_begun:
                raise
        await asyncio.sleep(_PAUSE)


@router.post("/fsms/replay")
def replay(service: TheService, user: TheUser, body: ReplayRequest) -> list[dict[str, Any]]:
    """Run FSMs on an instance of a mission, and return a replay of each for the viewer."""
    return service.workers.run(replays, requested_machines(service, user, body.mission, body.fsms), body.seed)


@router.get("/jobs/{id}/winner")
def winner(service: TheService, row: VisibleJob) -> Winner:
    """Show the winner of a job, or its best so far, also while its race runs."""
    mission = mission_of_job(service, row)
    return Winner(**service.workers.run(winner_of, run_folder(service, row), mission, service.settings.limits))


@router.get("/jobs/{id}/replay")
def replay_of_job(
    service: TheService,
    row: VisibleJob,
    seed: Annotated[int, Query(ge=0, le=MAX_SEED, description="Of the instance.")] = 1,
    configuration: Annotated[
        int | None, Query(ge=0, lt=2**63, description="Of its race; by default the winner, or the best so far.")
    ] = None,
) -> list[dict[str, Any]]:
    """Run a configuration of a job on an instance of its mission, and return the replay for the viewer."""
    source = replace(fsm_of_job(service, row), configuration=configuration)
    machines = Machines(fsms=(source,), mission=mission_of_job(service, row), limits=service.settings.limits)
    return service.workers.run(replays, machines, seed)
