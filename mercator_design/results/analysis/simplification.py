"""Removes the states and transitions of a PFSM that are shown not to matter on a mission.

What to remove next is chosen on some instances: the state or transition without which the costs are least likely to be
worse than the original's by a margin. Whether the simpler PFSMs are as good is tested on other instances, in the order
of removal, by a paired t-test of non-inferiority: may the costs be worse by the margin or more? The first test that
does not exclude this ends the removal. So a removal is wrong with probability `ALPHA` at most: a fixed sequence of
tests needs no correction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from mercator_design.fsm.pfsm import Pfsm
from mercator_design.race.analysis.pairs import worse_p_value
from mercator_design.results.analysis.pruning import Element, elements, one_less, removed, without

ALPHA = 0.05
"""Probability of a simplification that is worse than the original by the margin or more."""
SHARE = 0.05
"""The margin, as a part of the original's mean score, where none is given."""

_HOPELESS = 0.5
"""The p-value on the first instances from which on a removal is not tested: the mean is worse by the margin."""

Measure = Callable[[Sequence[Pfsm], range, str], Sequence[Sequence[float]]]
"""The costs of each of several PFSMs on instances of these numbers; the text says what it is for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """A step of a simplification.

    words: What is removed.
    out: All elements that are removed then.
    costs: On the test instances, in their order.
    p_value: Of being worse than the original by the margin or more.
    """

    words: str
    out: frozenset[Element]
    costs: tuple[float, ...]
    p_value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Simplification:
    """What can be removed from a PFSM.

    pfsm: The original.
    certain: Its elements that have no effect for certain, which need no test.
    costs: Of the original on the test instances.
    margin: Of the tests, in units of the score.
    steps: All removals that were tested, in order.
    """

    pfsm: Pfsm
    certain: frozenset[Element]
    costs: tuple[float, ...]
    margin: float
    steps: tuple[Removal, ...]

    @property
    def passed(self) -> tuple[Removal, ...]:
        """The removals before the first that does not pass its test."""
        failed = next((k for k, step in enumerate(self.steps) if step.p_value >= ALPHA), len(self.steps))
        return self.steps[:failed]

    @property
    def out(self) -> frozenset[Element]:
        """All elements that do not matter."""
        return self.passed[-1].out if self.passed else self.certain

    @property
    def simpler(self) -> Pfsm:
        """The PFSM without them."""
        return without(self.pfsm, self.out)

    @property
    def kept_states(self) -> list[int]:
        """The numbers of the states that are left, in the order of the simpler PFSM."""
        return [i for i in range(len(self.pfsm.states)) if (i, None) not in self.out]


def simplify(
    pfsm: Pfsm, measure: Measure, *, runs: int, dead: frozenset[Element] = frozenset(), margin: float | None = None
) -> Simplification:
    """Find what can be removed from a PFSM.

    Args:
        pfsm: The original.
        measure: Runs experiments.
        runs: Number of instances to choose removals on, and of others to test them on.
        dead: Transitions that never fire. They and what cannot be reached need no test.
        margin: By how much the score may be worse. [default: SHARE of the mean of the original]
    """
    certain = removed(pfsm, dead)
    [chosen_on] = measure([without(pfsm, certain)], range(runs), "the original")
    margin = SHARE * abs(fmean(chosen_on)) if margin is None else margin
    path: list[tuple[str, frozenset[Element]]] = []
    out = certain
    while candidates := one_less(pfsm, out):
        words = f"step {len(path) + 1}, removals to choose from: {len(candidates)}"
        table = measure([without(pfsm, each) for each in candidates], range(runs), words)
        p_values = [worse_p_value(np.subtract(costs, chosen_on), margin) for costs in table]
        out = list(candidates)[p_values.index(min(p_values))]
        if min(p_values) >= _HOPELESS:
            break
        path.append((candidates[out], out))
    variants = [without(pfsm, each) for each in (certain, *(each for _, each in path))]
    tests = measure(variants, range(runs, 2 * runs), "the tests") if path else [chosen_on]
    return Simplification(
        pfsm=pfsm,
        certain=certain,
        costs=tuple(tests[0]),
        margin=margin,
        steps=tuple(
            Removal(
                words=words, out=out, costs=tuple(costs), p_value=worse_p_value(np.subtract(costs, tests[0]), margin)
            )
            for (words, out), costs in zip(path, tests[1:], strict=True)
        ),
    )


def counts(found: Simplification) -> tuple[int, int]:
    """How many states and transitions are removed."""
    gone = [element for element in elements(found.pfsm) if element in found.out]
    states = sum(j is None for _, j in gone)
    return states, len(gone) - states
