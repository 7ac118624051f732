"""The path between two configurations, where it is known which changes matter."""

import math
import zlib

import numpy as np
import pytest

from mercator_design.race import parse_space
from mercator_design.race.analysis.ablation import Flips, ablate
from mercator_design.race.space.parameter import key_of
from tests.race.mixed import MIXED
from tests.race.spaces import machines, uniform

SPACE = parse_space("""
x    "" r (0, 1)
y    "" r (0, 1)
rule "" c (u, v)
z    "" i (0, 9) | rule == "v"
none "" r (0, 1)
""")
START = {"x": 0.0, "y": 0.0, "rule": "u", "none": 0.0}
WINNER = {"x": 1.0, "y": 1.0, "rule": "v", "z": 9, "none": 1.0}


def cost(configuration):
    """x gains 3, rule and z together 5, and only if x is there; y loses 1."""
    gain = 3 * configuration["x"] - configuration["y"]
    return 10 - gain - (5 * (configuration.get("z", 0) == 9) if configuration["x"] == 1 else 0)


def measuring(flips, noise=0.0):
    """Of costs with noise that all share on an instance, and some that they do not."""

    def measure(several, instances):
        found = []
        for key in several:
            configuration = flips.configuration(key)
            own = [
                np.random.default_rng([k, *map(int, repr(sorted(configuration.items())).encode())]) for k in instances
            ]
            shared = [np.random.default_rng(k).normal() for k in instances]
            found.append([cost(configuration) + 10 * s + noise * r.normal() for s, r in zip(shared, own, strict=True)])
        return found

    return measure


@pytest.fixture(scope="module")
def steps():
    flips = Flips(SPACE, WINNER)
    return ablate(key_of(START), flips.changes, measuring(flips, 0.3), 20)


class TestPath:
    def test_the_change_that_gains_most_comes_first(self, steps):
        changes = [step.change for step in steps]
        assert changes[0] == ""
        assert changes[1] == "x = 1.0"
        assert changes[2] == "rule = v, with 1 more"
        assert set(changes[3:]) == {"none = 1.0", "y = 1.0"}
        assert changes[-1] == "y = 1.0"  # which costs

    def test_it_ends_at_the_target(self, steps):
        assert Flips(SPACE, WINNER).configuration(steps[-1].variant) == WINNER

    def test_costs_are_of_instances_that_no_change_was_chosen_on(self, steps):
        flips = Flips(SPACE, WINNER)
        expected = measuring(flips, 0.3)([step.variant for step in steps], range(20, 40))
        assert [list(step.costs) for step in steps] == expected

    def test_p_values(self, steps):
        assert math.isnan(steps[0].p_value)
        assert all(step.p_value < 1e-6 for step in steps[1:])


@pytest.mark.parametrize("k", [1, 2, 3, 5])
def test_what_it_takes(k):
    """As docs/how-to/assess-a-design.md says."""
    space = parse_space("\n".join(f'x{n} "" r (0, 1)' for n in range(k)))
    start, target = ({f"x{n}": value for n in range(k)} for value in (0.0, 1.0))
    flips, n_measured = Flips(space, target), 0

    def measure(several, instances):
        nonlocal n_measured
        n_measured += len(several) * len(instances)
        return [[1.0] * len(instances) for _ in several]

    assert len(ablate(key_of(start), flips.changes, measure, 30)) == k + 1
    assert n_measured == 30 * k * (k + 3) / 2


def test_nothing_to_change():
    flips = Flips(SPACE, START)
    [step] = ablate(key_of(START), flips.changes, measuring(flips), 5)
    assert (step.change, flips.configuration(step.variant)) == ("", START)


def test_what_makes_no_difference():
    """Differences of 0 on all instances, and none beyond noise."""
    flips = Flips(SPACE, {**START, "none": 1.0})
    assert ablate(key_of(START), flips.changes, measuring(flips), 5)[1].p_value == 1
    assert ablate(key_of(START), flips.changes, measuring(flips, 1.0), 5)[1].p_value > 0.01


@pytest.mark.parametrize("space", [MIXED, machines()])
def test_every_path_is_of_valid_configurations_and_ends(space):
    """Between random configurations, whatever is conditional or dependent in between."""
    draws = np.random.default_rng(1)
    for _ in range(10):
        here, target = uniform(space, 2, draws)
        flips = Flips(space, target)

        def any_costs(several, instances, flips=flips):
            return [[float(zlib.crc32(repr(key).encode()) % 97)] * len(instances) for key in several]

        steps = ablate(key_of(here), flips.changes, any_costs, 2)
        for step in steps:
            space.check(flips.configuration(step.variant))
        assert flips.configuration(steps[-1].variant) == target
        assert len(steps) <= len(target) + 1
