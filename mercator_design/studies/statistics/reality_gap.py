"""The reality gap: what the same designs score in the model that they were made in, and in other realities.

A rank inversion is that one method is better in the design model and worse in another reality (Ligot and Birattari
2020); it is sure if both differences are significant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
from scipy import stats

from mercator_design.arrays import Floats
from mercator_design.race.elimination.statistics import holm
from mercator_design.studies.statistics.comparison import Findings, PairOnMission, compared
from mercator_design.studies.statistics.effects import Effect, difference_of_medians
from mercator_design.studies.statistics.rank_tests import rank_sum, signed_rank
from mercator_design.studies.table import Block, StudyTable

MIN_CORRELATED = 3
"""Designs without which there is no correlation."""


class Drop(NamedTuple):
    """What the designs of a level lose on a mission in another reality.

    model, there: Medians of their scores in both.
    losses: Of the designs, in the order of their repetitions; positive if they are worse there, also where scores are
        costs.
    p_value: Of no loss, by the signed-rank test, with Holm's correction for all drops.
    least_p: The least p_value that is possible with so many designs.
    """

    block: str
    reality: str
    level: str
    model: float
    there: float
    losses: Floats
    p_value: float
    least_p: float

    @property
    def median(self) -> float:
        """The median of the losses."""
        return float(np.median(self.losses))


class DropsCompared(NamedTuple):
    """The losses of two levels on a mission; positive if the first loses more.

    p_value: Of the rank-sum test, with Holm's correction for all of them.
    """

    block: str
    reality: str
    first: str
    second: str
    more: Effect
    p_value: float


class Order(NamedTuple):
    """The order of two levels on a mission, in the design model and in another reality."""

    model: PairOnMission
    there: PairOnMission
    reality: str

    @property
    def change(self) -> Literal["inverted", "perhaps inverted", "kept"]:
        """Whether another one is better there: sure if both differences are significant."""
        if (self.model.a.value - 0.5) * (self.there.a.value - 0.5) >= 0:
            return "kept"
        sure = "not distinguishable from" not in (self.model.outcome, self.there.outcome)
        return "inverted" if sure else "perhaps inverted"


class Correlation(NamedTuple):
    """How well scores in the design model tell the order of a mission's designs in another reality.

    rho: Spearman's coefficient over the designs of all levels; None if all scores are equal.
    """

    mission: str
    block: str
    reality: str
    n_designs: int
    rho: float | None
    p_value: float | None


@dataclass(frozen=True, kw_only=True)
class RealityGap:
    """What a study shows of the gap; each list is empty where there is one reality."""

    drops: Sequence[Drop]
    compared: Sequence[DropsCompared]
    orders: Sequence[Order]
    correlations: Sequence[Correlation]


def reality_gap(table: StudyTable, model: Findings) -> RealityGap:
    """The gap between the design model, whose findings are known, and each other reality.

    A design by hand, which is in the blocks of all budgets, has one drop.
    """
    drops: dict[tuple[str, str, str], Drop] = {}
    orders: list[Order] = []
    correlations: list[Correlation] = []
    between: list[DropsCompared] = []
    blocks = {block.name: block for block in table.blocks(model.reality)}
    known = {(pair.block.name, pair.first, pair.second): pair for pair in model.pairs}
    for reality in (name for name in table.realities if name != model.reality):
        pairs = {(pair.block.name, pair.first, pair.second): pair for pair in compared(table, reality).pairs}
        orders += [Order(known[key], pair, reality) for key, pair in pairs.items() if key in known]
        for block in table.blocks(reality):
            if block.name in blocks:
                found = list(_drops(blocks[block.name], block, reality))
                for one in found:
                    name = block.name_by_hand if one.level in table.by_hand else block.name
                    drops[name, reality, one.level] = one._replace(block=name)
                between += _between(found)
                correlations += _correlation(blocks[block.name], block, reality)
    corrected = holm(np.array([one.p_value for one in drops.values()])).tolist()
    least = holm(np.array([one.least_p for one in drops.values()])).tolist()
    of_pairs = holm(np.array([one.p_value for one in between])).tolist()
    return RealityGap(
        drops=[
            one._replace(p_value=p, least_p=least_p)
            for one, p, least_p in zip(drops.values(), corrected, least, strict=True)
        ],
        compared=[one._replace(p_value=p) for one, p in zip(between, of_pairs, strict=True)],
        orders=orders,
        correlations=correlations,
    )


def _both(model: Block, there: Block, level: str) -> tuple[Floats, Floats]:
    """Values of the designs of a level that were assessed in both realities."""
    common = model.scores[level].index.intersection(there.scores[level].index)
    return tuple(block.sign * block.scores[level].loc[common].to_numpy(float) for block in (model, there))  # type: ignore[return-value]


def _drops(model: Block, there: Block, reality: str) -> list[Drop]:
    found = []
    for level in (one for one in model.scores if one in there.scores):
        before, after = _both(model, there, level)
        if len(before):
            medians = model.sign * float(np.median(before)), model.sign * float(np.median(after))
            p_value = signed_rank(before - after)
            least_p = min(1.0, 2.0 ** (1 - len(before)))
            found.append(Drop(model.name, reality, level, *medians, before - after, p_value, least_p))
    return found


def _between(drops: Sequence[Drop]) -> list[DropsCompared]:
    return [
        DropsCompared(
            first.block,
            first.reality,
            first.level,
            second.level,
            difference_of_medians(first.losses, second.losses),
            rank_sum(first.losses, second.losses),
        )
        for first, second in combinations([drop for drop in drops if len(drop.losses) > 1], 2)
    ]


def _correlation(model: Block, there: Block, reality: str) -> list[Correlation]:
    pairs = [_both(model, there, level) for level in model.scores if level in there.scores]
    before, after = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1)) if pairs else (np.empty(0),) * 2
    if len(before) < MIN_CORRELATED:
        return []
    if not (np.ptp(before) and np.ptp(after)):
        return [Correlation(model.mission, model.name, reality, len(before), None, None)]
    found = stats.spearmanr(before, after)
    return [Correlation(model.mission, model.name, reality, len(before), float(found.statistic), float(found.pvalue))]
