"""Summaries of an iterated race: elites, progress, iterations, scores of the winner."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from mercator_design.scores import ANY_SCORE, ScoreRange

CONFIDENCE = 0.95
"""Confidence of the intervals around reported means."""
ALPHA = 0.05
"""Reported differences whose p-values are below this are called significant."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Elite:
    """A configuration that survived, with its costs on the instances that it has seen."""

    configuration: int
    mean: float
    sd: float  # of the sample; NaN for a single result
    n_results: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Progress:
    """The progress of a race."""

    iteration: int  # from 1; the post-selection is one more than `iterations`
    iterations: int  # 0 if it is not known
    alive: int
    used: int
    budget: int
    best: Elite | None  # None before the first costs


@dataclass(frozen=True, kw_only=True, slots=True)
class IterationSummary:
    """The result of an iteration, for reports."""

    iteration: int
    postselection: bool = False
    budget: int
    used: int
    n_configurations: int
    n_new: int = 0
    n_instances: int  # raced on in this iteration
    n_alive: int
    elites: tuple[Elite, ...] = ()  # best first
    soft_restart: bool = False
    stop_reason: str
    survivors: tuple[int, ...] = ()  # alive at its end
    newcomers_differ: bool = True  # False if there is no significant difference between two or more of them
    stagnant: int = 0  # iterations up to this one without a gain (race/elimination/stagnation.py)
    note: str = ""  # for the user

    @property
    def best(self) -> int:
        """The number of its best configuration."""
        return self.elites[0].configuration


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of a configuration, in the units of the task, and their statistics.

    possible: The range of all scores of the task; intervals stay within it.
    """

    values: tuple[float, ...]
    possible: ScoreRange = ANY_SCORE

    def __repr__(self) -> str:
        return f"<Scores: {self.summary}>"

    @property
    def summary(self) -> str:
        """Mean, confidence interval and number in a line."""
        if not self.values:
            return "n=0"
        interval = self.confidence_interval
        around = "" if interval is None else f", {interval[0]:.6g} to {interval[1]:.6g} at {CONFIDENCE:.0%}"
        return f"mean {self.mean:.6g}{around}, n={len(self.values)}"

    @property
    def mean(self) -> float:
        """Arithmetic mean."""
        return float(np.mean(self.values))

    @property
    def standard_deviation(self) -> float | None:
        """The standard deviation of the sample, with n - 1; None for a single score."""
        return float(np.std(self.values, ddof=1)) if len(self.values) > 1 else None

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Lower quartile, median, upper quartile."""
        low, middle, high = np.percentile(self.values, [25, 50, 75])
        return float(low), float(middle), float(high)

    @property
    def confidence_interval(self) -> tuple[float, float] | None:
        """The confidence interval of the mean, at 95 %, by Student's t; None for a single score.

        Its part outside the range of possible scores is cut off. The true mean is never there, so the interval covers
        it as often as before.
        """
        if self.standard_deviation is None:
            return None
        n = len(self.values)
        half = float(scipy.special.stdtrit(n - 1, 0.5 + CONFIDENCE / 2)) * self.standard_deviation / math.sqrt(n)
        return self.possible.clipped(self.mean - half, self.mean + half)

    @property
    def interval(self) -> tuple[float, float]:
        """The confidence interval, or the mean twice for a single score."""
        return self.confidence_interval or (self.mean, self.mean)


class Headline(NamedTuple):
    """The score of a race's winner, or of its best so far: everywhere the same figure, and where it was measured.

    scores: On fresh instances, if it was tested there; else those of the race, which are optimistic.
    """

    scores: Scores
    is_fresh: bool

    @property
    def where(self) -> str:
        """The place and the number of runs, in words that follow the score."""
        n = len(self.scores.values)
        return f"on {n} fresh instance{'s' * (n != 1)}" if self.is_fresh else f"in the race, {n} run{'s' * (n != 1)}"
