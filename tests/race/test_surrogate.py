"""What the surrogate expects of configurations."""

import math

import numpy as np
import pytest

from mercator_design.race import Space, categorical, integer, real
from mercator_design.race.proposals.surrogate import Features, Surrogate
from mercator_design.race.space.encoding import Encoding
from tests.race.mixed import MIXED, mixed_cost
from tests.race.spaces import machines, uniform


def features_of(space, configurations):
    """The features of a space, and of configurations."""
    encoding = Encoding(space)
    features = Features(encoding)
    return features, features.of(encoding.rows(configurations))


def standardised(values):
    values = np.array(values)
    return (values - values.mean()) / values.std()


@pytest.fixture
def fitted():
    """A surrogate of 150 random configurations, what it was fitted to, and others."""
    configurations = uniform(MIXED, 250, np.random.default_rng(1))
    features, rows = features_of(MIXED, configurations)
    costs = standardised([math.sqrt(mixed_cost(c)) for c in configurations])
    surrogate = Surrogate(features)
    for _ in range(3):
        surrogate.fit(rows[:150], costs[:150], np.full(150, 0.01))
    return surrogate, rows, costs


def test_each_parameter_is_a_unit_vector_or_zero_where_a_number_is_inactive():
    space = Space(
        [categorical("a", "xy"), real("r", 0, 1, condition='a == "y"'), categorical("b", "uv", condition='a == "y"')]
    )
    features, rows = features_of(space, [{"a": "x"}, {"a": "y", "r": 0.3, "b": "u"}])
    lengths = np.array([(rows[:, features.owner == k] ** 2).sum(axis=1) for k in range(3)]).T
    assert lengths == pytest.approx(np.array([[1, 0, 1], [1, 1, 1]]))


def test_near_numbers_have_near_vectors():
    _, rows = features_of(Space([integer("n", 1, 1000, log=True)]), [{"n": n} for n in (10, 12, 30, 1000)])
    likeness = rows @ rows[0]
    assert likeness[0] == pytest.approx(1)
    assert list(likeness) == sorted(likeness, reverse=True)
    assert likeness[3] < 0.05


def test_it_predicts_configurations_that_it_has_not_seen(fitted):
    surrogate, rows, costs = fitted
    mean, spread = surrogate.predict(rows[150:])
    assert (surrogate.means(rows[150:]) == mean).all()
    assert np.corrcoef(mean, costs[150:])[0, 1] > 0.9
    inside = np.abs(mean - costs[150:]) < 2 * np.hypot(spread, 0.1)
    assert inside.mean() > 0.8


def test_it_is_surer_of_what_it_has_seen(fitted):
    surrogate, rows, costs = fitted
    mean, spread = surrogate.predict(rows)
    assert np.abs(mean[:150] - costs[:150]).max() < 0.5
    assert spread[:150].mean() < 0.85 * spread[150:].mean()


def test_what_it_expects_of_the_configurations_it_has_learnt_from_is_what_it_predicts(fitted):
    surrogate, rows, costs = fitted
    expected = surrogate.fit(rows[:150], costs[:150], np.full(150, 0.01))
    assert expected == pytest.approx(surrogate.predict(rows[:150])[0], abs=1e-6)


def test_samples_have_the_moments_that_are_predicted(fitted):
    surrogate, rows, _ = fitted
    mean, spread = surrogate.predict(rows[140:180])
    sampled = surrogate.sample(rows[140:180], 4000, np.random.default_rng(2))
    error = np.abs(sampled.mean(axis=0) - mean) / (spread + 1e-3) * math.sqrt(4000)
    assert error.max() < 7  # of 40 normal values; by luck with probability 1e-10
    assert sampled.std(axis=0) == pytest.approx(spread, rel=0.12, abs=3e-3)


def test_weights_tell_which_parameters_matter():
    space = Space([real("matters", 0, 1), real("not", 0, 1), categorical("neither", "abc")])
    configurations = uniform(space, 80, np.random.default_rng(3))
    features, rows = features_of(space, configurations)
    surrogate = Surrogate(features)
    for _ in range(5):
        surrogate.fit(rows, standardised([math.sin(6 * c["matters"]) for c in configurations]), np.full(80, 0.05))
    apart = surrogate.distances(
        *(
            features_of(space, pair)[1]
            for pair in (
                [{"matters": 0.2, "not": 0.5, "neither": "a"}],
                [
                    {"matters": 0.8, "not": 0.5, "neither": "a"},
                    {"matters": 0.2, "not": 0.9, "neither": "a"},
                    {"matters": 0.2, "not": 0.5, "neither": "b"},
                ],
            )
        )
    )[0]
    assert apart[0] > 3 * apart[1]
    assert apart[0] > 3 * apart[2]


def test_last_bits_of_costs_decide_nothing():
    """Nor does the order of configurations, though a parameter has one value only among them: its slope is 0."""
    space = Space([real("matters", 0, 1), integer("one", 0, 9), categorical("same", "abc")])
    configurations = [{**one, "one": 4, "same": "b"} for one in uniform(space, 60, np.random.default_rng(3))]
    features, rows = features_of(space, configurations)
    costs = standardised([math.sin(6 * c["matters"]) for c in configurations])
    _, others = features_of(space, uniform(space, 20, np.random.default_rng(4)))

    def predicted(rows, costs):
        surrogate = Surrogate(features)
        for _ in range(3):
            surrogate.fit(rows, costs, np.full(60, 0.05))
        return surrogate.predict(others)

    mean, spread = predicted(rows, costs)
    for again in (predicted(rows, np.nextafter(costs, 9.0)), predicted(rows[::-1], costs[::-1])):
        assert np.abs(mean - again[0]).max() < 1e-8
        assert np.abs(spread - again[1]).max() < 1e-8


def test_distances_are_of_vectors_so_that_covariances_are_valid():
    """Conditional parameters included: no eigenvalue is negative but by rounding."""
    space = machines()
    features, rows = features_of(space, uniform(space, 60, np.random.default_rng(4)))
    surrogate = Surrogate(features)
    surrogate.fit(rows, standardised(np.arange(60.0)), np.full(60, 0.1))
    distances = surrogate.distances(rows, rows)
    assert distances == pytest.approx(distances.T, abs=1e-8)
    assert np.linalg.eigvalsh(np.exp(-distances)).min() > -1e-6
