"""Valid scores: numbers whose means and variances can be computed; and the range of those that are possible."""

import math
from typing import NamedTuple

MAX_SCORE = 1e100
"""The square of the sum of 10^9 scores of this size is still a finite number."""

EXPECTED = f"expected a score from {-MAX_SCORE:g} to {MAX_SCORE:g}"
_ROUNDING = 1e-9
"""Part of a limit by which rounding may exceed it."""


def is_score(value: float) -> bool:
    """Whether a number may be a score; NaN may not."""
    return abs(value) <= MAX_SCORE


class ScoreRange(NamedTuple):
    """The least and the largest score that are possible; infinite where no limit is known."""

    low: float = -math.inf
    high: float = math.inf
    maximise: bool = False  # whether a higher score is better

    @property
    def limit(self) -> str:
        """The best possible score, in words that follow a score; empty if it is not known."""
        best = self.high if self.maximise else self.low
        return f" of at {'most' if self.maximise else 'least'} {best:.6g}" if math.isfinite(best) else ""

    def has(self, score: float) -> bool:
        """Whether a score is possible, apart from rounding."""
        return self.low - _ROUNDING * abs(self.low) <= score <= self.high + _ROUNDING * abs(self.high)

    def clipped(self, low: float, high: float) -> tuple[float, float]:
        """The part of an interval that is possible."""
        return max(low, min(self.low, high)), min(high, max(self.high, low))

    @property
    def differences(self) -> "ScoreRange":
        """The range of the difference of two scores."""
        return ScoreRange(self.low - self.high, self.high - self.low)


ANY_SCORE = ScoreRange()
