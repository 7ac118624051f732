"""The benchmark that replays recorded vectors finds what is wrong in them, wherever it is."""

import copy
import gzip
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.check_vectors import main, report
from benchmarks.vectors import irace_parts, irace_races, irace_tests
from benchmarks.vectors.checks import difference
from benchmarks.vectors.formats import VectorError, replay
from tests.tiers import some

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests" / "data"


def load(name):
    with gzip.open(DATA / f"race_{name}.json.gz", "rt", encoding="utf-8") as file:
        return json.load(file)


@pytest.fixture(scope="module")
def parts():
    return load("vectors")


@pytest.fixture(scope="module")
def tests():
    document = load("tests")
    return {"cases": document["cases"][:3]}


@pytest.fixture(scope="module")
def races():
    return {"cases": load("races")["cases"][6:7]}  # with rejections


def changed(document, path, value):
    """A copy with one value replaced; `value` may be a function of the present one."""
    document = copy.deepcopy(document)
    *parents, last = path
    place = document
    for key in parents:
        place = place[key]
    place[last] = value(place[last]) if callable(value) else value
    return document


def differing(form, document):
    return [check for check in form.checks(document) if check.difference]


@pytest.mark.parametrize(
    ("path", "value", "kind"),
    [
        (["friedman", "survivors"], [], "friedman, constrow"),
        (["friedman", "test_ranks", 1], lambda rank: rank + 0.5, "friedman, constrow"),
        (["friedman", "p_value"], lambda p: p * (1 + 1e-8), "friedman, constrow"),
        (["friedman", "dropped_any"], True, "friedman, constrow"),
        (["friedman", "race_ranks", 2], lambda rank: rank + 1, "friedman, constrow"),
        (["friedman", "best"], 3, "friedman, constrow"),
        (["ttest", "none", "survivors"], [1], "t-test, none"),
        (["ttest", "holm", "best"], 1, "t-test, holm"),
        (["ttest", "holm", "test_ranks", 0], lambda mean: mean * (1 + 1e-8), "t-test, holm"),
        (["ttest", "bonferroni", "p_value"], 0.5, "t-test, bonferroni"),
        (["ttest", "none", "race_ranks"], [1, 2, 3], "t-test, none"),
    ],
)
def test_a_wrong_elimination_is_found(tests, path, value, kind):
    wrong = differing(irace_tests, changed(tests, ["cases", 0, *path], value))
    assert [(check.kind, check.case, check.is_tie) for check in wrong] == [(kind, "case 1", False)]
    assert str(path[-1 if isinstance(path[-1], str) else -2]) in wrong[0].difference


@pytest.mark.swept
@pytest.mark.parametrize(
    ("path", "value", "kind"),
    some(
        [
            (["arithmetic", 7, "nb_iterations"], 1, "arithmetic"),
            (["arithmetic", 7, "minimum_budget_nonelitist"], 1, "arithmetic"),
            (["arithmetic", 7, "schedule", 1, "nb_configurations_elitist"], lambda n: n + 1, "arithmetic"),
            (["nb_configurations", 9, "result"], lambda n: n + 1, "nb_configurations"),
            (["elite_weights", 3, "weights", 0], lambda w: w + 1e-9, "elite_weights"),
            (["model", "traces", 0, "steps", 0, "model", "c1", "8", 1], 0.2500001, "model, initialise"),
            (["model", "traces", 0, "steps", 1, "model", "r1", "8", 0], 3.0511924, "model, update"),
            (["model", "traces", 0, "steps", 1, "model", "rc", "8", 1], 0.5, "model, update"),
            (["model", "traces", 0, "steps", 3, "model", "o1", "10", 1], 4, "model, soft_restart"),
            (["quantiles", 4, "values", 5], 32, "quantiles"),
            (["similar", 0, "similar_ids"], [], "similar"),
            (["overall_ranks", 0, "friedman", 2], 18, "overall_ranks, friedman"),
            (["overall_ranks", 0, "ttest"], [4, 3, 2, 5, 7, 1, 6], "overall_ranks, t-test"),
            (["table_columns", 0, "kendall_w"], 0.03, "table_columns"),
            (["command_lines", 2, "result"], "--a 1e-10", "command_lines"),
            (["truncated_normal", 0, "exact_mean"], lambda mean: mean + 1e-3, "truncated_normal"),
            (["truncated_normal", 0, "sample_sd"], lambda sd: sd * 1.03, "truncated_normal"),
            (["truncated_normal", 0, "q10_q50_q90", 2], lambda q: q + 0.05, "truncated_normal"),
            (["sampled_frequencies", "ord", 0, "freq", 4], 0.001, "sampled_frequencies, ord"),
            (["sampled_frequencies", "int_1_10", 1, "freq", 4], 0.19, "sampled_frequencies, int_1_10"),
        ],
        4,
    ),
)
def test_a_wrong_part_is_found(parts, path, value, kind):
    of_kind = {key: parts["vectors"][key] for key in {path[0], "model"}}
    if path[0] == "sampled_frequencies":  # others take seconds
        of_kind[path[0]] = {path[1]: of_kind[path[0]][path[1]]}
    wrong = differing(irace_parts, changed({"vectors": of_kind}, ["vectors", *path], value))
    assert [(check.kind, check.is_tie) for check in wrong] == [(kind, False)]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["evaluated", 0, "configurations"], lambda them: them[::-1]),
        (["experiments_used"], lambda n: n + 1),
        (["survivors"], lambda them: them[::-1]),
        (["ranks", 0], lambda rank: rank + 1),
        (["rejected_so_far"], []),
        (["elites_out"], lambda them: them[:-1]),
        (["weights", 0], lambda weight: weight + 1e-9),
    ],
)
def test_a_wrong_result_of_a_race_is_found_in_that_race_alone(races, path, value):
    wrong = differing(irace_races, changed(races, ["cases", 0, "races", 3, *path], value))
    assert [(check.kind, check.case) for check in wrong] == [(f"race, {path[0]}", "case 7, race 4")]


