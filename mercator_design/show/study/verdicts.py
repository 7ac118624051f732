"""The findings of a study in sentences: one for each comparison, and what their number of designs can show."""

import math
from collections.abc import Iterator, Sequence

from mercator_design.race.elimination.summary import ALPHA
from mercator_design.show.charts import number
from mercator_design.show.report.markup import p_text
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.reading import StudyStatus
from mercator_design.studies.statistics.comparison import (
    REPETITIONS,
    AllByRanks,
    Findings,
    PairOnMission,
    PairPooled,
)
from mercator_design.studies.statistics.effects import Effect, mirrored
from mercator_design.studies.statistics.fronts import BEYOND, HYPERVOLUME
from mercator_design.studies.statistics.power import POWER, designs_needed
from mercator_design.studies.statistics.reality_gap import Correlation, Drop, Order
from mercator_design.studies.table import DESIGN_MODEL, StudyTable

_TOO_FEW = "; no difference can be significant with so few designs"
_KINDS = {"budget": "budget ", "robot_model": "robot model ", "flavour": "flavour "}


def named(table: StudyTable, level: str) -> str:
    """A level in words: a budget is a number only in its column."""
    return f"{_KINDS.get(table.by, '')}{level}"


def place_of(reality: str) -> str:
    """A reality in words that follow `in`."""
    return "the design model" if reality == DESIGN_MODEL else reality


def around(effect: Effect) -> str:
    """A value with its interval, with the digits that the interval leaves certain and one more."""
    if effect.low is None or effect.high is None:
        return number(effect.value)
    width = effect.high - effect.low
    digits = 1 - math.floor(math.log10(width)) if width > 0 else 6
    value, low, high = (round(one, digits) for one in (effect.value, effect.low, effect.high))
    return f"{number(value)} ({number(low)} to {number(high)})"


def unfinished_sentence(status: StudyStatus) -> str:
    """The sentence on a study that is not done, with the number of designs that have results; empty if it is done."""
    return "" if status.is_done else f"Unfinished: of {status.counts['done']} of {len(status.cells)} designs."


def unit_sentence(table: StudyTable) -> str:
    """What is counted as evidence."""
    runs = sorted(set(table.designs["runs"].tolist()))
    of = f"{runs[0]}" if len(runs) == 1 else f"{runs[0]} to {runs[-1]}"
    return (
        f"The unit is the design: each is one point, the mean score of {of} run{'s' * (runs[-1] != 1)} on fresh "
        "instances. Runs of one design tell how well it was measured, not how good the method is that made it. To "
        "count them as evidence on methods would be pseudo-replication."
        + f" By the {HYPERVOLUME}, the unit is the front of a race."
        * bool(table.boxes)
    )


def front_sentences(table: StudyTable) -> Iterator[str]:
    """What hypervolumes are measured by: a sentence for each mission with fronts."""
    for mission, box in table.boxes.items():
        best, reference = (", ".join(f"{name} {number(one)}" for name, one in point.items()) for point in box)
        yield (
            f"{mission}, {HYPERVOLUME}: the share of a box that the front of a race dominates, by means on fresh "
            f"instances. The box reaches from the best of all fronts ({best}) to the reference point ({reference}): "
            f"beyond the worst of all fronts by {BEYOND:.0%} of the range. All fronts of this mission have one "
            "box, in all realities; another study has another."
        )


def power_sentence(findings: Findings) -> str:
    """What the numbers of designs can show; a sentence for each number, if pairs have different ones."""
    tests = len(findings.pairs)
    if len(findings.levels) == 1:
        return f"All designs are of {findings.levels[0]}: nothing is compared."
    if not tests:
        return (
            "There are too few designs to compare: at least two of each are needed, by races with different seeds or "
            "in files of their own."
        )
    level = f"at {ALPHA:.0%}" + (f" after Holm's correction for {tests} tests" if tests > 1 else "")
    said = []
    for n, found in findings.visible.items():
        if math.isinf(found.shift):
            said.append(
                f"On a single mission, {n} designs of each are too few: no difference, however large, can be "
                f"significant {level}; at least {designs_needed(tests)} of each are needed."
            )
        else:
            said.append(
                f"On a single mission, {n} designs of each show a difference of {found.shift:.2g} standard deviations "
                f"between designs (A = {found.a_measure:.2f}) with probability {POWER:.0%}, {level}."
            )
    said += [
        f"Van Elteren's test of {n} missions together shows smaller ones that missions have in common: it can be "
        f"significant from {designs_needed(len(findings.pooled), n)} designs of each on."
        for n in sorted({len(pooled.pairs) for pooled in findings.pooled})
    ]
    said.append("Smaller differences may exist, and often go unseen: not distinguishable does not mean equal.")
    return " ".join(said)


