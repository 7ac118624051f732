"""What a table of a study shows: pairs, pooled tests, ranks, the reality gap."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from mercator_design.race.elimination.statistics import holm
from mercator_design.show.study.page import study_page
from mercator_design.studies.analysis import analysed
from mercator_design.studies.statistics.comparison import compared, ranks_by_objective, relative_ranks
from mercator_design.studies.statistics.rank_tests import van_elteren
from mercator_design.studies.statistics.reality_gap import reality_gap
from mercator_design.studies.table import StudyTable
from tests.studies.tables import run_rows, study_table

UP = {("up", "a"): [5, 6, 7, 8, 9], ("up", "b"): [1, 2, 3, 4, 4.5]}
SAME = {("same", "a"): [1, 2, 3, 4, 5], ("same", "b"): [1.5, 2.5, 3.5, 4.5, 0.5]}


def test_pairs_have_the_rank_sum_test_with_holm_over_all_of_them():
    found = compared(study_table(run_rows(UP | SAME)))
    raw = [stats.mannwhitneyu(UP["up", "a"], UP["up", "b"]).pvalue]
    raw.append(stats.mannwhitneyu(SAME["same", "a"], SAME["same", "b"]).pvalue)
    assert [pair.p_value for pair in found.pairs] == pytest.approx(raw)
    assert [pair.p_holm for pair in found.pairs] == pytest.approx(holm(np.array(raw)).tolist())
    assert [pair.outcome for pair in found.pairs] == ["better than", "not distinguishable from"]
    assert [pair.a.value for pair in found.pairs] == [1.0, 0.6]
    assert found.pairs[0].medians.value == 4.0
    assert found.pairs[0].means.value == pytest.approx(4.1)
    assert found.pairs[0].p_paired == pytest.approx(2 / 2**5)
    assert [*found.visible] == [5]
    assert found.visible[5].shift < math.inf


def test_fewer_costs_are_better():
    found = compared(study_table(run_rows(UP), maximise=False)).pairs[0]
    assert (found.outcome, found.a.value, found.medians.value) == ("worse than", 0.0, 4.0)


def test_missions_are_pooled_by_van_elteren():
    found = compared(study_table(run_rows(UP | SAME)))
    (pooled,) = found.pooled
    assert pooled.p_value == van_elteren([tuple(map(np.array, half)) for half in (UP.values(), SAME.values())])
    assert pooled.missions("better than") == ["up"]
    assert pooled.missions("worse than") == []
    assert pooled.mean_a == pytest.approx(0.8)
    assert compared(study_table(run_rows(UP))).pooled == []


def test_budgets_are_pooled_apart():
    table = study_table(run_rows(UP | SAME) + run_rows(UP | SAME, budget=50))
    assert [one.setting for one in compared(table).pooled] == ["budget 500", "budget 50"]


def test_designs_of_other_seeds_are_not_paired():
    rows = run_rows(UP)
    for row in rows:
        row["seed"] += 10 * (row["method"] == "b")
    assert compared(study_table(rows)).pairs[0].p_paired is None


def test_a_single_design_is_compared_with_nothing():
    rows = run_rows(UP) + run_rows({("one", "a"): [1, 2, 3], ("one", "b"): [2]})
    found = compared(study_table(rows))
    assert found.alone == ["one"]
    assert len(found.pairs) == 1
    nothing = compared(study_table(run_rows({("one", "a"): [1], ("one", "b"): [2]})))
    assert (nothing.pairs, nothing.visible) == ([], {})


def test_three_levels_are_ranked_in_blocks_of_missions_and_repetitions():
    third = {("up", "c"): [0, 0.1, 0.2, 0.3, 0.4], ("same", "c"): [9, 9, 9, 9, 9]}
    found = compared(study_table(run_rows(UP | SAME | third)))
    designs, medians = found.ranks
    assert (designs.ranked.n_blocks, medians.ranked.n_blocks) == (10, 2)
    assert medians.ranked.mean_ranks.tolist() == [1.5, 2.5, 2.0]
    rows = [[*each] for m in ("up", "same") for each in zip(*((UP | SAME | third)[m, k] for k in "abc"), strict=True)]
    assert designs.ranked.p_value == pytest.approx(stats.friedmanchisquare(*np.array(rows).T).pvalue)
    assert compared(study_table(run_rows(UP | SAME))).ranks == []


def test_repetitions_that_all_levels_have_are_blocks():
    """In each repetition c is better than b, and b than a; a lacks the first one and c the last one."""
    rows = run_rows({("m", level): [10 * number + k for number in range(6)] for k, level in enumerate("abc")})
    lacking = {("a", 1), ("c", 6)}
    table = study_table([row for row in rows if (row["method"], row["repetition"]) not in lacking])
    (found,) = compared(table).ranks
    levels = dict(zip(found.levels, found.ranked.mean_ranks.tolist(), strict=True))
    assert (found.ranked.n_blocks, levels) == (4, {"a": 3.0, "b": 2.0, "c": 1.0})
    for row in rows:
        row["repetition"] += 10 * (row["method"] == "a")
    assert compared(study_table(rows)).ranks[0].ranked.n_blocks == 6  # none in common: in their order


def test_budgets_are_ranked_apart():
    three = run_rows({("up", level): [k, k + 1] for k, level in enumerate("abc")})
    table = study_table(three + [{**row, "budget": 50} for row in three])
    assert [(one.setting, one.ranked.n_blocks) for one in compared(table).ranks] == [
        ("budget 500", 2),
        ("budget 50", 2),
    ]


def test_pairs_of_fewer_designs_have_a_power_of_their_own():
    found = compared(study_table(run_rows(UP | {("up", "c"): [1, 2]})))
    assert [*found.visible] == [2, 5]
    assert found.visible[2].shift == math.inf > found.visible[5].shift


def test_relative_ranks_begin_with_the_best():
    (block,) = study_table(run_rows({("m", "a"): [3, 1], ("m", "b"): [2, 1]})).blocks()
    ranks = relative_ranks(block)
    assert ranks["a"].tolist() == pytest.approx([0.0, 2.5 / 3])
    assert ranks["b"].tolist() == pytest.approx([1 / 3, 2.5 / 3])


def test_a_design_by_hand_counts_once_by_ranks():
    """With one design of the race better at a budget and one at the other: it has the mean of both ranks."""
    rows = run_rows({("m", "a"): [9, 5]}) + run_rows({("m", "a"): [1, 5]}, budget=50)
    table = study_table(rows + run_rows({("m", "hand"): [5]}, budget=0))
    (ranks,) = ranks_by_objective(table, table.blocks()).values()
    assert ranks["a"].tolist() == [0.0, 0.75, 1.0, 0.25]
    assert ranks["hand"].tolist() == [0.5]
    assert table.by_hand == {"hand"}


def test_objectives_are_compared_and_pooled_apart():
    missions = {("up", "a"): [5, 6, 7, 8, 9], ("up", "b"): [1, 2, 3, 4, 4.5]}
    missions |= {(f"{mission} too", method): found for (mission, method), found in missions.items()}
    rows = run_rows(missions, objective="most") + run_rows(missions, objective="least")
    places = {(mission, name) for mission, _ in missions for name in ("most", "least")}
    directions = {place: "maximise" if place[1] == "most" else "minimise" for place in places}
    found = compared(StudyTable(name="s", runs=pd.DataFrame(rows), directions=directions, limits={}))
    assert [(pair.block.name, pair.outcome) for pair in found.pairs] == [
        ("up, most", "better than"),
        ("up too, most", "better than"),
        ("up, least", "worse than"),
        ("up too, least", "worse than"),
    ]
    assert [(one.setting, one.mean_a, len(one.pairs)) for one in found.pooled] == [("most", 1.0, 2), ("least", 0.0, 2)]


def gap(there, **others):
    table = study_table(run_rows(UP) + run_rows(there, reality="field"), **others)
    return reality_gap(table, compared(table))


def test_a_rank_inversion_is_sure_if_both_differences_are_significant():
    found = gap({("up", "a"): [0, 0.5, 0.6, 0.7, 0.8], ("up", "b"): [1, 2, 3, 4, 4.5]})
    (order,) = found.orders
    assert order.change == "inverted"
    assert (order.model.outcome, order.there.outcome) == ("better than", "worse than")
    assert [(drop.level, drop.model, drop.there, drop.median) for drop in found.drops] == [
        ("a", 7.0, 0.6, 6.4),
        ("b", 3.0, 3.0, 0.0),
    ]
    assert found.drops[0].p_value == pytest.approx(2 * 2 / 2**5)  # Holm of two
    assert found.drops[1].p_value == 1.0
    (more,) = found.compared
    assert more.more.value == pytest.approx(6.4)
    assert more.p_value < 0.05


def test_a_drop_of_designs_by_hand_counts_once_for_all_budgets():
    """Holm's correction is for three drops: of the race at both budgets, and of the designs by hand."""
    rows = run_rows({("m", "a"): range(5, 10)}) + run_rows({("m", "a"): range(4, 9)}, budget=50)
    rows += run_rows({("m", "hand"): range(1, 6)}, budget=0)
    there = [row | {"reality": "field", "score": row["score"] - 1.0} for row in rows]
    table = study_table(rows + there)
    found = reality_gap(table, compared(table))
    assert [(drop.block, drop.level) for drop in found.drops] == [
        ("m, budget 500", "a"),
        ("m", "hand"),
        ("m, budget 50", "a"),
    ]
    assert [drop.p_value for drop in found.drops] == [3 * 2 / 2**5] * 3 == [drop.least_p for drop in found.drops]
    assert [one.block for one in found.compared] == ["m, budget 500", "m, budget 50"]
    page = study_page(analysed(table), "x")
    assert page.count("median loss of a design of hand") == 1
    assert page.count("the median loss of a design of a ") == 2


def test_an_inversion_without_significance_is_perhaps_one():
    assert gap({("up", "a"): [2, 2, 2, 3, 3], ("up", "b"): [1, 2, 3, 4, 4.5]}).orders[0].change == "perhaps inverted"
    assert gap({("up", "a"): [5, 5, 5, 5, 5], ("up", "b"): [1, 2, 3, 4, 4.5]}).orders[0].change == "kept"


def test_losses_of_costs_are_positive_if_they_are_higher_there():
    found = gap({("up", "a"): [6, 7, 8, 9, 10], ("up", "b"): [1, 2, 3, 4, 4.5]}, maximise=False)
    assert found.drops[0].losses.tolist() == [1.0] * 5
    assert (found.drops[0].model, found.drops[0].there) == (7.0, 8.0)


def test_scores_there_are_correlated_with_those_of_the_model():
    there = {key: [score**2 for score in scores] for key, scores in UP.items()}
    (found,) = gap(there).correlations
    assert (found.n_designs, found.rho) == (10, pytest.approx(1.0))
    (flat,) = gap({key: [1.0] * 5 for key in UP}).correlations
    assert flat.rho is None
