"""Small tables of studies, for tests."""

import numpy as np
import pandas as pd

from mercator_design.studies.table import DESIGN_MODEL, StudyTable


def run_rows(scores, *, reality=DESIGN_MODEL, budget=500, robot_model="mercator", **others):
    """Rows of runs of {(mission, method): a list of runs for each design}."""
    return [
        {
            "method": method,
            "mission": mission,
            "robot_model": robot_model,
            "budget": budget,
            "repetition": repetition,
            "seed": repetition,
            "reality": reality,
            "instance": instance,
            "score": float(score),
            **others,
        }
        for (mission, method), designs in scores.items()
        for repetition, runs in enumerate(designs, start=1)
        for instance, score in enumerate(np.atleast_1d(runs), start=1)
    ]


def study_table(rows, *, maximise=True, limits=(None, None), **others):
    frame = pd.DataFrame(rows)
    missions = frame["mission"].unique()
    return StudyTable(
        name="small",
        runs=frame,
        directions=dict.fromkeys(missions, "maximise" if maximise else "minimise"),
        limits=dict.fromkeys(missions, limits),
        **others,
    )
