"""Paired tests: whether configurations differ on the instances that they have both seen."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from mercator_design.race.elimination.statistics import holm
from mercator_design.race.elimination.summary import Scores
from mercator_design.scores import ANY_SCORE, ScoreRange

K = TypeVar("K")


class Pair(NamedTuple, Generic[K]):
    """Two sets of scores, compared.

    differences: The first's scores minus the second's, on each common instance.
    p_value: Of no difference, by the paired t-test.
    """

    first: K
    second: K
    differences: Scores
    p_value: float


def paired_p_value(differences: ArrayLike) -> float:
    """The two-sided p-value of the paired t-test; 1 if all differences are 0."""
    values = np.asarray(differences, dtype=float)
    error = float(values.std(ddof=1)) / math.sqrt(len(values))
    if error == 0:
        return 0.0 if values[0] else 1.0
    return float(2 * scipy.special.stdtr(len(values) - 1, -abs(float(values.mean())) / error))


def worse_p_value(differences: ArrayLike, margin: float) -> float:
    """The p-value of the hypothesis that costs are higher by a margin or more (non-inferiority, one-sided, paired t).

    Args:
        differences: The costs of one minus those of another, on the same instances.
        margin: The smallest difference that matters, not negative.
    """
    values = np.asarray(differences, dtype=float)
    error = float(values.std(ddof=1)) / math.sqrt(len(values))
    if error == 0:
        return 0.0 if values[0] < margin or values[0] <= 0.0 else 1.0
    return float(scipy.special.stdtr(len(values) - 1, (float(values.mean()) - margin) / error))


def compared(
    scores: Mapping[K, Mapping[int, float]],
    pairs: Sequence[tuple[K, K]] | None = None,
    possible: ScoreRange = ANY_SCORE,
) -> list[Pair[K]]:
    """Compare scores by instance, pair by pair; p-values have Holm's correction for all pairs.

    Pairs of fewer than two common instances are left out.

    Args:
        scores: The scores of each, by instance.
        pairs: Which to compare. [default: all]
        possible: The range of the scores.
    """
    found = []
    for first, second in combinations(scores, 2) if pairs is None else pairs:
        common = sorted(scores[first].keys() & scores[second].keys())
        if len(common) >= 2:
            differences = tuple(scores[first][instance] - scores[second][instance] for instance in common)
            found.append(Pair(first, second, Scores(differences, possible.differences), paired_p_value(differences)))
    corrected = holm(np.array([pair.p_value for pair in found])).tolist()
    return [pair._replace(p_value=p) for pair, p in zip(found, corrected, strict=True)]
