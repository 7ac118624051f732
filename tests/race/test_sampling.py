"""All draws are seeded, so no test fails by luck."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from mercator_design.errors import RaceError
from mercator_design.race import Space, categorical, integer, ordered, real
from mercator_design.race.proposals.model import SamplingModel
from mercator_design.race.proposals.sampling import (
    even_sample,
    latin_hypercube,
    similar,
    sobol_sequence,
    truncated_normal,
    truncated_normal_value,
)
from mercator_design.race.space.parameter import key_of
from tests.race.spaces import machines


def nothing(_):
    return False


def test_similar_configurations_have_the_same_inactive_parameters():
    space = Space([categorical("a", [1, 2]), real("x", 0, 1, condition="a == 1"), integer("n", 0, 9)])
    rows = {
        0: {"a": "2", "n": 3},
        1: {"a": "2", "n": 3},
        2: {"a": "2", "n": 4},
        3: {"a": "1", "n": 3, "x": 0.5},
    }
    assert similar(space, rows, 1e-4) == [0, 1]


def test_the_last_ordered_value_is_drawn_only_where_no_elite_has_one():
    space = Space([integer("n", 1, 2), ordered("x", [1, 2, 5, 10], condition="n == 2")])
    model = SamplingModel(space)
    model.initialise({0: {"n": 2, "x": "10"}, 1: {"n": 1}})
    drawn = model.sample(2000, [0, 1], np.random.default_rng(3), nothing)
    of = [[c["x"] for c, parent in drawn if parent == elite and "x" in c] for elite in (0, 1)]
    assert set(of[0]) == {"1", "2", "5"}
    assert [of[1].count(value) / len(of[1]) for value in ("1", "2", "5", "10")] == pytest.approx([0.25] * 4, abs=0.1)


def test_values_stay_around_the_parent_and_rounding_is_kept():
    space = Space([real("x", -5, 5, digits=2), real("y", 0.001, 10, log=True), categorical("c", ["a", "b"])])
    model = SamplingModel(space)
    model.initialise({3: {"x": 4.99, "y": 0.001, "c": "a"}})
    for iteration in (2, 3, 4):
        elites = {3: {"x": 4.99, "y": 0.001, "c": "a"}}
        model.update(elites, {}, n_new=50, iteration=iteration, iterations=4)
    children = [c for c, parent in model.sample(500, [3], np.random.default_rng(1), nothing) if parent == 3]
    assert len(children) == 500
    assert np.mean([c["x"] for c in children]) > 4.5
    assert all(c["x"] == round(c["x"], 2) for c in children)
    assert np.mean([c["y"] < 0.05 for c in children]) > 0.9
    assert 0.8 < np.mean([c["c"] == "a" for c in children]) < 1.0  # never certain


def test_parents_are_drawn_by_rank():
    model = SamplingModel(Space([real("x", 0, 1)]))
    model.initialise({5: {"x": 0.1}, 2: {"x": 0.5}, 9: {"x": 0.9}})
    parents = [parent for _, parent in model.sample(6000, [9, 5, 2], np.random.default_rng(3), nothing)]
    assert [parents.count(p) / 6000 for p in (9, 5, 2)] == pytest.approx([1 / 2, 1 / 3, 1 / 6], abs=0.03)


def test_all_sampled_machines_are_valid():
    """From the Sobol sequence and through four generations of the model, with soft restarts."""
    space, generator = machines(), np.random.default_rng(5)
    configurations = even_sample(space, 200, generator, nothing, sobol_sequence)
    assert len({key_of(c) for c in configurations}) == 200
    model = SamplingModel(space)
    ranked = list(range(9))
    model.initialise(dict(enumerate(configurations[:9])))
    for iteration in (2, 3, 4, 5):
        children = model.sample(100, ranked, generator, nothing)
        assert all(parent in ranked for _, parent in children)
        elites = dict(enumerate((c for c, _ in children[:9]), start=len(configurations)))
        parents = {number: children[k][1] for k, number in enumerate(elites)}
        configurations += [c for c, _ in children]
        model.update(elites, parents, n_new=100, iteration=iteration, iterations=9)
        model.restart(list(elites)[:2], 100)
        ranked = list(elites)
    for c in configurations:
        space.check(c)
        for state in range(int(c["NumStates"]), 4):
            assert f"S{state}" not in c
    assert {c["NumStates"] for c in configurations[:200]} == {1, 2, 3, 4}
    targets = {c["N0x0"] for c in configurations if c["NumStates"] == 4}
    assert targets == {0, 1, 2}


def test_a_dependent_domain_of_one_value_gives_it():
    space = Space([integer("n", 0, 3), real("m", 0, "n")])
    model = SamplingModel(space)
    model.initialise({0: {"n": 0, "m": 0.0}})
    drawn = [c for c, _ in model.sample(100, [0], np.random.default_rng(2), nothing)]
    assert {c["m"] for c in drawn if c["n"] == 0} == {0.0}
    assert all(0 < c["m"] < c["n"] for c in drawn if c["n"] > 0)


@pytest.mark.parametrize("points", [sobol_sequence, latin_hypercube])
def test_the_first_sample_is_even_and_different(points):
    space = Space([real("x", 0, 1), categorical("c", ["a", "b", "c", "d"])])
    sample = even_sample(space, 64, np.random.default_rng(1), nothing, points)
    assert [sum(c["c"] == value for c in sample) for value in "abcd"] == [16] * 4
    assert np.histogram([c["x"] for c in sample], bins=16, range=(0, 1))[0].tolist() == [4] * 16


def test_a_small_space_gives_fewer_first_configurations():
    space = Space([categorical("a", [1, 2]), categorical("b", [1, 2, 3])])
    sample = even_sample(space, 50, np.random.default_rng(1), nothing, sobol_sequence)
    assert len({key_of(c) for c in sample}) == len(sample) == 6


def test_what_is_excluded_is_not_sampled():
    space = Space([integer("n", 1, 100), categorical("c", [1, 2])], forbidden=["n > 50"])
    generator = np.random.default_rng(1)
    sample = even_sample(space, 20, generator, space.is_forbidden, sobol_sequence)
    model = SamplingModel(space)
    model.initialise({0: {"n": 50, "c": "1"}})
    drawn = [c for c, _ in model.sample(200, [0], generator, space.is_forbidden)]
    assert max(c["n"] for c in sample + drawn) <= 50
    assert 10 < len(sample) <= 20  # half of a first sample is excluded, of a second, larger one too
    assert len(drawn) == 200


def test_an_error_when_nothing_is_allowed():
    space = Space([integer("n", 1, 100)], forbidden=["n > 0"])
    with pytest.raises(RaceError, match="all that were sampled are forbidden"):
        even_sample(space, 20, np.random.default_rng(1), space.is_forbidden, sobol_sequence)
    model = SamplingModel(space)
    model.initialise({0: {"n": 50}})
    assert model.sample(5, [0], np.random.default_rng(1), space.is_forbidden) == []


@pytest.mark.parametrize("mean", [-3.0, -0.2, 0.0, 0.4, 1.0, 1.3, 5.0])
@pytest.mark.parametrize("deviation", [0.2, 1.0])
def test_normal_values_with_a_mean_anywhere(mean, deviation):
    at = np.linspace(0.01, 0.99, 9)
    expected = truncnorm.ppf(at, -mean / deviation, (1 - mean) / deviation, mean, deviation)
    assert truncated_normal(at, mean, deviation) == pytest.approx(expected, rel=1e-6)


def test_a_mean_too_far_outside_is_the_nearer_bound():
    assert truncated_normal(np.array([0.1, 0.9]), np.array([-7.0, 9.0]), 1e-3).tolist() == [0.0, 1.0]


def test_single_values_have_the_same_bits():
    generator = np.random.default_rng(1)
    uniforms, deviations = generator.random(3000), 10.0 ** generator.uniform(-6, 1, size=3000)
    means = np.where(generator.random(3000) < 0.1, np.nan, generator.normal(0.5, 1.5, size=3000))
    together = truncated_normal(uniforms, means, deviations)
    singly = [truncated_normal_value(*map(float, given)) for given in zip(uniforms, means, deviations, strict=True)]
    assert singly == together.tolist()


def test_the_mean_of_dependent_bounds_is_a_value():
    """Where it lies outside of the child's bounds, the nearer bound is drawn."""
    space = Space([integer("n", 4, 20), real("x", 0, "n")])
    model = SamplingModel(space)
    model.initialise({0: {"n": 20, "x": 10.0}})
    model.elites[0].spreads[:] = 5.0, 1e-6
    drawn = model.sample(500, [0], np.random.default_rng(1), nothing)
    found = {c["n"]: c["x"] for c, _ in drawn if c["n"] in {4, 20}}
    assert found == pytest.approx({4: 4, 20: 10}, abs=1e-3)
