"""The bodies of requests and answers on FSMs."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import Module, ModuleParameter
from mercator_design.serve.http.schemas import MAX_SEED, Body, Flavour, Identity, MissionGiven, one_of

MAX_FSMS = 6
_MAX_FSM = 65_536  # characters, as of a file
_Word = Annotated[str, Field(max_length=200)]


class ParameterAnswer(BaseModel):
    """A parameter of a module. A word has its choices in `words`, and its `low` and `high` do not count."""

    name: str
    low: float
    high: float
    integer: bool
    middle: float
    """Middle of the sampled range."""
    words: list[str]
    unit: str
    description: str


class ModuleAnswer(BaseModel):
    """A behaviour or a condition."""

    name: str
    number: int
    description: str
    senses: list[str]
    parameters: list[ParameterAnswer]

    @classmethod
    def of(cls, number: int, module: Module) -> "ModuleAnswer":
        """The answer on a module with its number in a flavour."""
        return cls(
            name=module.name,
            number=number,
            description=f"{module.sentence}.",
            senses=sorted(module.reads),
            parameters=[_parameter(module, one) for one in module.parameters],
        )


def _parameter(module: Module, one: ModuleParameter) -> ParameterAnswer:
    low, high = one.sampled
    middle = 0.5 * (low + high)
    comment, unit = module.meanings.get(one.name, ""), module.unit(one.name)
    return ParameterAnswer(
        name=one.name,
        low=one.low,
        high=one.high,
        integer=one.integer,
        middle=round(middle) if one.integer else middle,
        words=list(one.labels),
        unit=unit,
        description=comment.removeprefix(f"[{unit}]").strip(),
    )


class Modules(BaseModel):
    """Modules of a flavour, and the limits of its FSMs."""

    flavour: Flavour
    max_states: int
    max_transitions: int
    behaviours: list[ModuleAnswer]
    conditions: list[ModuleAnswer]

    @classmethod
    def of(cls, flavour: Flavour) -> "Modules":
        known = flavour_of(flavour)
        behaviours, conditions = (
            [ModuleAnswer.of(number, module) for number, module in known.numbered(kind).items()]
            for kind in ("behaviour", "condition")
        )
        return cls(
            flavour=flavour,
            max_states=known.limit("states"),
            max_transitions=known.limit("transitions"),
            behaviours=behaviours,
            conditions=conditions,
        )


class _Named(BaseModel):
    """Named keys, and the parameters of a module beside them, as in an fsm.yaml."""

    model_config = ConfigDict(extra="allow", strict=True)
    __pydantic_extra__: dict[str, int | float | str] = Field(init=False)


class StructuredTransition(_Named):
    """A transition: its condition, the parameters of that, and the name of its target."""

    condition: str
    to: str


class StructuredState(_Named):
    """A state: its name, its behaviour, the parameters of that, its transitions."""

    name: str
    behaviour: str
    transitions: Annotated[list[StructuredTransition], Field(max_length=100)] = []


class StructuredFsm(Body):
    """An FSM as data: an fsm.yaml as JSON."""

    model_config = ConfigDict(extra="forbid", strict=True, populate_by_name=True, serialize_by_alias=True)

    version: Annotated[Literal[1], Field(alias="schema")] = 1
    flavour: _Word = "watermelon"
    states: Annotated[list[StructuredState], Field(max_length=100, description="The first is the initial one.")]


FsmText = Annotated[str, Field(max_length=_MAX_FSM, description="A line of an fsm.txt, an fsm.txt, or an fsm.yaml.")]


class MissionBody(MissionGiven):
    """A mission: the name of a shipped one, the text of a file, or that of a job or a saved design."""

    job: Annotated[Identity, Field(description="Id of a job, whose mission it is.")] = ""
    design: Annotated[Identity, Field(description="Id of a saved design, whose mission it is.")] = ""

    _of_one = one_of("mission", "mission_text", "job", "design")


class FsmBody(Body):
    """An FSM: a text or data; or the winner of a job, or its best so far; or a saved design."""

    name: Annotated[str, Field(max_length=100, description="By which the answer calls it.")] = ""
    fsm: FsmText | StructuredFsm | None = None
    flavour: Annotated[Flavour | None, Field(description="Of a text that does not say it.")] = None
    job: Annotated[Identity, Field(description="Id of a job.")] = ""
    design: Annotated[Identity, Field(description="Id of a saved design.")] = ""

    _of_one = one_of("fsm", "job", "design")


class CheckRequest(Body):
    """An FSM to check, perhaps on a mission."""

    fsm: FsmText | StructuredFsm
    flavour: Annotated[Flavour | None, Field(description="Of a text that does not say it.")] = None
    mission: MissionBody | None = None
    narrow: Annotated[bool, Field(description="Whether the states of the diagram are in a column.")] = False


class ReplayRequest(Body):
    """FSMs to run on an instance of a mission."""

    mission: MissionBody
    fsms: Annotated[list[FsmBody], Field(min_length=1, max_length=MAX_FSMS)]
    seed: Annotated[int, Field(ge=0, le=MAX_SEED, description="Of the instance.")] = 1


class EvaluationRequest(ReplayRequest):
    """FSMs to run on the same fresh instances of a mission."""

    runs: Annotated[int, Field(ge=1, le=10**6, description="Instances.")] = 30
    seed: Annotated[int, Field(ge=0, le=MAX_SEED, description="From which the instances come.")] = 1


class FindingAnswer(BaseModel):
    """A finding in an FSM; a note may be intended."""

    code: str
    place: str
    message: str
    is_note: bool


class CheckedFsm(BaseModel):
    """Result of the check of an FSM; if it is not valid, only errors."""

    valid: bool
    errors: list[str]
    """A message for each mistake: place, what was expected, what was found."""
    text: str = ""
    """The line of an fsm.txt."""
    file: str = ""
    """An fsm.txt, with its header."""
    yaml: str = ""
    structure: StructuredFsm | None = None
    explanation: str = ""
    findings: list[FindingAnswer] = []
    diagram: str = ""
    """SVG: elements of a state have `data-state`, those of a transition `data-transition`."""


class Winner(BaseModel):
    """The winner of a job, or its best configuration so far."""

    configuration: int
    mean: float
    """Its score."""
    measured: str
    """Where: "on 30 fresh instances", or "in the race, 12 runs"."""
    is_winner: bool
    fsm: CheckedFsm


class EvaluatedFsm(BaseModel):
    """The scores of an FSM, and their statistics."""

    name: str
    fsm: str
    scores: list[float]
    mean: float
    standard_deviation: float | None
    quartiles: tuple[float, float, float]
    confidence_interval: tuple[float, float] | None
    """95 % interval of the mean, by Student's t, within the possible scores."""


class FsmPair(BaseModel):
    """The first FSM's scores minus the second's, on the same instances."""

    first: str
    second: str
    mean_difference: float
    confidence_interval: tuple[float, float] | None
    p_value: float
    """P value of the paired t-test, with Holm's correction for all pairs."""


class EvaluationAnswer(BaseModel):
    """The figures of an evaluation, as `mdesign evaluate --json` prints them for several FSMs; and box plots (SVG)."""

    mission: str
    direction: str
    robots: int
    duration: float
    robot_model: str
    runs: int
    seed: int
    possible_scores: tuple[float | None, float | None]
    """The least and the largest; null where there is no limit."""
    seeds: list[int]
    best: str
    fsms: list[EvaluatedFsm]
    pairs: list[FsmPair]
    chart: str
