"""How irace divides a budget: how many iterations, and how many configurations each of them races.

Pure functions, after those of irace's source (computeNbIterations, computeComputationalBudget,
computeNbConfigurations, computeMinimumBudget). A budget counts experiments. Arguments count instances, also where
irace counts blocks.
"""

import math

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
