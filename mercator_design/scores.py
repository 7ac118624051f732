"""Valid scores: numbers whose means and variances can be computed."""

MAX_SCORE = 1e100
"""The square of the sum of 10^9 scores of this size is still a finite number."""

EXPECTED = f"expected a score from {-MAX_SCORE:g} to {MAX_SCORE:g}"


def is_score(value: float) -> bool:
    """Whether a number may be a score; NaN may not."""
    return abs(value) <= MAX_SCORE
