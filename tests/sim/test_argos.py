"""Agreement with the original: recorded runs of ARGoS3 beta48, argos3-rvr and AutoMoDe-Watermelon, replayed."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.compare_argos import Trace, agreements, replay_motion

RUNS = {
    run["name"]: run
    for run in json.loads(gzip.decompress((Path(__file__).parents[1] / "data" / "argos_traces.json.gz").read_bytes()))[
        "runs"
    ]
}
FREE = ["explore_rwm20_n1", "attract5_n1", "stop_n5", "attract5_n5", "free_run_no_walls_n1"]


@pytest.mark.parametrize("name", FREE)
def test_motion_without_contact(name):
    position, heading = replay_motion(Trace(RUNS[name]))
    assert position.max() < 1e-4  # [m] after up to 60 s
    assert heading.max() < 1e-4  # [rad]


# Mean and largest error [m] allowed; pushing robots amplify the smallest difference, so theirs is large.
CONTACT = {
    "blind_push_wall_n1_s17": (5e-5, 1e-4),
    "blind_push_wall_n1_s18": (5e-5, 1e-4),
    "blind_push_wall_n1_s19": (5e-5, 1e-4),
    "four_state_n5": (0.002, 0.01),
    "blind_push_n8": (0.01, 0.08),
}


@pytest.mark.parametrize("name", CONTACT)
def test_motion_with_contact(name):
    position, _ = replay_motion(Trace(RUNS[name]))
    assert position.mean() < CONTACT[name][0]
    assert position.max() < CONTACT[name][1]


def test_perception_and_wheel_commands():
    """On 99.9 % of the recorded robot-cycles; the rest is rounding of the recorded poses and readings."""
    counts = {}
    for run in RUNS.values():
        for kind, agreed_of_total in agreements(Trace(run)).items():
            counts[kind] = np.add(counts.get(kind, (0, 0)), agreed_of_total)
    assert set(counts) == {"proximity", "neighbours", "ground", "wheels"}
    for kind, (agreed, total) in counts.items():
        assert agreed / total >= 0.999, kind
