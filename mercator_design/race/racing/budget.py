"""How irace divides a budget: how many iterations, and how many configurations each of them races.

Pure functions, after those of irace's source (computeNbIterations, computeComputationalBudget,
computeNbConfigurations, computeMinimumBudget). A budget counts experiments. Arguments count instances, also where
irace counts blocks. If irace would refuse a small budget, fewer iterations are planned, as irace does when it has a
time budget.
"""

import math
from dataclasses import dataclass

from mercator_design.errors import RaceError

MAX_CONFIGURATIONS = 1024
"""Maximum in one race, for any budget."""
_GROWING_ITERATIONS = 5
"""Each iteration has one more instance than the one before, up to this iteration."""


def n_iterations(n_variable: int) -> int:
    """Number of iterations for a number of variable parameters; also the number of survivors that ends a race."""
    return math.floor(2 + math.log2(n_variable))


def iteration_budget(remaining: int, iteration: int, iterations: int) -> int:
    """An equal share of the remaining budget; iterations count from 1."""
    return remaining // (iterations - iteration + 1)


def n_configurations(
    budget: int, iteration: int, *, mu: int, each_test: int, n_elites: int = 0, n_old: int = 0, n_new: int = 0
) -> int:
    """Configurations of an iteration, elites included.

    Args:
        budget: Of this iteration.
        iteration: From 1.
        mu: Instances that every configuration should see.
        each_test: Instances between two tests.
        n_elites: Elites that keep their results.
        n_old: Instances they have results for.
        n_new: Instances that come before the old ones.
    """
    growing = mu + each_test * min(_GROWING_ITERATIONS, iteration)
    covering = math.ceil((n_old + n_new) / each_test) * each_test
    # Elites already have results on old instances.
    return min((budget + n_elites * n_old) // max(growing, covering), MAX_CONFIGURATIONS)


def minimum_budget(iterations: int, survivors: int, *, mu: int, each_test: int, n_new: int, elitist: bool) -> int:
    """The smallest budget that irace accepts."""
    instances = mu + _GROWING_ITERATIONS * each_test
    if elitist:
        early = min(iterations - 1, _GROWING_ITERATIONS)
        late = max(iterations - _GROWING_ITERATIONS, 0)
        instances = mu + each_test + late * n_new + early * max(each_test, n_new)
    return (survivors + 1) * iterations * instances


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """Number of iterations, and of survivors of each."""

    iterations: int
    survivors: int
    configurations: int | None  # maximum in one race; None: no limit
    least: int  # budget of a single iteration
    note: str | None  # how it differs from irace's plan


def plan(
    budget: int,
    *,
    n_variable: int,
    mu: int,
    each_test: int,
    n_new: int,
    elitist: bool,
    iterations: int | None = None,
    survivors: int | None = None,
) -> Plan:
    """Plan as many iterations as irace does, or fewer if the budget is too small.

    Args:
        budget: Experiments in all.
        n_variable: Parameters to choose.
        mu: Instances that every configuration should see.
        each_test: Instances between two tests.
        n_new: New instances that an elitist race begins with.
        elitist: Whether elites keep their results.
        iterations: Replaces irace's number of iterations.
        survivors: Replaces irace's number of survivors that ends a race.

    Raises:
        RaceError: The budget is too small for one iteration.
    """
    wanted = iterations or n_iterations(n_variable)
    survivors = survivors or n_iterations(n_variable)

    def needed(count: int) -> int:
        return minimum_budget(count, survivors, mu=mu, each_test=each_test, n_new=n_new, elitist=elitist)

    fitting = next((count for count in range(wanted, 0, -1) if needed(count) <= budget), None)
    if fitting is None:
        raise RaceError(
            f"budget: expected at least {needed(1)} experiments for {n_variable} parameters "
            f"({needed(wanted)} for all {wanted} iterations), found {budget}"
        )
    if fitting == wanted:
        return Plan(iterations=wanted, survivors=survivors, configurations=None, least=needed(1), note=None)
    further = "" if iterations else ", and more follow while budget is left"
    return Plan(
        iterations=fitting,
        survivors=survivors,
        configurations=2 * survivors,
        least=needed(1),
        note=f"a budget of {budget} is planned for {fitting} instead of {wanted} iterations, with at most "
        f"{2 * survivors} configurations in each{further}; {needed(wanted)} experiments would allow all {wanted}",
    )
