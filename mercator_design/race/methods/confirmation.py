"""The confirmation: the best of all iterations run on new instances, and the worse half is dropped until one is left.

A configuration that was only lucky in its race loses here.
"""

import math
from collections.abc import Generator, Sequence

import numpy as np

from mercator_design.errors import RaceError
from mercator_design.race.racing.additive_model import expected, table
from mercator_design.race.racing.history import RaceHistory
from mercator_design.race.racing.race import ALL_REJECTED, Experiment
from mercator_design.race.racing.statistics import concordance
from mercator_design.race.racing.summary import IterationSummary

MAX_FINALISTS = 8


def by_expectation(history: RaceHistory, numbers: Sequence[int]) -> list[int]:
    """Sort configurations by expected mean cost, the best first; drop those that were rejected or have not run."""
    accepted = [number for number in numbers if history.costs[number] and not history.is_rejected(number)]
    if not accepted:
        return []
    costs = table([history.costs[number] for number in accepted])
    order = np.argsort(expected(costs[:, ~np.isnan(costs).all(axis=0)]), kind="stable")
    return [accepted[k] for k in order]


def confirm(
    history: RaceHistory,
    order: list[int],
    n_finalists: int,
    *,
    iteration: int,
    budget: int,
    n_seen: int,
) -> Generator[list[Experiment], Sequence[float], tuple[IterationSummary, list[int]]]:
    """Spend the rest of a budget on the best of some configurations.

    All experiments of one halving are one batch. Returns a summary without elites, and the new order.

    Args:
        history: The history of the race.
        order: Configurations, the best first.
        n_finalists: Number of configurations to compare, 2 or more.
        iteration: The number of the confirmation.
        budget: Budget of the whole race; it must suffice for an instance for each finalist.
        n_seen: Number of instances seen.

    Raises:
        RaceError: All configurations of the race have been rejected.
    """
    n_alive, n_told, first = n_finalists, history.n_told, n_seen
    while n_alive > 1 and (left := budget - history.n_told) > 1:
        alive = order[: min(n_alive, left)]
        n_instances = max(left // (len(alive) * math.ceil(math.log2(len(alive)))), 1)
        new = range(n_seen, n_seen + n_instances)
        yield [Experiment(configuration, instance) for instance in new for configuration in alive]
        n_seen = new.stop
        order = by_expectation(history, alive) + order[len(alive) :]
        if not order:  # no elite is accepted any more
            order = by_expectation(history, range(len(history.configurations)))
        if not order:
            raise RaceError(ALL_REJECTED)
        n_alive = min(math.ceil(len(alive) / 2), len(order))
    accepted = [number for number in alive if not history.is_rejected(number)]
    summary = IterationSummary(
        iteration=iteration,
        postselection=True,
        budget=budget - n_told,
        used=history.n_told - n_told,
        n_configurations=n_finalists,
        n_instances=n_seen - first,
        n_alive=n_alive,
        stop_reason="one is left" if n_alive == 1 else "the whole budget is used",
        survivors=tuple(order[:n_alive]),
        concordance=concordance(table([history.costs[number] for number in accepted])[:, new.start :].T),
    )
    return summary, order
