"""The page of a study: verdicts, boxes, tests, the reality gap, in one HTML file that makes no request."""

from collections.abc import Sequence

from mercator_design.errors import excerpt
from mercator_design.race.elimination.summary import ALPHA
from mercator_design.show.charts import STYLE
from mercator_design.show.markup import escaped
from mercator_design.show.page import document
from mercator_design.show.report.markup import Html, contents, figure, folded, note, p_text, row_of, section, table
from mercator_design.show.report.page import asset
from mercator_design.show.study.boxes import BOXES, NOTCHES, chart_of_realities, chart_of_scores, charts_of_ranks
from mercator_design.show.study.tables import comparison_table, score_table
from mercator_design.show.study.verdicts import (
    around,
    correlation_sentence,
    drop_sentence,
    front_sentences,
    headlines,
    named,
    pair_sentence,
    pooled_sentence,
    power_sentence,
    ranks_sentence,
    unit_sentence,
)
from mercator_design.studies.analysis import StudyResults

_FRONTS = (
    "tables/fronts.csv",
    "every design of a front in each reality: mean score by each objective, its standard error",
)
_FILES = (
    ("tables/runs.csv", "every run, a row each (tidy)"),
    ("tables/designs.csv", "every design in each reality: mean score, its standard error, runs"),
    ("tables/comparisons.csv", "all comparisons in all realities: A, differences, intervals, p"),
    ("tables/study.json", "all findings"),
    ("tables/scores.tex, comparisons.tex", "tables for LaTeX, with booktabs"),
    ("figures/*.pdf, *.png", "figures of 80 mm, the width of a column"),
)


def study_page(results: StudyResults, command: str, what_was_run: str = "", unfinished: str = "") -> str:
    """The page of a study.

    Args:
        results: Its results.
        command: The command that makes the page.
        what_was_run: The section on its plan; empty if there is none.
        unfinished: The sentence on a study that is not done; empty if it is done.
    """
    body = "".join(
        [
            _answer(results, unfinished),
            _scores(results),
            _ranks(results),
            _comparisons(results),
            _gap(results),
            what_was_run,
            _files(results, command),
        ]
    )
    study, n = results.table, len(results.table.missions)
    levels = f"{len(study.levels)} {study.by.replace('_', ' ')}s on {n} mission{'s' * (n != 1)}"
    head = f'<p>{escaped(levels)}</p><nav class="toc">{contents(body)}</nav>'
    title = excerpt(study.name)
    whole = f'<header class="top"><h1><bdi>{escaped(title)}</bdi></h1>{head}</header>\n<main>{body}</main>'
    return document(f"{title}: a study", f"{STYLE}{asset('page.css')}", whole, asset("page.js"))


def _listed(sentences: Sequence[str]) -> Html:
    return Html(f"<ul>{''.join(f'<li>{escaped(one)}</li>' for one in sentences)}</ul>" if sentences else "")


def _answer(results: StudyResults, unfinished: str) -> Html:
    findings = results.findings
    alone = f"Not compared, as fewer than two have two designs: {', '.join(findings.alone)}." * bool(findings.alone)
    return section(
        "answer",
        "Answer",
        Html(f"<p><strong>{escaped(unfinished)}</strong></p>") if unfinished else "",
        _listed([*headlines(results)]),
        note(unit_sentence(results.table)),
        note(power_sentence(findings)),
        note(alone) if alone else "",
    )


def _scores(results: StudyResults) -> Html:
    blocks = results.table.blocks(results.findings.reality)
    charts = [figure(chart_of_scores(results.table, block), "") for block in blocks]
    return section(
        "scores",
        "Designs on each mission",
        row_of(*charts),
        *map(note, front_sentences(results.table)),
        note(BOXES, NOTCHES),
        folded("As a table: median (quartiles) [designs]", table(*score_table(results.table), name="scores")),
    )


def _ranks(results: StudyResults) -> Html:
    charts = charts_of_ranks(results)
    about = (
        "The rank of each design among all designs of its mission and setting: 0 is the best, 1 the worst, equal ones "
        "have their mean. A design by hand that is compared at several budgets has the mean of its ranks. "
        "Boxes as above, without notches."
    )
    drawn = [Html(f'<div class="narrow">{figure(chart, "")}</div>') for chart in charts]
    return section(
        "ranks",
        "By ranks",
        *drawn,
        note(about),
        _listed([ranks_sentence(results.table, one) for one in results.findings.ranks]),
    )


def _comparisons(results: StudyResults) -> Html:
    study, findings = results.table, results.findings
    if not findings.pairs:
        return Html()
    each = ", in each reality by itself" * (len(study.realities) > 1)
    about = (
        "A: of the pairs of designs, the share in which the first is better (Vargha and Delaney; 0.5: no difference). "
        "Differences are the first's score minus the second's. Intervals: bootstrap at 95 %. p: Wilcoxon's rank-sum "
        f"test, corrected by Holm for all {len(findings.pairs)} comparisons{each}; paired p: Wilcoxon's signed-rank "
        f"test of designs of equal seeds, not corrected. Verdicts are at {ALPHA:.0%} by the corrected p. Over "
        "missions: van Elteren's test."
    )
    return section(
        "comparisons",
        "Comparisons",
        _listed([pooled_sentence(study, one) for one in findings.pooled]),
        _listed([pair_sentence(study, one) for one in findings.pairs]),
        table(*comparison_table(results), name="comparisons"),
        note(about),
    )


def _gap(results: StudyResults) -> Html:
    study, gap = results.table, results.gap
    others = study.realities[1:]
    if not others:
        return Html()
    there = {block.name for reality in others for block in study.blocks(reality)}
    names = [block.name for block in study.blocks(results.findings.reality) if block.name in there]
    charts = [figure(chart_of_realities(study, name), "") for name in names]
    said = [text for text in headlines(results) if "inversion" in text]
    said += [text for reality in others if (text := correlation_sentence(gap.correlations, reality))]
    rows = [
        (
            one.block,
            one.reality,
            f"{named(study, one.first)} minus {named(study, one.second)}",
            around(one.more),
            p_text(one.p_value),
        )
        for one in gap.compared
    ]
    known = [
        (one.block, one.reality, one.n_designs, "" if one.rho is None else f"{one.rho:.2f}") for one in gap.correlations
    ]
    about = (
        "The same designs in the model in which they were made, and in others. Losses are tested by the signed-rank "
        "test, differences of losses by the rank-sum test, both with Holm's correction; a design by hand counts once. "
        "A rank inversion is significant if both differences are, in the design model and in the other reality."
    )
    return section(
        "gap",
        "Reality gap",
        _listed(said),
        row_of(*charts),
        note(about),
        _listed([drop_sentence(study, one) for one in gap.drops]),
        table(("mission", "reality", "median loss", "difference", "p (Holm)"), rows, name="losses") if rows else "",
        table(("mission", "reality", "designs", "Spearman's rho"), known, name="correlations") if known else "",
    )


def _files(results: StudyResults, command: str) -> Html:
    files = (*_FILES[:2], _FRONTS, *_FILES[2:]) if results.table.boxes else _FILES
    return section("files", "Files", table(("file", "contents"), files, name="files"), command=command)
