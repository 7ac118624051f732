"""What people see of a study: its verdicts, its page, its tables and its figures."""

import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from mercator_design.show.study.boxes import box, chart_of_realities, moved_aside
from mercator_design.show.study.folder import write_study
from mercator_design.show.study.tables import latex
from mercator_design.show.study.verdicts import (
    correlation_sentence,
    drop_sentence,
    headlines,
    order_sentences,
    pair_sentence,
    pooled_sentence,
    power_sentence,
    ranks_sentence,
    score_sentences,
    unit_sentence,
)
from mercator_design.studies.analysis import analysed
from mercator_design.studies.statistics.rank_tests import van_elteren
from tests.studies.tables import run_rows, study_table

GOOD, BAD = [5, 6, 7, 8, 9], [1, 2, 3, 4, 4.5]
TWO = {("up", "a"): GOOD, ("up", "b"): BAD, ("same", "a"): BAD, ("same", "b"): [x + 0.1 for x in BAD]}
NASTY = "<script>alert(1)</script>\u202e_%&"


def of(scores, **others):
    return analysed(study_table(run_rows(scores), **others))


def test_a_pair_is_told_with_the_better_one_first():
    results = of({("up", "a"): BAD, ("up", "b"): GOOD})
    assert [*headlines(results)] == [
        "up: b is better than a (A = 1.00 (1.00 to 1.00), medians 7 and 3, p = 0.0079).",
    ]
    same = of({("same", "a"): BAD, ("same", "b"): [x + 0.1 for x in BAD]})
    assert "a is not distinguishable from b (A = 0.4" in pair_sentence(same.table, same.findings.pairs[0])
    costs = of({("m", "a"): BAD, ("m", "b"): GOOD}, maximise=False)
    assert pair_sentence(costs.table, costs.findings.pairs[0]).startswith("m: a is better than b (A = 1.00")


def test_missions_are_pooled_in_a_sentence():
    results = of(TWO)
    text = pooled_sentence(results.table, results.findings.pooled[0])
    assert text.startswith("Over 2 missions, a is ")
    assert text.endswith("better on 1 (up), worse on 0, not distinguishable on 1.")
    turned = of({(m, {"a": "b", "b": "a"}[k]): scores for (m, k), scores in (TWO | {("same", "a"): GOOD}).items()})
    text = pooled_sentence(turned.table, turned.findings.pooled[0])
    assert text.startswith("Over 2 missions, b is better than a (van Elteren's test, p < 0.001; mean A 1.00)")


def test_three_are_ranked_in_a_sentence():
    three = {("up", "c"): [9.5] * 5, ("same", "c"): [9.5] * 5}
    results = of(TWO | three)
    text = ranks_sentence(results.table, results.findings.ranks[0])
    assert text.startswith("Mean ranks over 10 repetitions on missions: c 1.00, ")
    assert "c before b" in text
    alike = of({("m", level): BAD for level in "abc"})
    assert ranks_sentence(alike.table, alike.findings.ranks[0]).endswith("no difference is shown.")


def test_what_the_number_of_designs_can_show_is_said():
    assert "5 designs of each show a difference of" in power_sentence(of(TWO).findings)
    few = power_sentence(of({("up", "a"): GOOD[:3], ("up", "b"): BAD[:3]}).findings)
    assert "3 designs of each are too few" in few
    assert "at least 4 of each are needed" in few
    assert "together" not in few
    assert "missions together shows smaller ones" in power_sentence(of(TWO).findings)
    assert "too few designs to compare" in power_sentence(of({("up", "a"): [1], ("up", "b"): [2]}).findings)


FEW = "; no difference can be significant with so few designs."


def few(n, levels="ab", missions=("up",)):
    """n designs of each level, which differ as much as they can."""
    return of({(mission, level): GOOD[:n] if level == "a" else BAD[:n] for mission in missions for level in levels})


def test_verdicts_say_if_no_difference_can_be_significant():
    assert [*headlines(few(3))] == [
        f"up: a is not distinguishable from b (A = 1.00 (1.00 to 1.00), medians 6 and 2, p = 0.1){FEW}"
    ]
    assert next(headlines(few(4))).startswith("up: a is better than b")
    assert "so few" not in "".join(headlines(few(4)))
    alike = of({("up", "a"): BAD, ("up", "b"): BAD})
    assert "so few" not in "".join(headlines(alike))


def test_more_tests_need_more_designs():
    assert "so few" not in "".join(headlines(few(4)))
    three = few(4, "abc")
    assert all(pair_sentence(three.table, pair).endswith(FEW) for pair in three.findings.pairs)
    pooled = few(2, "abc", ("up", "down"))
    assert all(pooled_sentence(pooled.table, one).endswith(FEW) for one in pooled.findings.pooled)
    assert not pooled_sentence(pooled.table, few(2, "ab", ("up", "down")).findings.pooled[0]).endswith(FEW)
    assert ranks_sentence(three.table, few(2, "abc").findings.ranks[0]).endswith("is shown; none can be by so few.")
    assert "none can be" not in ranks_sentence(three.table, three.findings.ranks[0])