def test_equal_means_in_another_order_are_a_tie_and_told_apart(tests, capsys):
    """Configurations 17 and 25 of case 3 have the mean -0.4, and R's rounding makes the latter the best."""
    swapped = changed(
        tests,
        ["cases", 2, "ttest", "none", "race_ranks"],
        lambda ranks: [1 if r == 2 else 2 if r == 1 else r for r in ranks],
    )
    swapped = changed(swapped, ["cases", 2, "ttest", "none", "best"], 17)
    wrong = differing(irace_tests, swapped)
    assert [(check.kind, check.case, check.is_tie) for check in wrong] == [("t-test, none", "case 3", True)]
    assert report(irace_tests.checks(swapped), shown=5)
    out = capsys.readouterr().out
    assert "| t-test, none | 2 | 3 | 1 |" in out
    assert "case 3: a tie of means; race_ranks" in out
    moved = changed(swapped, ["cases", 2, "ttest", "none", "race_ranks", 0], 3)
    assert [check.is_tie for check in differing(irace_tests, moved)] == [False]
    assert not report(irace_tests.checks(moved), shown=5)


def test_equal_means_of_as_many_results_are_a_tie():
    case = {"costs": [[0.1, 0.3, 0.2], [0.3, 0.1, 0.2], [None, None, 0.1]], "friedman": [4, 4, 1], "ttest": [2, 3, 1]}
    assert [check.is_tie for check in differing(irace_parts, {"vectors": {"overall_ranks": [case]}})] == [True]
    case["ttest"] = [1, 3, 2]
    assert [check.is_tie for check in differing(irace_parts, {"vectors": {"overall_ranks": [case]}})] == [False]


def test_a_case_that_cannot_be_replayed_disagrees_and_the_others_are_still_compared(tests, races, capsys):
    del (broken := copy.deepcopy(tests))["cases"][1]["costs"]
    wrong = differing(irace_tests, broken)
    assert {check.case for check in wrong} == {"case 2"}
    assert {check.difference for check in wrong} == {"cannot be replayed: KeyError: 'costs'"}
    assert not report(irace_tests.checks(broken), shown=5)
    assert "| all | 8 | 12 | 0 |" in capsys.readouterr().out
    short = changed(races, ["cases", 0, "costs"], lambda rows: rows[:2])
    assert "out of bounds" in differing(irace_races, short)[0].difference
    assert differing(irace_parts, {"vectors": {"others": []}})[0].difference == "unknown kind of vectors"


@pytest.mark.parametrize("content", [[], {}, {"cases": []}, {"cases": 3}, {"runs": []}, {"vectors": 1}, None])
def test_what_is_of_no_known_format_is_refused_by_name(tmp_path, content):
    file = tmp_path / "some.json"
    file.write_text(json.dumps(content))
    with pytest.raises(
        VectorError,
        match=r"some.json: expected recorded vectors of a known format \(Eliminations by irace; Parts of irace; ",
    ):
        replay(file)


def test_numbers_agree_to_their_last_recorded_digit():
    assert difference({"a": [1, 0.333333333333333]}, {"a": [1.0, 1 / 3]}) == ""
    assert difference({"a": [1, 0.33333333333]}, {"a": [1, 1 / 3]}).startswith("a[2]: expected 0.33333333333, found")
    assert difference([1, 2], [1]) == "expected [1, 2], found [1]"
    assert difference("NaN", float("nan")) == difference(None, float("nan")) == ""
    assert difference(float("nan"), 1.0)
    assert difference(None, 0.0)


def test_exit_codes_say_what_came_out(tmp_path, monkeypatch, capsys):
    def run(*files):
        monkeypatch.setattr(sys, "argv", ["check_vectors.py", *map(str, files)])
        return main(), *capsys.readouterr()

    small, bad = tmp_path / "small.json", tmp_path / "bad.json"
    document = load("races")
    document["cases"] = document["cases"][:1]
    small.write_text(json.dumps(document))
    code, out, err = run(small)
    assert (code, err) == (0, "")
    assert re.search(r"\| all \| ([1-9]\d*) \| \1 \| 0 \|", out)
    bad.write_text(json.dumps(changed(document, ["cases", 0, "races", 1, "experiments_used"], 1)))
    code, out, _ = run(bad)
    assert code == 1
    assert "case 1, race 2: expected 1, found" in out
    command = [sys.executable, ROOT / "benchmarks" / "check_vectors.py", small, ROOT / "README.md"]  # as a script
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert "README.md: expected JSON" in done.stderr
