"""A job: a request, and its state. The run folder has the race itself; the file of a job has the rest."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, get_args

from mercator_design.config.schema import Length, Name, OneOf, Range
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS
from mercator_design.results.analysis.comparison import TEST_RUNS

State: TypeAlias = Literal["queued", "running", "paused", "finished", "failed", "cancelled"]
STATES: tuple[State, ...] = get_args(State)
ENDED: tuple[State, ...] = ("finished", "failed", "cancelled")
"""Final states, until a user resumes or extends the job."""
MAX_BUDGET, MAX_TESTS, MAX_PRIORITY, MAX_SEED = 10**9, 10**6, 100, 2**63 - 1
Wish: TypeAlias = Literal["run", "pause", "cancel"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceRequest:
    """Request of a race, in the terms of `mdesign race`; the same value from a route of the API to the job."""

    mission: str  # name of a shipped mission; empty: mission_text is one
    mission_text: str | None = None  # of a mission file; of a job's file, it is in a file beside it
    set: tuple[str, ...] = ()  # overrides of the mission
    budget: Annotated[int, Range(1, MAX_BUDGET)]
    method: Annotated[str, OneOf(tuple(METHODS))] = DEFAULT_METHOD
    flavour: str = "watermelon"
    seed: Annotated[int, Range(0, MAX_SEED)] = 1
    test_runs: Annotated[int, Range(0, MAX_TESTS)] = TEST_RUNS
    priority: Annotated[int, Range(-MAX_PRIORITY, MAX_PRIORITY)] = 0  # among its user's jobs; a higher one runs first


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """The contents of a job's file."""

    format: Literal[1] = 1
    id: Annotated[str, Length(1, 120)]
    owner: str
    name: Name  # of the mission
    direction: str  # of the score: maximise or minimise
    request: RaceRequest
    submitted: str  # time
    key: str = ""  # of the submission: submitting again with the same key gives the same job
    wish: Wish = "run"
    failure: str = ""  # why it failed
    seconds: float = 0.0  # its races have run so far [s]
    limit_from: float = 0.0  # `seconds` when a user let it go on: the time limit counts from there
    ended: str = ""  # time at which it finished, failed or was cancelled
    shared: bool = False  # whether all users may see it


def state_of(job: Job, *, is_finished: bool, is_running: bool) -> State:
    """The state of a job.

    Args:
        job: The job.
        is_finished: Whether its race has a winner under the requested budget. The process goes on with the report, and
            the job has not ended before that.
        is_running: Whether a process runs its race.
    """
    if is_running:
        return "running"
    if job.failure:
        return "failed"
    if is_finished and job.ended:
        return "finished"
    return {"run": "queued", "pause": "paused", "cancel": "cancelled"}[job.wish]  # type: ignore[return-value]
