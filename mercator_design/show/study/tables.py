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
    place_of,
    pooled_sentence,
    power_sentence,
    ranks_sentence,
    share_text,
    unit_sentence,
)
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import PairOnMission
from mercator_design.studies.statistics.effects import Effect
from mercator_design.studies.table import Block, StudyTable
from mercator_design.system.csv_text import csv_text

_MAX_TITLE = 40
"""Letters of a line of a LaTeX table that have space in a column."""
_LATEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''", "`": r"\textasciigrave{}",
    "'": r"\textquotesingle{}", "[": "{[}", "*": "{*}",  # the last two would belong to the end of the row before
} | {letter: f"\\{letter}" for letter in "&%$#_{}"}  # fmt: skip


def score_table(table: StudyTable) -> tuple[list[str], list[list[str]]]:
    """The head, and a row for each block in each reality: median (quartiles) [designs] of each level."""
    rows = [
        [block.name, place_of(reality), *(_quartiles(block, level) for level in table.levels)]
        for block, reality in _blocks_everywhere(table)
    ]
    return _if_several(table, ["mission", "reality", *(named(table, level) for level in table.levels)], rows)


def _blocks_everywhere(table: StudyTable) -> list[tuple[Block, str]]:
    """The blocks of all realities; those of a name are neighbours."""
    found = [(block, reality) for reality in table.realities for block in table.blocks(reality)]
    order = {name: k for k, name in enumerate(dict.fromkeys(block.name for block, _ in found))}
    return sorted(found, key=lambda one: order[one[0].name])


def _if_several(table: StudyTable, head: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """A table without its column of realities, the second one, if there is one reality."""
    if len(table.realities) > 1:
        return head, rows
    return [head[0], *head[2:]], [[row[0], *row[2:]] for row in rows]


def _quartiles(block: Block, level: str) -> str:
    if level not in block.scores:
        return ""
    low, middle, high = np.percentile(block.scores[level].to_numpy(float), [25, 50, 75])
    return f"{number(middle)} ({number(low)} to {number(high)}) [{len(block.scores[level])}]"


def pairs_everywhere(results: StudyResults) -> list[tuple[PairOnMission, str]]:
    """Each pair on each mission in the design model, followed by the same pair in the other realities."""
    found = [(pair, results.findings.reality) for pair in results.findings.pairs]
    found += [(order.there, order.reality) for order in results.gap.orders]
    order = {key: k for k, key in enumerate(dict.fromkeys(_key(pair) for pair, _ in found))}
    return sorted(found, key=lambda one: order[_key(one[0])])


def _key(pair: PairOnMission) -> tuple[str, str, str]:
    return pair.block.name, pair.first, pair.second


def comparison_table(results: StudyResults) -> tuple[list[str], list[list[str]]]:
    """The head, and a row for each pair on each mission in each reality."""
    table = results.table
    head = ["mission", "reality", "first", "is", "second", "A", "medians differ", "means differ", "p (Holm)", "p"]
    rows = [
        [
            pair.block.name,
            place_of(reality),
            named(table, pair.first),
            pair.outcome.removesuffix(" than").removesuffix(" from"),
            named(table, pair.second),
            share_text(pair.a),
            around(pair.medians),
            around(pair.means),
            _p(pair.p_holm),
            _p(pair.p_value),
            "" if pair.p_paired is None else _p(pair.p_paired),
        ]
        for pair, reality in pairs_everywhere(results)
    ]
    return _if_several(table, [*head, "paired p"], rows)


def _p(value: float) -> str:
    return p_text(value).removeprefix("p = ").removeprefix("p ")


def comparisons_csv(results: StudyResults) -> str:
    """All comparisons in all realities with all digits; `p_holm` is corrected in each reality by itself."""
    effects = [
        f"{name}{end}" for name in ("a", "median_difference", "mean_difference") for end in ("", "_low", "_high")
    ]
    head = ["mission", "objective", "setting", "reality", "first", "second", "n_first", "n_second", *effects]
    rows = [
        [
            pair.block.mission,
            pair.block.objective,
            pair.block.setting,
            reality,
            pair.first,
            pair.second,
            *pair.sizes,
            *(limit for effect in (pair.a, pair.medians, pair.means) for limit in effect),
            pair.p_value,
            pair.p_holm,
            pair.p_paired,
            pair.outcome,
        ]
        for pair, reality in pairs_everywhere(results)
    ]
    return csv_text([[*head, "p", "p_holm", "p_paired", "first_is"], *rows])


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


def scores_latex(table: StudyTable) -> str:
    """Medians and quartiles: a row for each level, below a line for each block and reality."""
    groups = []
    for block, reality in _blocks_everywhere(table):
        rows = []
        for level, scores in block.scores.items():
            low, middle, high = (_minus(number(one)) for one in np.percentile(scores.to_numpy(float), [25, 50, 75]))
            rows.append([latex(named(table, level)), middle, f"{low} to {high}", str(len(scores))])
        groups.append((_title(table, block, reality), rows))
    about = "Medians of the designs' mean scores, with quartiles."
    return _tabular(about, [latex(table.by.replace("_", " ")), "median", "quartiles", "designs"], groups)


def comparisons_latex(results: StudyResults) -> str:
    """A-measures with intervals and p-values of all realities; bold where the difference is significant."""
    table = results.table
    groups: dict[str, list[list[str]]] = {_title(table, *one): [] for one in _blocks_everywhere(table)}
    for pair, reality in pairs_everywhere(results):
        p = "$<0.001$" if pair.p_holm < 0.001 else f"{pair.p_holm:.2g}"
        effect = share_text(pair.a)
        bold = pair.outcome != "not distinguishable from"
        names = [latex(named(table, level)) for level in (pair.first, pair.second)]
        groups[_title(table, pair.block, reality)].append([*names, f"\\textbf{{{effect}}}" if bold else effect, p])
    about = (
        "A: the probability that a design of the first is better (Vargha and Delaney), with its bootstrap interval at "
        "95 %; bold if p < 0.05. p: Wilcoxon's rank-sum test with Holm's correction, in each reality by itself."
    )
    return _tabular(about, ["first", "second", "$A$", "$p$ (Holm)"], [one for one in groups.items() if one[1]])


def _title(table: StudyTable, block: Block, reality: str) -> str:
    """A block with its reality, if there are several."""
    return latex(block.name + f", in {place_of(reality)}" * (len(table.realities) > 1))


def _tabular(about: str, head: Sequence[str], groups: Iterable[tuple[str, Sequence[Sequence[str]]]]) -> str:
    """A table for one column of a page in two: a line for each group, and its rows below."""
    rows = []
    for title, own in groups:
        across = "l" if len(title) <= _MAX_TITLE else r"p{\linewidth}"
        rows.append(f"\\multicolumn{{{len(head)}}}{{@{{}}{across}@{{}}}}{{\\emph{{{title}}}}} \\\\")
        rows += [" & ".join(row) + r" \\" for row in own]
    lines = [
        f"% {about}",
        r"% \usepackage{booktabs}; it fits one column of two, if names are not long; else use table*.",
        r"\begingroup\small\setlength{\tabcolsep}{4pt}%",
        r"\begin{tabular}{@{}llrr@{}}",
        r"\toprule",
        " & ".join(head) + r" \\",
        r"\midrule",
        *rows,
        r"\bottomrule",
        r"\end{tabular}",
        r"\endgroup",
    ]
    return "\n".join(lines) + "\n"
