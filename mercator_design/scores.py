"""Valid scores: numbers whose means and variances can be computed."""

LARGEST_SCORE = 1e100
"""The square of the sum of 10^9 scores of this size is still a finite number."""

EXPECTED = f"expected a score from {-LARGEST_SCORE:g} to {LARGEST_SCORE:g}"


def is_score(value: float) -> bool:
    """Whether a number may be a score; NaN may not."""
    return abs(value) <= LARGEST_SCORE