def test_a_pair_of_many_designs_may_differ_beside_one_of_few():
    """The correction of a pair counts the pairs that may have lower p-values."""
    results = of({("few", "a"): GOOD[:2], ("few", "b"): BAD[:2], ("many", "a"): range(9, 18), ("many", "b"): range(9)})
    assert [pair.least_p for pair in results.findings.pairs] == [1 / 3, 4 / 48620]
    assert results.findings.pairs[1].p_holm == results.findings.pairs[1].least_p


def test_what_cannot_be_compared_is_said():
    one = of({("up", "a"): GOOD})
    assert [*headlines(one)] == ["up: a has a median score of 7 (6 to 8), of 5 designs."]
    assert power_sentence(one.findings) == "All designs are of a: nothing is compared."
    lone = of({("up", "a"): GOOD, ("up", "b"): BAD, ("up", "hand"): [3]})
    assert [*headlines(lone)][-1].startswith("hand has one design: it is drawn, but not tested")


def test_the_loss_of_one_design_has_no_test():
    rows = run_rows({("up", "a"): [5]}) + run_rows({("up", "a"): [4]}, reality="x")
    found = analysed(study_table(rows))
    said = drop_sentence(found.table, found.gap.drops[0])
    assert said == "up: in x, the loss of the one design of a is 1 (20% of its score)."


def test_a_loss_of_few_designs_is_said_to_have_no_significance():
    rows = run_rows({("up", "a"): BAD}) + run_rows({("up", "a"): [0, 1, 2, 3, 3.5]}, reality="x")
    found = analysed(study_table(rows))
    assert drop_sentence(found.table, found.gap.drops[0]).endswith(f"; p = 0.062{FEW}")


def test_the_unit_is_said():
    text = unit_sentence(study_table(run_rows({("m", "a"): [[1, 2, 3], [2, 3, 4]]})))
    assert text.startswith("The unit is the design: each is one point, the mean score of 3 runs")
    assert "pseudo-replication" in text


def test_levels_that_are_numbers_are_named():
    rows = run_rows({("m", "a"): GOOD}) + run_rows({("m", "a"): BAD}, budget=50)
    results = analysed(study_table(rows, by="budget"))
    assert next(headlines(results)).startswith("m: budget 500 is better than budget 50")


def test_rank_inversions_are_said():
    there = {("up", "a"): [x / 10 for x in GOOD], ("up", "b"): BAD, ("same", "a"): BAD, ("same", "b"): BAD}
    results = analysed(study_table(run_rows(TWO) + run_rows(there, reality="field")))
    said = [*order_sentences(results.table, results.gap.orders)]
    assert said == [
        "Rank inversion: a is better than b in the design model, and worse in field, significantly on up.",
    ]
    little = {("up", "a"): GOOD[:3], ("up", "b"): BAD[:3]}
    there = {("up", "a"): BAD[:3], ("up", "b"): GOOD[:3]}
    results = analysed(study_table(run_rows(little) + run_rows(there, reality="field")))
    assert [*order_sentences(results.table, results.gap.orders)] == [
        "No rank inversion is significant in 1 comparison of two methods in two realities.",
        "Seen, but not significant in both: a is better than b in the design model, and worse in field, on up.",
    ]
    kept = analysed(study_table(run_rows(TWO) + run_rows(TWO, reality="field")))
    assert [*order_sentences(kept.table, kept.gap.orders)] == [
        "No rank inversion is significant in 2 comparisons of two methods in two realities.",
    ]


def test_a_correlation_says_on_how_many_missions_it_is():
    def said(*budgets):
        rows = [row for budget in budgets for row in run_rows(TWO, budget=budget)]
        rows += [row | {"reality": "field"} for row in rows]
        return correlation_sentence(analysed(study_table(rows)).gap.correlations, "field")

    start = "The order of designs in the design model and in field correlates with 1.00"
    assert said(500) == f"{start} to 1.00 on 2 missions (Spearman's rho)."
    assert said(50, 500) == f"{start} to 1.00 on 2 missions in 4 settings (Spearman's rho)."


def test_latex_shows_any_text():
    assert latex(r"50 % of a_b & c\d {x} ~^#$") == (
        r"50 \% of a\_b \& c\textbackslash{}d \{x\} \textasciitilde{}\textasciicircum{}\#\$"
    )
    assert latex('a<b|c>"d" a-b---c') == r"a\textless{}b\textbar{}c\textgreater{}''d'' a-b-{}-{}-c"


