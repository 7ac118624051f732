"""Many comparisons of two samples as one family: which of their p-values are rejected."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import false_discovery_control

FALSE_DISCOVERIES = 0.01  # rate of Benjamini and Hochberg's procedure; if nothing differs, the chance of any rejection


def rejected(ps: Sequence[float], rate: float = FALSE_DISCOVERIES) -> list[int]:
    """Places of those p that Benjamini and Hochberg's procedure rejects, the smallest first."""
    passing = np.flatnonzero(false_discovery_control(ps) <= rate) if len(ps) else np.empty(0, dtype=int)
    return sorted(passing.tolist(), key=lambda k: ps[k])
