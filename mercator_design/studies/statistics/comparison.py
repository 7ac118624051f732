"""What a table of a study shows: its levels in pairs on each mission, pooled over missions, and all by ranks.

A-measures above 0.5 are in favour of the first of a pair, also where scores are minimised; differences are of scores.
Holm's correction is for all pairs on all missions of a reality, and for all pooled tests.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from mercator_design.arrays import Floats
from mercator_design.race.elimination.statistics import holm
from mercator_design.race.elimination.summary import ALPHA
from mercator_design.studies.statistics.effects import Effect, a_effect, difference_of_means, difference_of_medians
from mercator_design.studies.statistics.power import Visible, least_p, visible
from mercator_design.studies.statistics.rank_tests import RankedBlocks, friedman, rank_sum, signed_rank, van_elteren
from mercator_design.studies.table import DESIGN_MODEL, Block, StudyTable

MIN_DESIGNS = 2
"""Designs of each of a pair without which they are not compared."""
REPETITIONS, MEDIANS = "repetitions on missions", "missions, by medians"
"""The blocks of Friedman's tests, in words."""
Outcome = Literal["better than", "worse than", "not distinguishable from"]


class PairOnMission(NamedTuple):
    """Two levels on a mission, by their designs.

    a: The A-measure: of the pairs of designs, those in which the first's is better.
    medians, means: Differences, the first's minus the second's, in scores.
    p_value: Of the rank-sum test; p_holm is corrected.
    least_p: The least p_holm that is possible with so many designs.
    p_paired: Of the signed-rank test of designs of the same seeds, not corrected; None if fewer than two have the same.
    """

    block: Block
    first: str
    second: str
    a: Effect
    medians: Effect
    means: Effect
    p_value: float
    p_holm: float
    least_p: float
    p_paired: float | None

    @property
    def sizes(self) -> tuple[int, int]:
        """The numbers of designs of both."""
        return len(self.block.scores[self.first]), len(self.block.scores[self.second])

    @property
    def outcome(self) -> Outcome:
        """What the rank-sum test at 5 % says of the first."""
        return outcome_of(self.a.value, self.p_holm)


class PairPooled(NamedTuple):
    """Two levels over all missions of a setting.

    pairs: On each mission.
    p_value: Of van Elteren's test; p_holm is corrected.
    least_p: The least p_holm that is possible with so many designs, if no scores are equal.
    """

    setting: str
    first: str
    second: str
    pairs: tuple[PairOnMission, ...]
    p_value: float
    p_holm: float
    least_p: float

    @property
    def mean_a(self) -> float:
        """The mean of the A-measures."""
        return float(np.mean([pair.a.value for pair in self.pairs]))

    @property
    def outcome(self) -> Outcome:
        """What van Elteren's test at 5 % says of the first."""
        return outcome_of(self.mean_a, self.p_holm)

    def missions(self, outcome: Outcome) -> list[str]:
        """The missions of an outcome of the first."""
        return [pair.block.mission for pair in self.pairs if pair.outcome == outcome]


