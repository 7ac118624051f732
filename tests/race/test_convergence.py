"""How different configurations are from each other, relative to random ones."""

import math

import pytest

from mercator_design.race import categorical, integer, real
from mercator_design.race.analysis.convergence import first_iterations, spreads
from mercator_design.race.session.events import ConfigurationAdded, ExperimentDone, IterationEnded
from mercator_design.race.session.record import Record
from mercator_design.race.space.space import Space
from mercator_design.seeds import generator

SPACE = Space([real("x", -5, 5), integer("n", 1, 9), categorical("k", ["a", "b", "c"])])


def raced(*iterations):
    """The record of a race whose iterations have these new configurations."""
    record, number = Record(), 0
    record.begin({"budget": 10_000})
    for iteration, several in enumerate(iterations, start=1):
        for values in several:
            record.note(ConfigurationAdded(configuration=number, parent=None, values=values))
            record.note(
                ExperimentDone(
                    experiment=number, iteration=iteration, configuration=number, instance=0, seed=1, score=1.0
                )
            )
            number += 1
        record.note(
            IterationEnded(
                iteration=iteration, postselection=False, budget=1, used=len(several), configurations=len(several),
                instances=1, alive=1, elites=(0,), stagnant=0, note="",
            )
        )  # fmt: skip
    return record


def test_random_ones_have_1_equal_ones_0():
    draws = generator(1, "convergence")
    uniform = [SPACE.build(lambda p, bounds: p.quantile(float(draws.random()), bounds)) for _ in range(4000)]
    found = spreads(SPACE, raced(uniform, [{"x": 1.0, "n": 2, "k": "b"}] * 5))
    assert [(one.iteration, one.configurations) for one in found] == [(1, 4000), (2, 5)]
    # Standard errors are 0.01 and 0.002: 6 of them.
    assert found[0].numbers == pytest.approx(1.0, abs=0.06)
    assert found[0].categories == pytest.approx(1.0, abs=0.02)
    assert found[1][2:] == (0.0, 0.0)


def test_the_probability_that_two_differ_is_exact():
    (found,) = spreads(Space([categorical("k", ["a", "b"])]), raced([{"k": value} for value in "aab"]))
    assert found.categories == pytest.approx((2 / 3) / (1 / 2))
    assert math.isnan(found.numbers)


def test_one_configuration_alone_has_none():
    record = raced([{"x": 1.0, "n": 2, "k": "b"}])
    assert spreads(SPACE, record) == []
    assert first_iterations(record) == {0: 1}
