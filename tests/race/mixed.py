"""A problem with parameters of all kinds, a known optimum and noise that is a function of a seed."""

import functools
import math

import numpy as np

from mercator_design.race import Space, categorical, integer, ordered, real

MIXED = Space(
    [
        real("x", -5, 5),
        integer("n", 1, 1000, log=True),
        ordered("size", [1, 2, 5, 10]),
        categorical("rule", ["slow", "fast"]),
        real("rate", 0, 1, condition='rule == "fast"'),
    ]
)


def mixed_cost(configuration):
    """Least, 0, at x = 2, n = 30, size = 10, rule = fast, rate = 0.25."""
    return (
        (configuration["x"] - 2) ** 2 / 4
        + math.log(configuration["n"] / 30) ** 2
        + abs(math.log(int(configuration["size"]) / 10))
        + (2 if configuration["rule"] == "slow" else 4 * abs(configuration["rate"] - 0.25))
    )


@functools.cache  # the same experiments occur in many races
def noise(seed, experiment):
    """Common to all on an instance, and each experiment's own."""
    return drawn(seed, experiment.instance) + 0.3 * drawn(seed, experiment.instance, experiment.configuration)


@functools.cache
def drawn(*key):
    """A number of a normal distribution that belongs to a key."""
    return np.random.default_rng(key).normal()


def run(race, cost=mixed_cost, seed=0):
    """Run to the end; all experiments with their costs."""
    told = []
    while batch := race.ask():
        assert race.used + len(batch) <= race.budget
        assert len(set(batch)) == len(batch)
        costs = [cost(race.configurations[e.configuration]) + noise(seed, e) for e in batch]
        race.tell(costs)
        told += zip(batch, costs, strict=True)
    return told
