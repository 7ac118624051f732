"""The bodies of requests and answers on jobs."""

from dataclasses import asdict
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model, model_validator

from mercator_design.errors import excerpt, printable
from mercator_design.modules.flavour import flavour_names
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.serve.jobs.index import ORDERS, IndexRow
from mercator_design.serve.jobs.job import KINDS, MAX_BUDGET, MAX_PRIORITY, MAX_TESTS, Job, RaceRequest, StudyRequest
from mercator_design.serve.workers.sources import MissionSource

MAX_TEXT = 262_144
"""Maximum length of a mission or an FSM [characters]."""
MAX_SEED = 2**53 - 1
"""The largest seed of a request: pages send it again, and JavaScript rounds larger numbers."""
MAX_FILES = 200
"""Maximum number of files beside a study's."""
MAX_PATH = 200
"""Maximum length of the path of such a file [bytes]."""
MAX_ID = 255
"""Maximum length of an id [characters]; a run folder of no job has its name as id."""

if TYPE_CHECKING:
    Method: TypeAlias = str
    Order: TypeAlias = str
else:  # the words of this package's tables
    Method, Order = Literal[tuple(METHODS)], Literal[ORDERS]


def _known(flavour: str) -> str:
    """A flavour of this service: a shipped one, or one that its administrator has placed."""
    if flavour not in flavour_names():
        raise ValueError(f"expected one of {', '.join(flavour_names())}")
    return flavour


Flavour = Annotated[str, AfterValidator(_known), Field(max_length=200)]
Identity = Annotated[str, Field(max_length=MAX_ID)]
MissionText = Annotated[str, Field(max_length=MAX_TEXT)]
Override = Annotated[str, Field(max_length=2000)]


class Body(BaseModel):
    """A body of a request: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", strict=True)


def one_of(*names: str) -> Any:  # noqa: ANN401 - pydantic's decorator has no name for it
    """A check of a body: it has exactly one of these fields."""

    def check(body: Body) -> Body:
        if sum(getattr(body, name) != type(body).model_fields[name].default for name in names) != 1:
            raise ValueError(f"expected one of {', '.join(names[:-1])} and {names[-1]}")
        return body

    return model_validator(mode="after")(check)


class MissionGiven(Body):
    """A shipped mission by its name, or the text of a mission file."""

    mission: Annotated[str, Field(max_length=200, description="Name of a shipped mission.")] = ""
    mission_text: Annotated[MissionText | None, Field(description="A mission file (YAML), instead of a name.")] = None
    set: Annotated[list[Override], Field(max_length=100, description="Overrides such as `robots=10`.")] = []

    _of_one = one_of("mission", "mission_text")

    def source(self) -> MissionSource:
        return MissionSource(name=self.mission, text=self.mission_text, overrides=tuple(self.set))


class MissionToCheck(MissionGiven):
    """A mission to check."""

    flavour: Flavour = "watermelon"


class MissionToShow(MissionGiven):
    """A mission to draw."""

    seed: Annotated[int, Field(ge=0, le=MAX_SEED, description="Of the instance that is shown.")] = 1
    kind: Annotated[Literal["svg", "png"], Field(description="Format of the picture.")] = "svg"


class TextToComplete(Body):
    """A mission file, perhaps unfinished, and a place in it."""

    text: MissionText
    line: Annotated[int, Field(ge=1, le=10**6, description="From 1.")]
    column: Annotated[int, Field(ge=1, le=10**6, description="From 1, in characters; behind what is written.")]


class JobRequest(MissionGiven):
    """A job to submit."""

    budget: Annotated[int, Field(ge=1, le=MAX_BUDGET, description="Experiments at most.")]
    method: Method = DEFAULT_METHOD
    flavour: Flavour = "watermelon"
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 1
    test_runs: Annotated[int, Field(ge=0, le=MAX_TESTS, description="Fresh instances to test the winner on.")] = (
        TEST_RUNS
    )
    priority: Annotated[
        int, Field(ge=-MAX_PRIORITY, le=MAX_PRIORITY, description="Among your jobs; a higher one runs first.")
    ] = 0

    def request(self) -> RaceRequest:
        return RaceRequest(**self.model_dump() | {"set": tuple(self.set)})


def _beside(files: dict[str, str]) -> dict[str, str]:
    """Files by paths that lead into the folder of a study, where each has a place of its own."""
    folders = {str(folder) for name in files for folder in PurePosixPath(name).parents}
    for name in files:
        path = PurePosixPath(name)
        is_path = str(path) == name and not path.is_absolute() and path.parts and name.isprintable()
        if not is_path or any(part.startswith(".") for part in path.parts) or len(name.encode()) > MAX_PATH:
            what = f"expected a path as missions/own.yaml, of at most {MAX_PATH} bytes, without '..' and hidden files"
            raise ValueError(f"{what}, found {printable(excerpt(name))}")
        if name in folders or name == PurePosixPath(StudyRequest.FILE).name:
            raise ValueError(f"expected each file with a name of its own, found {name} twice, or as a folder")
    return files


class StudyToSubmit(Body):
    """A study to submit: a shipped one by its name, or the text of a study's file, with the files that it names."""

    study: Annotated[str, Field(max_length=200, description="Name of a shipped study.")] = ""
    study_text: Annotated[MissionText | None, Field(description="A study's file (YAML), instead of a name.")] = None
    study_name: Annotated[str, Field(max_length=100, description="The name of the study, if its text has none.")] = ""
    files: Annotated[
        dict[str, MissionText],
        Field(max_length=MAX_FILES, description="Missions and control software that the text names, by their paths."),
        AfterValidator(_beside),
    ] = {}
    priority: Annotated[
        int, Field(ge=-MAX_PRIORITY, le=MAX_PRIORITY, description="Among your jobs; a higher one runs first.")
    ] = 0

    _of_one = one_of("study", "study_text")


