"""An objective of a mission: a function of this folder or of a plugin, with parameters and direction; and weights."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from mercator_design.config.schema import FieldError, KeywordsOf, Range, check, checked, parameters_of, problems
from mercator_design.errors import MercatorError, MissionError, excerpt
from mercator_design.missions.calls import Call, copied
from mercator_design.missions.plugins import OBJECTIVES, OF_A_PLUGIN, limits_of
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace
from mercator_design.plugins.places import first_line
from mercator_design.plugins.registries import is_ours
from mercator_design.scores import ANY_SCORE, EXPECTED, ScoreRange, is_score

_NUMBERS: Any = (int, float, np.integer, np.floating, np.bool_)
"""The scores that an objective may return."""
Direction = Literal["maximise", "minimise"]


class Scored(NamedTuple):
    """The scores of an experiment: the one that stands for all, and that by each objective, in their order."""

    score: float
    by_objective: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective(Call):
    """A function of OBJECTIVES with its parameters and direction."""

    FUNCTIONS: ClassVar = OBJECTIVES
    KIND: ClassVar = "objective"

    direction: Direction  # whether a higher or a lower score is better
    parameters: Annotated[Mapping[str, Any], KeywordsOf(OBJECTIVES, "name", OF_A_PLUGIN)]

    def __post_init__(self) -> None:
        Call.__post_init__(self)
        defaults = {name: default for name, (_, default) in parameters_of(self.function).items()}
        checked(problems(self.function, defaults | {**self.parameters}))

    @property
    def goal(self) -> str:
        """Its direction and name."""
        return f"{self.direction} {self.name}"

    def cost(self, score: float) -> float:
        """The cost of a score: what a race minimises."""
        return -score if self.direction == "maximise" else score

    def __call__(self, trace: Trace) -> float:
        """The score of an experiment.

        Raises:
            MissionError: if the function fails, or its value is not a score.
        """
        with self.reporting(MissionError, MercatorError):
            found: Any = self.function(trace, **self.with_paths(copied))
            if not isinstance(found, _NUMBERS):
                what = f"{excerpt(repr(found))} of type {type(found).__name__}"
            elif is_score(found):
                self._check_limits(float(found), trace)
                return float(found)
            else:
                what = excerpt(str(found))
        raise MissionError(f"{first_line(self.function)}objective {self.name}: {EXPECTED}, found {what}")

    def _check_limits(self, score: float, trace: Trace) -> None:
        """Check that a plugin's score is within the limits that the plugin gives; ours are, as tests show."""
        if is_ours(self.function) or limits_of(self.function) is None:
            return
        possible = self.possible_scores(ExperimentSize(trace.robots, trace.cycles, trace.floor, trace.zone_rows))
        if not possible.has(score):
            expected = f"expected a score from {possible.low:g} to {possible.high:g}, as its limits are"
            raise MissionError(f"{first_line(self.function)}objective {self.name}: {expected}, found {score:g}")

    def possible_scores(self, size: ExperimentSize) -> ScoreRange:
        """The range of the scores of experiments of a size.

        Raises:
            MissionError: if the function that gives it fails, or does not return two numbers in order.
        """
        if (limits := limits_of(self.function)) is None:
            return ANY_SCORE._replace(maximise=self.direction == "maximise")
        defaults = {name: default for name, (_, default) in parameters_of(self.function).items()}
        with self.reporting(MissionError, MercatorError):
            found: Any = limits(size, **{**defaults, **self.with_paths(copied)})
            match found:
                case (low, high) if isinstance(low, _NUMBERS) and isinstance(high, _NUMBERS) and low <= high:
                    return ScoreRange(float(low), float(high), self.direction == "maximise")
        expected = "expected limits: the least and the largest score"
        raise MissionError(f"{first_line(limits)}objective {self.name}: {expected}, found {excerpt(repr(found))}")


def _low_first(low: float, high: float) -> Iterator[FieldError]:
    if low >= high:
        yield FieldError("high", f"expected more than low, {low:g}, found {high:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Weight:
    """How much an objective counts in a weighted cost, and the range of scores that is scaled to 0 to 1."""

    CHECKS: ClassVar = (_low_first,)

    weight: Annotated[float, Range(0.0, 1e6, exclusive_low=True)] = 1.0  # relative to those of the others
    low: Annotated[float, Range(-1e12, 1e12)]  # the score at one end of the range
    high: Annotated[float, Range(-1e12, 1e12)]  # the score at its other end

    def __post_init__(self) -> None:
        check(self)


def weighted(scores: Sequence[float], weights: Sequence[Weight], maximised: Sequence[bool]) -> float:
    """The weighted mean of scaled costs: 0 if all scores are at the better ends of their ranges, 1 if at the worse.

    A score beyond its range counts as much beyond 0 or 1.
    """
    costs = (
        one.weight * ((one.high - score) if is_best_high else (score - one.low)) / (one.high - one.low)
        for score, one, is_best_high in zip(scores, weights, maximised, strict=True)
    )
    return sum(costs) / sum(one.weight for one in weights)
