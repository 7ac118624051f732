"""The bodies of requests and answers on jobs."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mercator_design.serve.jobs.index import Row
from mercator_design.serve.jobs.job import Request, State

MAX_TEXT = 262_144
"""Characters of a mission or an FSM."""

Flavour = Literal["watermelon", "chocolate"]
Method = Literal["surrogate", "irace", "random", "tpe", "cma-es"]
MissionText = Annotated[str, Field(max_length=MAX_TEXT)]
Override = Annotated[str, Field(max_length=2000)]


class Body(BaseModel):
    """A body of a request: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", strict=True)


class MissionGiven(Body):
    """A shipped mission by its name, or the text of a mission file."""

    mission: Annotated[str, Field(max_length=200, description="Name of a shipped mission.")] = ""
    mission_text: Annotated[MissionText | None, Field(description="A mission file (YAML), instead of a name.")] = None
    set: Annotated[list[Override], Field(max_length=100, description="Overrides such as `robots=10`.")] = []


class MissionToCheck(MissionGiven):
    """A mission to check."""

    flavour: Flavour = "watermelon"


class MissionToShow(MissionGiven):
    """A mission to draw."""

    seed: Annotated[int, Field(ge=0, lt=2**63, description="Of the instance that is shown.")] = 1
    kind: Annotated[Literal["svg", "png"], Field(description="Format of the picture.")] = "svg"


class TextToComplete(Body):
    """A mission file, perhaps unfinished, and a place in it."""

    text: MissionText
    line: Annotated[int, Field(ge=1, le=10**6, description="From 1.")]
    column: Annotated[int, Field(ge=1, le=10**6, description="From 1, in characters; behind what is written.")]


class JobRequest(MissionGiven):
    """A job to submit."""

    budget: Annotated[int, Field(ge=1, le=10**9, description="Experiments at most.")]
    method: Method = "surrogate"
    flavour: Flavour = "watermelon"
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    test_runs: Annotated[int, Field(ge=0, le=10**6, description="Fresh instances to test the winner on.")] = 0
    priority: Annotated[int, Field(ge=-100, le=100, description="Among your jobs; a higher one runs first.")] = 0

    def request(self) -> Request:
        """What the job is to do."""
        return Request(
            mission=self.mission, set=tuple(self.set), budget=self.budget, method=self.method, flavour=self.flavour,
            seed=self.seed, test_runs=self.test_runs, priority=self.priority,
        )  # fmt: skip


class JobChange(Body):
    """Changes of a job; what is not given stays."""

    budget: Annotated[int | None, Field(ge=1, le=10**9, description="A larger budget.")] = None
    priority: Annotated[int | None, Field(ge=-100, le=100)] = None
    shared: Annotated[bool | None, Field(description="Whether all users may see it.")] = None


class Job(BaseModel):
    """A job, or a run folder that was in the data folder before (its `owner` is empty)."""

    id: str
    owner: str
    name: str
    state: State
    message: str
    method: str
    flavour: str
    seed: int
    budget: int
    priority: int
    experiments: int
    best: float | None
    tested: float | None
    direction: str
    submitted: str
    ended: str
    seconds: float
    shared: bool

    @classmethod
    def of(cls, row: Row) -> "Job":
        """The answer of a row of the index."""
        return cls(**{name: getattr(row, name) for name in cls.model_fields})


class Submitted(BaseModel):
    """A job that was submitted, and the warnings on its mission."""

    job: Job
    warnings: list[str]


class JobPage(BaseModel):
    """A page of a list of jobs."""

    jobs: list[Job]
    total: int


class File(BaseModel):
    """A file of a run folder."""

    name: str
    bytes: int