def share_text(effect: Effect) -> str:
    """An A-measure with its interval."""
    limits = "" if effect.low is None or effect.high is None else f" ({effect.low:.2f} to {effect.high:.2f})"
    return f"{effect.value:.2f}{limits}"


def pair_sentence(table: StudyTable, pair: PairOnMission) -> str:
    """The verdict on two levels on a mission; the better one is named first."""
    names, effect, outcome = (pair.first, pair.second), pair.a, pair.outcome
    if outcome == "worse than":
        names, effect, outcome = (pair.second, pair.first), mirrored(pair.a), "better than"
    medians = " and ".join(number(float(pair.block.scores[level].median())) for level in names)
    first, second = (named(table, level) for level in names)
    return (
        f"{pair.block.name}: {first} is {outcome} {second} (A = {share_text(effect)}, medians {medians}, "
        f"{p_text(pair.p_holm)}){_TOO_FEW * (pair.least_p >= ALPHA)}."
    )


def pooled_sentence(table: StudyTable, pooled: PairPooled) -> str:
    """The verdict on two levels over all missions of a setting."""
    first, second, mean_a, outcome = pooled.first, pooled.second, pooled.mean_a, pooled.outcome
    better, worse = pooled.missions("better than"), pooled.missions("worse than")
    if outcome == "worse than":
        first, second, mean_a, outcome, better, worse = second, first, 1.0 - mean_a, "better than", worse, better
    n = len(pooled.pairs)
    alike = n - len(better) - len(worse)
    where = "" if not pooled.setting else f" ({pooled.setting})"
    return (
        f"Over {n} missions{where}, {named(table, first)} is {outcome} {named(table, second)} (van Elteren's test, "
        f"{p_text(pooled.p_holm)}; mean A {mean_a:.2f}): better on {_counted(better, n)}, worse on "
        f"{_counted(worse, n)}, not distinguishable on {alike}"
        f"{_TOO_FEW * (pooled.least_p >= ALPHA)}."
    )


def _counted(missions: Sequence[str], n: int) -> str:
    """A number of missions, with their names if these are few of many."""
    return f"{len(missions)}" + (f" ({'; '.join(missions)})" if 0 < len(missions) <= 3 and n > 1 else "")


def ranks_sentence(table: StudyTable, by_ranks: AllByRanks) -> str:
    """The verdict of Friedman's and Nemenyi's tests."""
    ranked, levels = by_ranks.ranked, by_ranks.levels
    order = sorted(range(len(levels)), key=lambda k: ranked.mean_ranks[k])
    means = ", ".join(f"{named(table, levels[k])} {ranked.mean_ranks[k]:.2f}" for k in order)
    differ = [
        f"{named(table, levels[a])} before {named(table, levels[b])}"
        for place, a in enumerate(order)
        for b in order[place + 1 :]
        if ranked.p_values[a, b] < ALPHA
    ]
    where = "" if not by_ranks.setting else f" ({by_ranks.setting})"
    text = (
        f"Mean ranks{where} over {ranked.n_blocks} {by_ranks.what}: {means} (Friedman's test, {p_text(ranked.p_value)})"
    )
    if ranked.p_value >= ALPHA:
        return f"{text}: no difference is shown{'; none can be by so few' * (ranked.least_p >= ALPHA)}."
    if not differ:
        return f"{text}: there are differences, but Nemenyi's test does not show between which."
    return f"{text}. By Nemenyi's test (critical distance {ranked.distance:.2f}): {', '.join(differ)}."


