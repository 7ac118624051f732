"""What can happen in a race: the events of its journal."""

from dataclasses import dataclass
from typing import NamedTuple


class Measured(NamedTuple):
    """What came of an experiment."""

    score: float
    outcome: str  # digest of what happened in it


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """An experiment that has run."""

    experiment: int  # its number, from 0, in the order in which the race asked for them
    iteration: int
    configuration: int
    instance: int
    seed: int
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Revised:
    """A score that has replaced another one, as an evaluator has compared configurations anew."""

    experiment: int  # the first of those that the race had asked for then
    configuration: int
    instance: int
    score: float | None  # None if the configuration is rejected
    failure: str = ""  # why it is


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested:
    """A test that has run."""

    configuration: int
    instance: int  # of the test instances, from 0
    seed: int
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Iteration:
    """An iteration that has ended; see `summary.IterationSummary`."""

    iteration: int
    postselection: bool
    budget: int
    used: int
    configurations: int
    instances: int
    alive: int
    elites: tuple[int, ...]  # best first
    stagnant: int
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """Where a race ended under one of its budgets."""

    budget: int
    experiments: int
    winner: int  # the number of a configuration
    digest: str = ""