class AllByRanks(NamedTuple):
    """Three levels or more by their ranks in the blocks of a setting.

    what: The blocks, in words.
    """

    setting: str
    what: str
    levels: tuple[str, ...]
    ranked: RankedBlocks


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a study shows in a reality.

    levels: What is compared.
    alone: Names of blocks in which fewer than two of several levels have designs enough.
    visible: What a number of designs of each of a pair can show, with Holm's correction: for the smaller number of
        each pair.
    """

    reality: str
    levels: Sequence[str]
    pairs: Sequence[PairOnMission]
    pooled: Sequence[PairPooled]
    ranks: Sequence[AllByRanks]
    alone: Sequence[str]
    visible: Mapping[int, Visible]


def outcome_of(a: float, p_value: float) -> Outcome:
    """An outcome at 5 %."""
    if p_value >= ALPHA or a == 0.5:
        return "not distinguishable from"
    return "better than" if a > 0.5 else "worse than"


def compared(table: StudyTable, reality: str = DESIGN_MODEL) -> Findings:
    """Compare the levels of a table in a reality."""
    blocks = table.blocks(reality)
    known = {
        (k, *pair): _values(block, *pair)
        for k, block in enumerate(blocks)
        for pair in combinations([level for level, found in block.scores.items() if len(found) >= MIN_DESIGNS], 2)
    }
    p_values = np.array([rank_sum(*values) for values in known.values()])
    least = holm(np.array([least_p([(len(some), len(others))]) for some, others in known.values()]))
    pairs = [
        _pair(blocks[k], first, second, *found)
        for (k, first, second), *found in zip(
            known, p_values.tolist(), holm(p_values).tolist(), least.tolist(), strict=True
        )
    ]
    sizes = sorted({min(map(len, both)) for both in known.values()})
    compared_blocks = {k for k, _, _ in known}
    return Findings(
        reality=reality,
        levels=table.levels,
        pairs=pairs,
        pooled=_pooled(pairs),
        ranks=_ranks(table.levels, blocks),
        alone=[block.name for k, block in enumerate(blocks) if k not in compared_blocks and len(table.levels) > 1],
        visible={n: visible(n, len(pairs)) for n in sizes},
    )


def _values(block: Block, first: str, second: str) -> tuple[Floats, Floats]:
    return block.values(first), block.values(second)


def _pair(block: Block, first: str, second: str, p_value: float, p_holm: float, least: float) -> PairOnMission:
    values, scores = _values(block, first, second), [block.scores[one].to_numpy(float) for one in (first, second)]
    paired = (block.sign * (block.scores[first] - block.scores[second])).dropna().to_numpy(float)
    return PairOnMission(
        block=block,
        first=first,
        second=second,
        a=a_effect(*values),
        medians=difference_of_medians(*scores),
        means=difference_of_means(*scores),
        p_value=p_value,
        p_holm=p_holm,
        least_p=least,
        p_paired=signed_rank(paired) if len(paired) >= MIN_DESIGNS else None,
    )


def _pooled(pairs: Sequence[PairOnMission]) -> list[PairPooled]:
    """The pairs of each setting that has several missions."""
    groups: dict[tuple[str, str, str], list[PairOnMission]] = {}
    for pair in pairs:
        groups.setdefault((pair.block.setting, pair.first, pair.second), []).append(pair)
    several = {key: found for key, found in groups.items() if len(found) > 1}
    p_values = np.array([van_elteren(_values(*pair[:3]) for pair in found) for found in several.values()])
    least = holm(np.array([least_p([pair.sizes for pair in found]) for found in several.values()]))
    return [
        PairPooled(*key, tuple(found), *of_tests)
        for (key, found), *of_tests in zip(
            several.items(), p_values.tolist(), holm(p_values).tolist(), least.tolist(), strict=True
        )
    ]


def _ranks(levels: Sequence[str], blocks: Sequence[Block]) -> list[AllByRanks]:
    """Friedman's tests of each setting: of repetitions on missions, and of the medians of missions.

    Repetitions are those that all levels have; if there are none, as of races with other seeds, designs in their order.
    """
    whole = [block for block in blocks if len(block.scores) == len(levels)]
    found = []
    for setting in dict.fromkeys(block.setting for block in whole) if len(levels) > 2 else ():
        rows, medians = [], []
        for block in (one for one in whole if one.setting == setting):
            several = [block.values(level) for level in levels]
            by_level = {level: block.sign * block.scores[level].droplevel("seed") for level in levels}
            common = pd.DataFrame(by_level).dropna().to_numpy().tolist()
            rows += common or [[*values] for values in zip(*several, strict=False)]
            medians.append([np.median(values) for values in several])
        for what, values in ((REPETITIONS, rows), (MEDIANS, medians)):
            if len(values) > 1:
                found.append(AllByRanks(setting, what, tuple(levels), friedman(np.array(values, dtype=float))))
    return found


def ranks_by_objective(table: StudyTable, blocks: Sequence[Block]) -> dict[str, dict[str, Floats]]:
    """The relative ranks of all designs by objective and level, over all blocks that have two levels.

    A design by hand, which is compared at each budget, counts once for each mission, with the mean of its ranks.
    """
    found: dict[str, dict[str, dict[tuple[object, ...], list[float]]]] = {}
    for block in (one for one in blocks if len(one.scores) > 1):
        for level, ranks in relative_ranks(block).items():
            designs = found.setdefault(block.objective, {}).setdefault(level, {})
            setting = () if level in table.by_hand else (block.setting,)
            for design, rank in zip(block.scores[level].index, ranks.tolist(), strict=True):
                designs.setdefault((block.mission, *setting, design), []).append(rank)
    return {
        objective: {
            level: np.array([np.mean(ranks) for ranks in by_level[level].values()])
            for level in table.levels
            if level in by_level
        }
        for objective, by_level in found.items()
    }


def relative_ranks(block: Block) -> dict[str, Floats]:
    """The rank of each design in its block, by level: 0 is the best, 1 the worst, equal ones have the mean."""
    levels = [*block.scores]
    values = np.concatenate([block.values(level) for level in levels])
    shares = (rankdata(-values) - 1.0) / max(len(values) - 1, 1)
    ends = np.cumsum([len(block.scores[level]) for level in levels])
    return dict(zip(levels, np.split(shares, ends[:-1]), strict=True))
