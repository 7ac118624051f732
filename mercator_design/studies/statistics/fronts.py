"""The fronts of races by several objectives, and their hypervolume, by which methods are compared as a whole.

A front is what no other design of its race beats in all objectives, by means on fresh instances. There is one reference
point for each mission, so that hypervolumes are comparable over methods, budgets, robot models and realities: beyond
the worst of all fronts by a tenth of the range, so that the ends of a front count, too. Volumes are shares of the box
between the best of all fronts and this point.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from mercator_design.race.elimination.fronts import hypervolume, nondominated

HYPERVOLUME = "hypervolume of the front"
"""What stands in the place of an objective."""
BEYOND = 0.1
_NOT_OF_PLACE = ("file", "objective", "score", "error", "runs")


class FrontBox(NamedTuple):
    """The box in which hypervolumes of a mission are measured: scores by each objective."""

    best: Mapping[str, float]
    reference: Mapping[str, float]


def front_rows(
    place: Mapping[str, Any], scores: Mapping[str, Sequence[Sequence[float]]], maximised: Mapping[str, bool]
) -> Iterator[dict[str, Any]]:
    """The rows of a race's front, one for each design and objective.

    Args:
        place: What the rows have in common.
        scores: Of each file of control software on the instances, by each objective.
        maximised: The names of the objectives, and whether higher scores are better.
    """
    signs = [-1.0 if one else 1.0 for one in maximised.values()]
    runs = {file: np.array(rows, dtype=float) for file, rows in scores.items()}
    is_on = nondominated(np.array([signs * one.mean(axis=0) for one in runs.values()]))
    for file, own in (item for item, on in zip(runs.items(), is_on, strict=True) if on):
        n = len(own)
        errors = own.std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.full(len(signs), np.nan)
        for k, name in enumerate(maximised):
            figures = {"score": float(own[:, k].mean()), "error": float(errors[k]), "runs": n}
            yield {**place, "file": file, "objective": name, **figures}


def box_of(rows: pd.DataFrame, maximised: Mapping[str, bool]) -> FrontBox:
    """The box of all fronts of a mission."""
    best, reference = {}, {}
    for name, scores in rows.groupby("objective", sort=False)["score"]:
        low, high = float(scores.min()), float(scores.max())
        first, last = (high, low) if maximised[str(name)] else (low, high)
        best[str(name)], reference[str(name)] = first, last + BEYOND * ((last - first) or 1.0)
    return FrontBox(best, reference)


def hypervolumes(fronts: pd.DataFrame, boxes: Mapping[str, FrontBox]) -> pd.DataFrame:
    """A row for each front: its hypervolume, from 0 to 1, as the score by HYPERVOLUME.

    Args:
        fronts: Rows as of `front_rows`.
        boxes: By mission.
    """
    places = [name for name in fronts if name not in _NOT_OF_PLACE]
    rows = []
    for place, front in fronts.groupby(places, sort=False, observed=True):
        named = dict(zip(places, place, strict=True))
        box = boxes[str(named["mission"])]
        points = front.pivot_table(index="file", columns="objective", values="score")[[*box.best]].to_numpy(float)
        best, reference = (np.array([*one.values()]) for one in box)
        volume = hypervolume((points - best) / (reference - best), np.ones(len(best)))
        rows.append(
            {**named, "objective": HYPERVOLUME, "score": volume, "error": np.nan, "runs": front["runs"].iloc[0]}
        )
    return pd.DataFrame(rows)