def order_sentences(table: StudyTable, orders: Sequence[Order]) -> Iterator[str]:
    """Rank inversions in other realities: a sentence for each two levels, or one if there are none."""
    groups: dict[tuple[str, str, str], list[Order]] = {}
    for order in orders:
        first, second = order.model.first, order.model.second
        if order.model.a.value < 0.5:
            first, second = second, first
        if order.change != "kept":
            groups.setdefault((first, second, order.reality), []).append(order)
    if orders and not any(order.change == "inverted" for order in orders):
        n = f"{len(orders)} comparison{'s' * (len(orders) != 1)}"
        yield f"No rank inversion is significant in {n} of two {_plural(table.by)} in two realities."
    for (first, second, reality), found in groups.items():
        sure = [order.model.block.name for order in found if order.change == "inverted"]
        perhaps = [order.model.block.name for order in found if order.change != "inverted"]
        what = (
            f"{named(table, first)} is better than {named(table, second)} in the design model, and worse in {reality}"
        )
        if sure:
            yield f"Rank inversion: {what}, significantly on {'; '.join(sure)}."
        if perhaps:
            yield f"Seen, but not significant in both: {what}, on {'; '.join(perhaps)}."


def drop_sentence(table: StudyTable, drop: Drop) -> str:
    """What the designs of a level lose in another reality."""
    word = "loss" if drop.median >= 0 else "gain"
    share = f"{abs(drop.median / drop.model):.0%} of" if drop.model else ""
    relative = f" ({share} their median score)" * bool(share)
    if len(drop.losses) == 1:
        lost = number(abs(drop.median)) + f" ({share} its score)" * bool(share)
        return f"{drop.block}: in {drop.reality}, the {word} of the one design of {named(table, drop.level)} is {lost}."
    return (
        f"{drop.block}: in {drop.reality}, the median {word} of a design of {named(table, drop.level)} is "
        f"{number(abs(drop.median))}{relative}; {p_text(drop.p_value)}"
        f"{_TOO_FEW * (drop.least_p >= ALPHA)}."
    )


def correlation_sentence(correlations: Sequence[Correlation], reality: str) -> str:
    """How well the design model predicts the order of designs in another reality; empty if it is not known."""
    found = [(one.mission, one.rho) for one in correlations if one.reality == reality and one.rho is not None]
    if not found:
        return ""
    missions, known = {mission for mission, _ in found}, [rho for _, rho in found]
    spread = f"{min(known):.2f}"
    if len(known) > 1:
        spread += f" to {max(known):.2f} on {len(missions)} mission{'s' * (len(missions) != 1)}"
    if len(known) > len(missions):
        spread += f" in {len(known)} settings"
    return f"The order of designs in the design model and in {reality} correlates with {spread} (Spearman's rho)."


def single_sentences(table: StudyTable) -> Iterator[str]:
    """Which of several levels have one design on each mission: they are drawn, and not tested."""
    blocks = table.blocks()
    for level in table.levels if len(table.levels) > 1 else ():
        if max(len(block.scores.get(level, ())) for block in blocks) == 1:
            yield f"{named(table, level)} has one design: it is drawn, but not tested, as the unit is the design."


def score_sentences(table: StudyTable) -> Iterator[str]:
    """The scores of the designs of each level in the first reality: medians with quartiles."""
    for block in table.blocks(table.realities[0]):
        for level, scores in block.scores.items():
            low, middle, high = (number(float(one)) for one in scores.quantile([0.25, 0.5, 0.75]))
            of = f"{len(scores)} design{'s' * (len(scores) != 1)}"
            yield f"{block.name}: {named(table, level)} has a median score of {middle} ({low} to {high}), of {of}."


def headlines(results: StudyResults) -> Iterator[str]:
    """The answer of a study in few sentences."""
    table, findings = results.table, results.findings
    if len(table.levels) == 1:
        yield from score_sentences(table)
    if findings.pooled or findings.ranks:
        yield from (ranks_sentence(table, one) for one in findings.ranks if one.what == REPETITIONS)
        yield from (pooled_sentence(table, one) for one in findings.pooled)
    else:
        yield from (pair_sentence(table, one) for one in findings.pairs)
    yield from order_sentences(table, results.gap.orders)
    yield from single_sentences(table)


def all_sentences(results: StudyResults) -> Iterator[str]:
    """The answer of a study, the verdict on each mission, and what they rest on."""
    table, findings = results.table, results.findings
    yield from headlines(results)
    if findings.pooled or findings.ranks:
        yield from (pair_sentence(table, pair) for pair in findings.pairs)
    yield from front_sentences(table)
    yield power_sentence(findings)
    yield unit_sentence(table)


def _plural(factor: str) -> str:
    return f"{factor.replace('_', ' ')}s"
