"""The events of a race and of its journal, and their form in JSON.

The start of a race is not among them: its keys depend on the task (see race/session/task.py).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Self, TypeAlias

from mercator_design.config.json_data import from_json
from mercator_design.config.schema import Kind, Length, Range
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.elimination.summary import IterationSummary
from mercator_design.race.space.parameter import Value

Number = Annotated[int, Range(0)]
"""The number of an experiment, a configuration or an instance, from 0; or a seed."""


class Measurement(NamedTuple):
    """The result of an experiment."""

    score: float
    outcome: str  # digest of what happened in it
    scores: tuple[float, ...] = ()  # by each of several objectives


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionStarted:
    """A process has begun to work on a race."""

    process: Number
    host: str
    time: str
    executor: str = ""  # what runs experiments
    jobs: Number = 0  # run at once


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionStopped:
    """A process has ended before the race."""

    why: str
    time: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigurationAdded:
    """A configuration is new in the race."""

    configuration: Number
    parent: Number | None  # the elite it was sampled from
    values: Mapping[str, Value]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentDone:
    """An experiment has run."""

    experiment: Number  # in the order in which the race asked for them
    iteration: Number
    configuration: Number
    instance: Number
    seed: Number
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed
    scores: tuple[float, ...] = ()  # by each of several objectives


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeculativeDone:
    """A speculative experiment has run."""

    configuration: Number
    instance: Number
    score: float
    outcome: str = ""  # digest of what happened in it
    scores: tuple[float, ...] = ()  # by each of several objectives


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRevised:
    """A score has been replaced, because an evaluator has compared configurations again."""

    experiment: Number  # the first of the current batch
    configuration: Number
    instance: Number
    score: float | None  # None if the configuration is rejected
    failure: str = ""  # why it is rejected


@dataclass(frozen=True, slots=True, kw_only=True)
class TestDone:
    """A test has run."""

    configuration: Number
    instance: Number  # of the test instances
    seed: Number
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed
    scores: tuple[float, ...] = ()  # by each of several objectives


@dataclass(frozen=True, slots=True, kw_only=True)
class IterationEnded:
    """An iteration has ended; see `summary.IterationSummary`."""

    iteration: Number
    postselection: bool
    budget: int
    used: Number
    configurations: Number
    instances: Number
    alive: Number
    elites: Annotated[tuple[Number, ...], Length(1)]  # best first
    stagnant: Number
    note: str

    @classmethod
    def of(cls, summary: IterationSummary) -> Self:
        """The event of an iteration's summary."""
        return cls(
            iteration=summary.iteration,
            postselection=summary.postselection,
            budget=summary.budget,
            used=summary.used,
            configurations=summary.n_configurations,
            instances=summary.n_instances,
            alive=summary.n_alive,
            elites=tuple(elite.configuration for elite in summary.elites),
            stagnant=summary.stagnant,
            note=summary.note,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetExtended:
    """The budget has been extended, after the end under the budget before."""

    budget: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceEnded:
    """The race has ended under one of its budgets."""

    budget: Number
    experiments: Number
    winner: Number  # the number of a configuration
    digest: str = ""


Event: TypeAlias = (
    SessionStarted
    | SessionStopped
    | ConfigurationAdded
    | ExperimentDone
    | SpeculativeDone
    | ScoreRevised
    | TestDone
    | IterationEnded
    | BudgetExtended
    | RaceEnded
)

_KINDS: Mapping[str, Kind] = {
    "session": SessionStarted,
    "stop": SessionStopped,
    "configuration": ConfigurationAdded,
    "experiment": ExperimentDone,
    "ahead": SpeculativeDone,
    "revised": ScoreRevised,
    "test": TestDone,
    "iteration": IterationEnded,
    "extend": BudgetExtended,
    "end": RaceEnded,
}
_WORDS: Mapping[Kind, str] = {kind: word for word, kind in _KINDS.items()}


def to_json(event: Event) -> dict[str, Any]:
    """The form of an event in JSON; `scores` only where there are several objectives."""
    kind = type(event)
    data = {"event": _WORDS[kind], **{name: getattr(event, name) for name in kind.__slots__}}
    if not data.get("scores", True):
        del data["scores"]
    return data


def event_of(data: dict[str, Any]) -> Event:
    """Read an event from its JSON data.

    Raises:
        RaceError: The data are of no event; with the key, what was expected and what was found.
    """
    word = data.pop("event", None)
    if not isinstance(word, str) or word not in _KINDS:
        raise RaceError(f"event: expected one of {', '.join(_KINDS)}, found {excerpt(str(word))}")
    event: Event = from_json(data, _KINDS[word], error=RaceError, path=word)
    return event
