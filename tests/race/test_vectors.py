"""The race against what R's irace 4.4.3 does, as recorded; see data/README.md. What agrees, benchmarks/vectors says."""

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.vectors.formats import replay

DATA = Path(__file__).parents[1] / "data"
KINDS = ["constrow", "round1", "int", "real", "coarse", "dominated", "heavy", "dup", "alltied"]
RACE_RESULTS = ["evaluated", "experiments_used", "survivors", "ranks", "rejected_so_far", "elites_out", "weights"]
COUNTS = {
    "race_tests": {
        **{f"friedman, {kind}": n for kind, n in zip(KINDS, [25, 25, 21, 40, 25, 29, 17, 20, 18], strict=True)},
        **{f"t-test, {correction}": 220 for correction in ("none", "holm", "bonferroni")},
    },
    "race_vectors": {
        "arithmetic": 480,
        "nb_configurations": 300,
        "elite_weights": 15,
        "model, initialise": 954,
        "model, update": 4698,
        "model, soft_restart": 936,
        "quantiles": 105,
        "similar": 30,
        "overall_ranks, friedman": 60,
        "overall_ranks, t-test": 60,
        "table_columns": 30,
        "command_lines": 4,
        "truncated_normal": 120,
        "sampled_frequencies, ord": 5,
        "sampled_frequencies, int_1_10": 3,
        "sampled_frequencies, intlog_1_10": 3,
    },
    "race_races": {f"race, {result}": 160 for result in RACE_RESULTS},
}


@pytest.mark.parametrize("name", COUNTS)
def test_all_recorded_vectors_agree(name):
    checks = list(replay(DATA / f"{name}.json.gz"))
    assert [check for check in checks if check.difference] == []
    assert Counter(check.kind for check in checks) == COUNTS[name]
