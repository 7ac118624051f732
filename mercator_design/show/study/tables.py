"""The tables of a study: rows for pages, CSV, JSON, and LaTeX with booktabs."""

import json
import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from mercator_design.race.elimination.summary import ALPHA
from mercator_design.show.charts import number
from mercator_design.show.report.markup import p_text
from mercator_design.show.study.verdicts import (
    around,
    headlines,
    named,
    pair_sentence,
    pooled_sentence,
    power_sentence,
    ranks_sentence,
    share_text,
    unit_sentence,
)
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import Findings, PairOnMission
from mercator_design.studies.statistics.effects import Effect
from mercator_design.studies.table import Block, StudyTable
from mercator_design.system.csv_text import csv_text

COMPARISONS_HEAD = (
    "mission",
    "first",
    "second",
    "A",
    "difference of medians",
    "of means",
    "p (Holm)",
    "p",
    "paired p",
    "first is",
)
_LATEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''", "`": r"\textasciigrave{}",
    "'": r"\textquotesingle{}", "[": "{[}", "*": "{*}",  # the last two would belong to the end of the row before
} | {letter: f"\\{letter}" for letter in "&%$#_{}"}  # fmt: skip


def score_rows(table: StudyTable, blocks: Sequence[Block]) -> list[list[str]]:
    """A row for each block: median (quartiles) [designs] of each level."""
    return [[block.name, *(_quartiles(block, level) for level in table.levels)] for block in blocks]


def _quartiles(block: Block, level: str) -> str:
    if level not in block.scores:
        return ""
    low, middle, high = np.percentile(block.scores[level].to_numpy(float), [25, 50, 75])
    return f"{number(middle)} ({number(low)} to {number(high)}) [{len(block.scores[level])}]"


def comparison_rows(table: StudyTable, findings: Findings) -> list[list[str]]:
    """A row for each pair on each mission, with COMPARISONS_HEAD."""
    return [
        [
            pair.block.name,
            named(table, pair.first),
            named(table, pair.second),
            share_text(pair.a),
            around(pair.medians),
            around(pair.means),
            _p(pair.p_holm),
            _p(pair.p_value),
            "" if pair.p_paired is None else _p(pair.p_paired),
            pair.outcome.removesuffix(" than").removesuffix(" from"),
        ]
        for pair in findings.pairs
    ]


def _p(value: float) -> str:
    return p_text(value).removeprefix("p = ").removeprefix("p ")


def comparisons_csv(findings: Findings) -> str:
    """All comparisons with all digits."""
    effects = [
        f"{name}{end}" for name in ("a", "median_difference", "mean_difference") for end in ("", "_low", "_high")
    ]
    head = [
        "mission",
        "objective",
        "setting",
        "first",
        "second",
        "n_first",
        "n_second",
        *effects,
        "p",
        "p_holm",
        "p_paired",
        "first_is",
    ]
    rows = [
        [
            pair.block.mission,
            pair.block.objective,
            pair.block.setting,
            pair.first,
            pair.second,
            len(pair.block.scores[pair.first]),
            len(pair.block.scores[pair.second]),
            *(limit for effect in (pair.a, pair.medians, pair.means) for limit in effect),
            pair.p_value,
            pair.p_holm,
            pair.p_paired,
            pair.outcome,
        ]
        for pair in findings.pairs
    ]
    return csv_text([head, *rows])


def study_json(results: StudyResults) -> str:
    """All findings; infinite numbers and intervals that are not known are null."""
    table, findings, gap = results.table, results.findings, results.gap
    data = {
        "name": table.name,
        "compared": table.by,
        "levels": table.levels,
        "missions": table.missions,
        "reality": findings.reality,
        "alpha": ALPHA,
        "unit": unit_sentence(table),
        **({"front_boxes": {mission: box._asdict() for mission, box in table.boxes.items()}} if table.boxes else {}),
        "answer": [*headlines(results)],
        "power": [{"designs_of_each": n, **found._asdict()} for n, found in findings.visible.items()],
        "power_verdict": power_sentence(findings),
        "pairs": [_pair_data(table, pair) for pair in findings.pairs],
        "pooled": [
            {
                "setting": one.setting,
                "first": one.first,
                "second": one.second,
                "missions": len(one.pairs),
                "mean_a": one.mean_a,
                "p": one.p_value,
                "p_holm": one.p_holm,
                "verdict": pooled_sentence(table, one),
            }
            for one in findings.pooled
        ],
        "ranks": [
            {
                "setting": one.setting,
                "blocks": f"{one.ranked.n_blocks} {one.what}",
                "mean_ranks": dict(zip(one.levels, one.ranked.mean_ranks.tolist(), strict=True)),
                "friedman": {"statistic": one.ranked.statistic, "p": one.ranked.p_value},
                "nemenyi": {"critical_distance": one.ranked.distance, "p": one.ranked.p_values.tolist()},
                "verdict": ranks_sentence(table, one),
            }
            for one in findings.ranks
        ],
        "reality_gap": {
            "drops": [{**one._asdict(), "losses": one.losses.tolist(), "median": one.median} for one in gap.drops],
            "compared": [{**one._asdict(), "more": _effect(one.more)} for one in gap.compared],
            "orders": [
                {
                    "mission": one.model.block.name,
                    "reality": one.reality,
                    "first": one.model.first,
                    "second": one.model.second,
                    "a_in_design_model": one.model.a.value,
                    "a_there": one.there.a.value,
                    "p_holm_in_design_model": one.model.p_holm,
                    "p_holm_there": one.there.p_holm,
                    "order": one.change,
                }
                for one in gap.orders
            ],
            "correlations": [one._asdict() for one in gap.correlations],
        },
    }
    return json.dumps(_finite(data), indent=2, allow_nan=False)


def _pair_data(table: StudyTable, pair: PairOnMission) -> dict[str, Any]:
    return {
        "mission": pair.block.mission,
        "objective": pair.block.objective,
        "setting": pair.block.setting,
        "first": pair.first,
        "second": pair.second,
        "a": _effect(pair.a),
        "difference_of_medians": _effect(pair.medians),
        "difference_of_means": _effect(pair.means),
        "p": pair.p_value,
        "p_holm": pair.p_holm,
        "p_paired": pair.p_paired,
        "first_is": pair.outcome,
        "verdict": pair_sentence(table, pair),
    }


def _effect(effect: Effect) -> dict[str, float | None]:
    return effect._asdict()


def _finite(data: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def latex(text: str) -> str:
    """Text as LaTeX shows it."""
    shown = "".join(_LATEX.get(letter, letter) for letter in text)
    return re.sub("-(?=-)", "-{}", shown)  # no dashes


def _minus(numbers: str) -> str:
    """Numbers with the sign that LaTeX sets before them."""
    return numbers.replace("-", "$-$")


def scores_latex(table: StudyTable, blocks: Sequence[Block]) -> str:
    """Medians with quartiles, a row for each mission."""
    rows = [
        [latex(block.name), *(_minus(_quartiles(block, level).split(" [")[0]) for level in table.levels)]
        for block in blocks
    ]
    head = ["mission", *(latex(named(table, level)) for level in table.levels)]
    about = "Medians of the designs' mean scores, with quartiles."
    return _tabular(about, head, rows, "l" + "r" * len(table.levels))


def comparisons_latex(table: StudyTable, findings: Findings) -> str:
    """A-measures with intervals and p-values; bold where the difference is significant."""
    rows = []
    for pair in findings.pairs:
        p = "$<0.001$" if pair.p_holm < 0.001 else f"{pair.p_holm:.2g}"
        effect, medians = share_text(pair.a), _minus(around(pair.medians))
        bold = pair.outcome != "not distinguishable from"
        names = [latex(text) for text in (pair.block.name, named(table, pair.first), named(table, pair.second))]
        rows.append([*names, f"\\textbf{{{effect}}}" if bold else effect, medians, p])
    about = (
        "A: the probability that a design of the first is better (Vargha and Delaney), with its bootstrap interval at "
        "95 %; bold if p < 0.05. p: Wilcoxon's rank-sum test with Holm's correction."
    )
    head = ["mission", "first", "second", "$A$", "difference of medians", "$p$ (Holm)"]
    return _tabular(about, head, rows, "lllrrr")


def _tabular(about: str, head: Sequence[str], rows: Iterable[Sequence[str]], columns: str) -> str:
    lines = [
        f"% {about}",
        r"% \usepackage{booktabs}",
        f"\\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        " & ".join(head) + r" \\",
        r"\midrule",
        *(" & ".join(row) + r" \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"
