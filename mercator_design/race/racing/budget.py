"""How irace divides a budget: how many iterations, and how many configurations each of them races.

Pure functions, named after those of irace's source (computeNbIterations, computeComputationalBudget,
computeNbConfigurations, computeMinimumBudget). A budget counts experiments; what counts instances here does
so where irace counts blocks of them, too. Where irace refuses a small budget, fewer iterations are planned,
as irace itself does when it races against time.
"""

import math
from dataclasses import dataclass

from mercator_design.errors import RaceError

MAX_CONFIGURATIONS = 1024
"""In one race, whatever the budget."""
_GROWING_ITERATIONS = 5
"""A race has one more instance an iteration, until this one."""


def n_iterations(n_variable: int) -> int:
    """Iterations for a number of variable parameters; also how many survivors end a race."""
    return math.floor(2 + math.log2(n_variable))


def iteration_budget(remaining: int, iteration: int, iterations: int) -> int:
    """An even share of what is left for iteration 1 .. iterations."""
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
    # The elites' results on old instances need no experiments.
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
    """How often to race and how many may survive each race."""

    iterations: int
    survivors: int
    configurations: int | None  # most that one race may have; None is no limit
    least: int  # budget of a single iteration
    note: str | None  # in what it is not irace's plan


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
    """As many iterations as irace makes, or fewer until the budget suffices.

    Args:
        budget: Experiments in all.
        n_variable: Parameters to choose.
        mu: Instances that every configuration should see.
        each_test: Instances between two tests.
        n_new: New instances that an elitist race begins with.
        elitist: Whether elites keep their results.
        iterations: How many to make instead of irace's number.
        survivors: How many end a race instead of irace's number.

    Raises:
        RaceError: Not even one iteration fits.
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
