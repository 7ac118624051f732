import json

import numpy as np
import pytest

from benchmarks.argos import scores
from mercator_design.config.writing import plain


@pytest.fixture(scope="session")
def known_experiments():
    """Statistics of what was compared with the original, by how it was run and seed."""
    return {}


@pytest.fixture(scope="module")
def experiments_once(known_experiments):
    """What has run once is not run again: tests of the comparison with the original ask for the same experiments."""
    columns = scores.measured_columns

    def known_columns(seeds, measure, jobs):
        place, pfsm = measure.args
        simulator = getattr(place, "_simulator", place)
        settings = json.dumps([plain(simulator.mission), plain(simulator.robot_model)])
        rows = known_experiments.setdefault((measure.func, settings, pfsm), {})
        if new := [seed for seed in seeds if seed not in rows]:
            found = columns(new, measure, jobs)
            rows |= {seed: {name: found[name][k] for name in found} for k, seed in enumerate(new)}
        return {name: np.array([rows[seed][name] for seed in seeds]) for name in rows[seeds[0]]}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scores, "measured_columns", known_columns)
        yield
