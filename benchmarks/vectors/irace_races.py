"""Whole races of irace, step by step: chains of races, each with the elites of the one before and their results.

A file has a list `cases`, each with `costs[instance][configuration]` (null is infinite: rejected), `options`, `test`,
`min_survival` and `races`. Configurations and instances count from 1. Of each race are compared the experiments in
their order, their number, and what came out. Each is given the recorded results of those before it.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.vectors.checks import Check, attempt, difference, each, table
from mercator_design.race import EliminationRace, RaceRules
from mercator_design.race.elimination.statistics import TestName
from mercator_design.race.proposals.model import elite_weights

TESTS: dict[str, TestName] = {
    "F-test": "friedman",
    "friedman": "friedman",
    "t-test": "t-test",
    "t-test-holm": "t-test-holm",
    "t-test-bonferroni": "t-test-bonferroni",
}
RESULTS = ("evaluated", "experiments_used", "survivors", "ranks", "rejected_so_far", "elites_out", "weights")
UNLIMITED = 2**31


def recognises(document: Any) -> bool:
    cases = document.get("cases") if isinstance(document, dict) else None
    return isinstance(cases, list) and any(isinstance(case, dict) and "races" in case for case in cases)


def checks(document: dict[str, Any]) -> Iterator[Check]:
    yield from each("race", document["cases"], _chain)


def _chain(name: str, case: dict[str, Any]) -> Iterator[Check]:
    options = case["options"]
    block = options.get("blockSize", 1)
    rules = RaceRules(
        test=TESTS[case["test"]],
        confidence=options["confidence"],
        first_test=options["firstTest"] * block,
        each_test=options["eachTest"] * block,
        elitist_limit=options["elitistLimit"],
    )
    costs = table(case["costs"], missing=math.inf)
    results: dict[int, dict[int, float]] = {}
    rejected: set[int] = set()
    for number, expected in enumerate(case["races"], start=1):
        n_old = expected["next_instance"] - 1
        n_new = expected["elitist_new_instances"] if n_old else 0
        race = EliminationRace(
            [c - 1 for c in expected["configurations"]],
            earlier={c - 1: results[c - 1] for c in expected["elites_in"]},
            instances=[*range(n_old, n_old + n_new), *range(n_old)],
            next_instance=n_old + n_new,
            rules=rules,
            survivors=case["min_survival"],
            planned_budget=expected["max_experiments"],
            max_experiments=UNLIMITED,
        )
        place = f"{name}, race {number}"
        yield from attempt("race", place, _race(place, race, costs, rejected, expected, case["min_survival"]))
        for step in expected["evaluated"]:
            for c in step["configurations"]:
                results.setdefault(c - 1, {})[step["instance"] - 1] = float(costs[step["instance"] - 1, c - 1])
        rejected = set(expected["rejected_so_far"])


def _race(
    place: str,
    race: EliminationRace,
    costs: NDArray[np.float64],
    rejected: set[int],
    expected: dict[str, Any],
    survivors: int,
) -> Iterator[Check]:
    evaluated = []
    while batch := race.ask():
        evaluated.append({"instance": batch[0].instance + 1, "configurations": [e.configuration + 1 for e in batch]})
        race.tell([float(costs[instance, configuration]) for configuration, instance in batch])
    ranked, ranks = race.ranked(), race.ranks()
    found = {
        "evaluated": evaluated,
        "experiments_used": race.used,
        "survivors": [c + 1 for c in ranked],
        "ranks": [ranks[c] for c in ranked],
        "rejected_so_far": sorted(rejected | {c + 1 for c in race.rejected}),
        "elites_out": [c + 1 for c in ranked[:survivors]],
        "weights": elite_weights(min(len(ranked), survivors)).tolist(),
    }
    for result in RESULTS:
        said = sorted(expected[result]) if result == "rejected_so_far" else expected[result]
        yield Check(f"race, {result}", place, difference(said, found[result]))
