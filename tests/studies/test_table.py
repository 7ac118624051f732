import math

import pandas as pd
import pytest

from mercator_design.errors import StudyError
from mercator_design.studies.table import StudyTable
from tests.studies.tables import run_rows, study_table

SCORES = {
    ("m", "a"): [[1, 3], [5, 5]],
    ("m", "b"): [[2, 2], [0, 4]],
    ("n", "a"): [[1], [2]],
    ("n", "b"): [[3], [4]],
}


def test_a_design_has_the_mean_of_its_runs_and_its_error():
    designs = study_table(run_rows(SCORES)).designs
    first = designs.iloc[0]
    assert (first.method, first.mission, first.repetition, first.score, first.runs) == ("a", "m", 1, 2.0, 2)
    assert first.error == 1.0  # sd sqrt(2) over sqrt(2)
    assert math.isnan(designs[designs.mission == "n"].error.iloc[0])
    assert len(designs) == 8


def test_scores_that_are_not_possible_are_refused():
    assert len(study_table(run_rows(SCORES), limits=(0.0, 5.0)).designs) == 8
    with pytest.raises(StudyError, match="mission m: expected scores from 0 to 4, found 5"):
        study_table(run_rows(SCORES), limits=(0.0, 4.0))


def test_a_block_is_a_mission_and_higher_values_are_better():
    block, other = study_table(run_rows(SCORES)).blocks()
    assert (block.name, other.name) == ("m", "n")
    assert block.values("a").tolist() == [2.0, 5.0]
    least = study_table(run_rows(SCORES), maximise=False).blocks()[0]
    assert least.values("a").tolist() == [-2.0, -5.0]
    assert least.scores["a"].tolist() == [2.0, 5.0]


def test_blocks_differ_in_budget_and_robot_model_too():
    rows = run_rows(SCORES) + run_rows(SCORES, budget=50)
    assert [block.name for block in study_table(rows).blocks()] == [
        "m, budget 500", "n, budget 500", "m, budget 50", "n, budget 50",
    ]  # fmt: skip


def test_other_factors_are_compared_within_equal_methods():
    rows = run_rows(SCORES) + run_rows(SCORES, budget=50)
    table = study_table(rows, by="budget")
    assert table.levels == ["50", "500"]
    assert [block.name for block in table.blocks()] == ["m, a", "m, b", "n, a", "n, b"]
    assert [*table.blocks()[0].scores] == ["50", "500"]


def test_designs_that_no_race_made_are_compared_at_each_budget():
    rows = run_rows(SCORES) + run_rows(SCORES, budget=50)
    by_hand = run_rows({("m", "hand"): [[7], [8]]}, budget=0)
    blocks = {block.name: [*block.scores] for block in study_table(rows + by_hand).blocks()}
    assert blocks["m, budget 50"] == blocks["m, budget 500"] == ["a", "b", "hand"]
    assert blocks["n, budget 50"] == ["a", "b"]
    assert [[*block.scores] for block in study_table(by_hand).blocks()] == [["hand"]]


def test_realities_begin_with_the_design_model_and_have_blocks_of_their_own():
    rows = run_rows({("m", "a"): [[9]]}, reality="other") + run_rows({("m", "a"): [[1]]})
    table = study_table(rows)
    assert table.realities == ["design", "other"]
    assert table.blocks("other")[0].values("a").tolist() == [9.0]


def by_objective(scores, **others):
    """A table of the scores by each objective of {objective: {(mission, method): designs}}."""
    rows = [row for name, found in scores.items() for row in run_rows(found, objective=name, **others)]
    places = {(row["mission"], row["objective"]) if row["objective"] else row["mission"] for row in rows}
    return StudyTable(
        name="several",
        runs=pd.DataFrame(rows),
        directions={one: "minimise" if "length" in one else "maximise" for one in places},
        limits={one: (0.0, 9.0) if "length" in one else (None, None) for one in places},
    )


def test_scores_by_several_objectives_never_meet():
    table = by_objective(
        {
            "": {("n", "a"): [[5], [6]]},
            "count": {("m", "a"): [[1, 3], [4, 4]]},
            "length": {("m", "a"): [[7, 9], [1, 3]]},
        }
    )
    one, count, length = table.blocks()
    assert [block.name for block in (one, count, length)] == ["n", "m, count", "m, length"]
    assert (one.setting, count.setting, length.objective) == ("", "count", "length")
    assert count.values("a").tolist() == [2.0, 4.0]
    assert length.values("a").tolist() == [-8.0, -2.0]
    assert (count.possible.maximise, length.possible) == (True, (0.0, 9.0, False))
    assert table.designs["score"].tolist() == [5, 6, 2, 4, 8, 2]
    with pytest.raises(StudyError, match="mission m, length: expected its direction"):
        StudyTable(name="x", runs=table.runs, directions={"n": "maximise", ("m", "count"): "maximise"}, limits={})


def test_a_table_of_designs_needs_no_runs():
    known = study_table(run_rows(SCORES))
    table = StudyTable(
        name="known", runs=pd.DataFrame(), designs=known.designs, directions=known.directions, limits=known.limits
    )
    assert table.blocks()[0].values("b").tolist() == [2.0, 2.0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [{k: v for k, v in row.items() if k != "seed"} for row in rows], "column seed"),
        (lambda rows: [*rows, rows[0]], "found two of mission m"),
        (lambda rows: [{**row, "score": math.nan} for row in rows], "score in each row, found nan"),
        (lambda rows: [row | {"seed": row["instance"]} for row in rows], "found two of mission m"),
    ],
)
def test_wrong_tables_are_refused(change, words):
    with pytest.raises(StudyError, match=words):
        study_table(change(run_rows(SCORES)))


def test_a_factor_that_is_no_column_and_a_mission_without_direction_are_refused():
    with pytest.raises(StudyError, match="one of robot_model, method, budget, found flavour"):
        study_table(run_rows(SCORES), by="flavour")
    with pytest.raises(StudyError, match="mission m: expected its direction"):
        StudyTable(name="x", runs=pd.DataFrame(run_rows(SCORES)), directions={}, limits={})
