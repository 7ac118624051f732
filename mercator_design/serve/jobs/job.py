"""A job: a request, and its state. The folder of its race or study has the rest, but what is in the file of the job."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, Self, TypeAlias, get_args

from mercator_design.config.schema import Length, Name, OneOf, Range
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS
from mercator_design.results.analysis.comparison import TEST_RUNS

State: TypeAlias = Literal["queued", "running", "paused", "finished", "failed", "cancelled"]
STATES: tuple[State, ...] = get_args(State)
ENDED: tuple[State, ...] = ("finished", "failed", "cancelled")
"""Final states, until a user resumes or extends the job."""
MAX_BUDGET, MAX_TESTS, MAX_PRIORITY, MAX_SEED = 10**9, 10**6, 100, 2**63 - 1
KINDS = ("race", "study")
"""What a job runs."""
Wish: TypeAlias = Literal["run", "pause", "cancel"]
_STUDY = "study/"


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceRequest:
    """Request of a race, in the terms of `mdesign race`; the same value from a route of the API to the job."""

    FILE: ClassVar = "mission.yaml"  # of its text
    TEXTS: ClassVar = FILE  # pattern of the files of all its texts

    kind: Literal["race"] = "race"
    mission: str  # name of a shipped mission; empty: mission_text is one
    mission_text: str | None = None  # of a mission file; of a job's file, it is in a file beside it
    set: tuple[str, ...] = ()  # overrides of the mission
    budget: Annotated[int, Range(1, MAX_BUDGET)]
    method: Annotated[str, OneOf(tuple(METHODS))] = DEFAULT_METHOD
    flavour: str = "watermelon"
    seed: Annotated[int, Range(0, MAX_SEED)] = 1
    test_runs: Annotated[int, Range(0, MAX_TESTS)] = TEST_RUNS
    priority: Annotated[int, Range(-MAX_PRIORITY, MAX_PRIORITY)] = 0  # among its user's jobs; a higher one runs first

    @property
    def texts(self) -> Mapping[str, str]:
        """The user's text, if any, by its file."""
        return {} if self.mission_text is None else {self.FILE: self.mission_text}

    def with_texts(self, texts: Mapping[str, str]) -> Self:
        return replace(self, mission_text=texts.get(self.FILE))

    @property
    def experiments(self) -> Mapping[str, int]:
        """Numbers of experiments that a service limits, by the names of their keys."""
        return {"budget": self.budget, "test_runs": self.test_runs}


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRequest:
    """Request of a study, in the terms of `mdesign study run`."""

    FILE: ClassVar = f"{_STUDY}study.yaml"  # of its text
    TEXTS: ClassVar = f"{_STUDY}**/*"  # pattern of the files of all its texts

    kind: Literal["study"] = "study"
    study: str  # name of a shipped study; empty: study_text is one
    study_text: str | None = None  # of a study's file; of a job's file, it is in a file beside it, as `files` are
    study_name: str = ""  # if the text has none
    files: Mapping[str, str] = field(default_factory=dict)  # texts that the study's text names, by their paths in it
    budget: Annotated[int, Range(1, MAX_BUDGET)]  # experiments of the whole at most, with those of the assessments
    priority: Annotated[int, Range(-MAX_PRIORITY, MAX_PRIORITY)] = 0  # as of races

    @property
    def texts(self) -> Mapping[str, str]:
        """The user's texts by their files: of the study, and of what it names."""
        own = {} if self.study_text is None else {self.FILE: self.study_text}
        return own | {f"{_STUDY}{name}": text for name, text in self.files.items()}

    def with_texts(self, texts: Mapping[str, str]) -> Self:
        files = {file.removeprefix(_STUDY): text for file, text in texts.items() if file != self.FILE}
        return replace(self, study_text=texts.get(self.FILE), files=files)

    @property
    def experiments(self) -> Mapping[str, int]:
        """Numbers of experiments that a service limits, by the names of their keys."""
        return {"experiments": self.budget}


Request: TypeAlias = RaceRequest | StudyRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """The contents of a job's file."""

    format: Literal[1] = 1
    id: Annotated[str, Length(1, 120)]
    owner: str
    name: Name  # of the mission or study
    direction: str  # of the score: maximise or minimise; of a study empty
    request: Request
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
        is_finished: Whether its race has a winner under the requested budget, or its study a page. The process of a
            race goes on with the report, and the job has not ended before that.
        is_running: Whether a process runs its race.
    """
    if is_running:
        return "running"
    if job.failure:
        return "failed"
    if is_finished and job.ended:
        return "finished"
    return {"run": "queued", "pause": "paused", "cancel": "cancelled"}[job.wish]  # type: ignore[return-value]
