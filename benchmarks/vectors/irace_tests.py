"""Eliminations by irace: tables of costs, and what its Friedman, Wilcoxon and t-tests make of them.

A file has a list `cases`, each with `costs[instance][configuration]`, those `alive_before`, counted from 1,
`confidence`, the `kind` of table, and what `friedman` and `ttest.none`, `.holm` and `.bonferroni` say of it.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.vectors.checks import Check, difference, each, table
from mercator_design.race.elimination.statistics import TestName, Verdict, column_means, eliminate, ranking

DIGITS = 1e-9
"""Relative difference of p-values that agree: R and scipy have their own approximations of the distributions."""
TIED = 1e-12
"""Difference of means that differ by rounding alone, as a part of the largest."""
T_TESTS: dict[str, TestName] = {"none": "t-test", "holm": "t-test-holm", "bonferroni": "t-test-bonferroni"}


def recognises(document: Any) -> bool:
    cases = document.get("cases") if isinstance(document, dict) else None
    return isinstance(cases, list) and any(isinstance(c, dict) and {"friedman", "ttest"} & c.keys() for c in cases)


def checks(document: dict[str, Any]) -> Iterator[Check]:
    yield from each("friedman", document["cases"], _friedman)
    for correction in T_TESTS:
        kind = f"t-test, {correction}"
        yield from each(kind, document["cases"], partial(_t_test, kind, correction))


def _friedman(name: str, case: dict[str, Any]) -> Iterator[Check]:
    costs = _alive(case)
    verdict = eliminate(costs, "friedman", case["confidence"])
    found = _found(case, verdict, race_ranks=ranking(costs, "friedman"), test_ranks=verdict.ranks)
    yield Check(f"friedman, {case['kind']}", name, difference(case["friedman"], found, digits=DIGITS))


def _t_test(kind: str, correction: str, name: str, case: dict[str, Any]) -> Iterator[Check]:
    costs, expected = _alive(case), case["ttest"][correction]
    means = column_means(costs)
    verdict = eliminate(costs, T_TESTS[correction], case["confidence"])
    found = _found(case, verdict, race_ranks=verdict.ranks, test_ranks=means)
    wrong = difference(expected, found, digits=DIGITS)
    of_alive = dict(zip(case["alive_before"], means.tolist(), strict=True))
    yield Check(kind, name, wrong, bool(wrong) and _differ_by_ties(expected, found, of_alive))


def _alive(case: dict[str, Any]) -> NDArray[np.float64]:
    return table(case["costs"])[:, np.array(case["alive_before"]) - 1]


def _found(
    case: dict[str, Any], verdict: Verdict, *, race_ranks: NDArray[np.float64], test_ranks: NDArray[np.float64]
) -> dict[str, Any]:
    alive = case["alive_before"]
    return {
        "survivors": [number for number, survives in zip(alive, verdict.survivors, strict=True) if survives],
        "test_ranks": test_ranks.tolist(),
        "dropped_any": not verdict.survivors.all(),
        "p_value": verdict.p_value,
        "race_ranks": race_ranks.tolist(),
        "best": alive[int(race_ranks.argmin())],
    }


def _differ_by_ties(expected: dict[str, Any], found: dict[str, Any], means: dict[int, float]) -> bool:
    """Whether only equal means are in another order; another best of them is compared with others."""
    of_all = np.array(list(means.values()))
    same_best = abs(means[expected["best"]] - means[found["best"]]) <= _rounding(of_all)
    if not same_best or not order_is_same(expected["race_ranks"], found["race_ranks"], of_all):
        return False
    of_order = {"race_ranks", "best"}
    if expected["best"] != found["best"]:
        of_order |= {"survivors", "dropped_any", "p_value"}
    rest = expected.keys() - of_order
    return not difference({k: expected[k] for k in rest}, {k: found[k] for k in rest}, digits=DIGITS)


def order_is_same(expected: ArrayLike, found: ArrayLike, means: NDArray[np.float64]) -> bool:
    """Whether ranks put those in the same order whose means differ by more than rounding."""
    apart = np.abs(np.subtract.outer(means, means)) > _rounding(means)
    return bool((np.less.outer(expected, expected) == np.less.outer(found, found))[apart].all())


def _rounding(means: NDArray[np.float64]) -> float:
    return TIED * float(np.abs(means).max())