def test_no_name_in_latex_belongs_to_the_end_of_the_row_before(tmp_path):
    """After the end of a row, a bracket begins a distance, and a star forbids a new page."""
    scores = {(name, level): GOOD for name in ("[up]", "*") for level in ("[a", "*b")}
    write_study(tmp_path, study_table(run_rows(scores)), "x")
    for name in ("scores", "comparisons"):
        text = (tmp_path / "tables" / f"{name}.tex").read_text()
        assert text.count("{[}up]}") == text.count("{{*}}") == 1
        assert not re.search(r"\\\\\s*[\[*]", text)


class Tags(HTMLParser):
    """Open elements at the end, and all names."""

    VOID = ("meta", "br", "path", "circle", "rect")

    def __init__(self):
        super().__init__()
        self.open, self.names = [], set()

    def handle_starttag(self, tag, attributes):
        self.names.add(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    random = np.random.default_rng(1)
    scores = {
        (mission, level): [random.normal(k, 1.0, 4).clip(0, 4) for _ in range(5)]
        for mission in ("up", NASTY)
        for k, level in enumerate(("a", NASTY, "c"))
    }
    rows = run_rows(scores) + run_rows(scores, reality="field")
    table = study_table(rows, limits=(0.0, 4.0))
    path = tmp_path_factory.mktemp("study") / "new"
    return path, write_study(path, table, "mdesign study report new")


def test_the_page_is_well_formed_and_shows_names_as_text(folder):
    page = (folder[0] / "report.html").read_text()
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert "alert(1)</script>" not in page
    assert "\u202e" not in page
    for name in ("answer", "scores", "ranks", "comparisons", "gap", "files"):
        assert f'<section id="{name}">' in page
    assert "mdesign study report new" in page
    assert len(re.findall(r"<svg", page)) == 2 + 1 + 2  # missions, ranks, missions in both realities
    assert "pseudo-replication" in page
    assert "Unfinished" not in page


def test_the_tables_have_all_that_was_found(folder):
    path, results = folder
    runs = pd.read_csv(path / "tables" / "runs.csv")
    assert len(runs) == len(results.table.runs) == 2 * 2 * 3 * 5 * 4
    designs = pd.read_csv(path / "tables" / "designs.csv")
    assert designs.score.tolist() == pytest.approx(results.table.designs.score.tolist(), rel=1e-12)
    compared = pd.read_csv(path / "tables" / "comparisons.csv")
    model, there = (compared[compared.reality == name] for name in ("design", "field"))
    assert model.p_holm.tolist() == pytest.approx([pair.p_holm for pair in results.findings.pairs])
    assert there.a.tolist() == pytest.approx([order.there.a.value for order in results.gap.orders])
    assert len(there) == 6
    page = (path / "report.html").read_text()
    shown = re.search('<table data-table="comparisons">.*?</table>', page)[0]
    assert shown.count("<td>field</td>") == shown.count("<td>the design model</td>") == 6
    data = json.loads((path / "tables" / "study.json").read_text())
    assert [one["p"] for one in data["pairs"]] == [pair.p_value for pair in results.findings.pairs]
    assert data["answer"] == [*headlines(results)]
    assert len(data["reality_gap"]["orders"]) == 6


def test_latex_tables_have_cells_for_all_columns(folder):
    for name, n_rows in (("scores", 3), ("comparisons", 3)):
        text = (folder[0] / "tables" / f"{name}.tex").read_text()
        columns = re.search(r"\\begin\{tabular\}\{@\{\}([lr]+)@\{\}\}", text)[1]
        cells = [line for line in text.splitlines() if line.endswith(r" \\")]
        titles = [line for line in cells if line.startswith(f"\\multicolumn{{{len(columns)}}}")]
        assert sum("in field" in line for line in titles) == sum("in the design model" in line for line in titles) == 2
        assert len(cells) == 1 + len(titles) * (1 + n_rows)
        assert {len(re.split(r"(?<!\\)&", line)) for line in cells if line not in titles} == {len(columns)}


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs pdflatex")
@pytest.mark.thorough
def test_latex_tables_and_figures_fit_a_column_of_two(tmp_path):
    scores = {
        (mission, level): GOOD for mission in ("aggregation", "foraging") for level in ("halving", "irace", "tpe")
    }
    write_study(tmp_path, study_table(run_rows(scores) + run_rows(scores, reality="mercator-pseudo-reality")), "x")
    lines = [r"\documentclass[twocolumn]{article}\usepackage{booktabs,graphicx}\begin{document}"]
    lines += [rf"\noindent\input{{tables/{name}.tex}}" + "\n" for name in ("scores", "comparisons")]
    lines += [rf"\noindent\includegraphics{{figures/{name}.pdf}}" + "\n" for name in ("scores", "gap", "ranks")]
    (tmp_path / "paper.tex").write_text("\n".join([*lines, r"\end{document}"]))
    ran = subprocess.run(
        [shutil.which("pdflatex"), "-interaction=nonstopmode", "paper.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Overfull" not in ran.stdout


def test_boxes_of_the_page_are_those_of_the_figures_turned():
    """Whiskers to the extremes, a bold median, hollow points elsewhere; few designs have no box."""
    few = run_rows({("up", "a"): GOOD, ("up", "b"): BAD[:4]})
    table = study_table(few + run_rows({("up", "a"): BAD}, reality="field"))
    drawn = re.findall(r'<g data-name="(.+?)".*?</title>(.*?)</g>', chart_of_realities(table, "up"))
    assert [name for name, _ in drawn] == ["a, the design model", "a, field", "b, the design model"]
    for (_, row), n_designs, is_boxed, fill in zip(
        drawn, (5, 5, 4), (True, True, False), ("var(--k0)", "none", "var(--k1)"), strict=True
    ):
        *box, median = re.findall(r'<path d="(.+?)"', row)
        points = [float(x) for x in re.findall(r'<circle cx="([\d.]+)"', row)]
        assert len(points) == n_designs
        assert len(box) == is_boxed
        assert float(re.match(r"M([\d.]+)", median)[1]) == pytest.approx(np.median(points), abs=0.1)
        assert set(re.findall(r'<circle [^>]*? fill="(.+?)"', row)) == {fill}
        if is_boxed:
            across = [float(x) for x in re.findall(r"[MHL]([\d.]+)", box[0])]
            assert (min(across), max(across)) == (min(points), max(points))


def test_few_designs_and_ranks_have_no_notch_and_points_are_centred():
    some = np.arange(10.0)
    assert box("a", some, 0).low < box("a", some, 0).middle
    assert box("a", some[:9], 0).low == box("a", some[:9], 0).middle == 4.0
    assert box("a", some, 0, has_notch=False).low == 4.5
    for n in (1, 2, 3, 5, 8):
        assert moved_aside(some[:n]).mean() == pytest.approx(0.0, abs=1e-12)


def test_figures_have_the_width_of_a_column(folder):
    for name in ("scores", "ranks", "gap"):
        with Image.open(io.BytesIO((folder[0] / "figures" / f"{name}.png").read_bytes())) as picture:
            assert picture.size[0] == pytest.approx(80 / 25.4 * 300, abs=1)
        pdf = (folder[0] / "figures" / f"{name}.pdf").read_bytes()
        width = float(re.search(rb"/MediaBox \[ ?0 0 ([\d.]+)", pdf)[1])
        assert width == pytest.approx(80 / 25.4 * 72, abs=0.1)
        assert b"/Type3" not in pdf


def test_the_same_study_gives_the_same_files(folder, tmp_path):
    path, results = folder
    write_study(tmp_path, results.table, "mdesign study report new")
    for file in path.rglob("*.*"):
        assert (tmp_path / file.relative_to(path)).read_bytes() == file.read_bytes(), file.name


def test_a_study_of_one_method_has_a_page_and_says_that_nothing_is_compared(tmp_path):
    write_study(tmp_path, study_table(run_rows({("m", "a"): [1, 2]})), "mdesign study report x")
    page = (tmp_path / "report.html").read_text()
    assert "All designs are of a: nothing is compared." in page
    assert "Not compared" not in page
    assert '<section id="comparisons">' not in page


def test_many_missions_have_several_figures(tmp_path):
    scores = {(f"m{k}", level): [1, 2] for k in range(13) for level in "ab"}
    write_study(tmp_path, study_table(run_rows(scores)), "x")
    assert {file.name for file in (tmp_path / "figures").glob("scores*.pdf")} == {"scores-1.pdf", "scores-2.pdf"}


def test_the_pooled_test_sees_from_how_many_designs_on():
    """Three missions show together with three designs of each what none of them can show alone."""
    three = {(m, level): scores for m in "xyz" for level, scores in (("a", GOOD[:3]), ("b", BAD[:3]))}
    findings = of(three).findings
    assert findings.pooled[0].outcome == "better than"
    assert "test of 3 missions together" in power_sentence(findings)
    assert "it can be significant from 2 designs of each on" in power_sentence(findings)
    apart = [(np.array([2.0, 3.0]), np.array([0.0, 1.0]))]
    assert van_elteren(apart * 3) < 0.05 < van_elteren(apart)


def test_scores_are_told_of_every_method():
    text = [*score_sentences(of(TWO).table)]
    assert len(text) == 4
    assert text[0] == "up: a has a median score of 7 (6 to 8), of 5 designs."