class JobChange(Body):
    """Changes of a job; what is not given stays."""

    budget: Annotated[int | None, Field(ge=1, le=MAX_BUDGET, description="A larger budget.")] = None
    priority: Annotated[int | None, Field(ge=-MAX_PRIORITY, le=MAX_PRIORITY)] = None
    shared: Annotated[bool | None, Field(description="Whether all users may see it.")] = None


class _RowAnswer(BaseModel):
    """A job, or a run folder that was in the data folder before (its `owner` is empty)."""

    @classmethod
    def of(cls, row: IndexRow) -> "JobAnswer":
        """Answer for a row of the index."""
        known: dict[str, Any] = {"method": "", "flavour": "", "seed": 0}  # those of a study are in its file
        known |= asdict(row)
        known |= known.pop("job")
        known |= known.pop("request")
        return cls(**{name: known[name] for name in cls.model_fields})


_ANSWERED = (
    "id", "kind", "owner", "name", "state", "message", "method", "flavour", "seed", "budget", "priority", "experiments",
    "best", "measured", "direction", "submitted", "ended", "seconds", "left", "shared",
)  # fmt: skip
if TYPE_CHECKING:
    JobAnswer: TypeAlias = _RowAnswer
else:  # fields of a row, of its job and of the job's request
    _TYPES = get_type_hints(Job) | get_type_hints(RaceRequest) | get_type_hints(IndexRow) | {"kind": Literal[KINDS]}
    _ROW_FIELDS = {name: (_TYPES[name], ...) for name in _ANSWERED}
    JobAnswer = create_model("JobAnswer", __base__=_RowAnswer, __doc__=_RowAnswer.__doc__, **_ROW_FIELDS)


class Submitted(BaseModel):
    """A job that was submitted, and the warnings on its mission."""

    job: JobAnswer
    warnings: list[str]


class JobPage(BaseModel):
    """A page of a list of jobs."""

    jobs: list[JobAnswer]
    total: int


class File(BaseModel):
    """A file of a run folder."""

    name: str
    bytes: int
