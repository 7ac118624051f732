"""Noise fitted to rounded measurements, drawn with fixed seeds; by luck a test fails for less than 1e-6 of them."""

import math

import numpy as np
import pytest
from scipy import optimize, stats

from mercator_design.calibration.noise import FAMILIES, SIMULATIONS, fit_gaussian, fit_noise, fit_uniform, levels_of
from tests.calibration import recordings
from tests.tiers import some

GAUSSIAN, UNIFORM = FAMILIES
# channels, measurements of each, step, parameter
CASES = [(3, 300, 1.0, 5.0), (8, 125, 1e-3, 0.03), (300, 20, 0.25, 2.0), (1, 300, 1e-6, 5.0), (8, 300, 1.0, 0.6)]


def measured(family, channels, n, step, parameter, seed=1):
    random = np.random.default_rng(seed)
    channel = np.repeat(np.arange(channels), n)
    noise = getattr(recordings, family.name)(parameter)(random, len(channel))
    return levels_of(channel, random.uniform(0.0, 10.0, channels)[channel] + noise, step)


@pytest.mark.parametrize(("family", "known"), [(GAUSSIAN, stats.norm(0.0, 1.5)), (UNIFORM, stats.uniform(-1.5, 3.0))])
def test_distributions_are_those_of_scipy(family, known):
    x = np.linspace(-5.0, 5.0, 101)
    assert family.cumulative(x, 1.5) == pytest.approx(known.cdf(x), abs=1e-15)
    drawn = known.rvs(10, random_state=np.random.default_rng(1))
    assert family.draw(np.random.default_rng(1), 1.5, 10) == pytest.approx(drawn, abs=1e-12)


@pytest.mark.swept
@pytest.mark.parametrize("case", some(CASES, 2))
def test_gaussian_noise_is_recovered(case):
    channels, n, step, sd = case
    noise = fit_noise(measured(GAUSSIAN, *case), np.random.default_rng(2))
    error = sd * (1.0 + (step / sd) ** 2 / 6.0) / math.sqrt(2.0 * channels * (n - 1))
    assert noise.family is GAUSSIAN or noise.aic_difference < 2.0
    assert noise.parameter == pytest.approx(sd, abs=6.0 * error)  # chance 2e-9
    low, high = noise.interval
    assert low < noise.parameter < high
    assert 2.5 * error < high - low < 8.0 * error
    assert noise.aic_difference > 10.0 or step > sd


@pytest.mark.swept
@pytest.mark.parametrize("case", some(CASES, 2))
def test_uniform_noise_is_recovered(case):
    channels, n, step, half_width = case
    noise = fit_noise(measured(UNIFORM, *case), np.random.default_rng(2))
    assert noise.family is UNIFORM or step > half_width
    # No channel reaches this far: (1 + n x) exp(-n x) for each, of a part x that is missing.
    missing = next(x for x in np.linspace(0.0, 1.0, 1000) if ((1.0 + n * x) * math.exp(-n * x)) ** channels < 1e-7)
    assert noise.parameter == pytest.approx(half_width, abs=missing * half_width + step)
    low, high = noise.interval
    assert low < noise.parameter < high
    assert high - low < 2.0 * (missing * half_width + step)


def test_one_channel_is_fitted_as_scipy_fits_it():
    levels = measured(GAUSSIAN, 1, 300, 1.0, 0.8)
    repeated = [np.repeat(edge, levels.count) for edge in levels.edges]
    mean, sd = stats.norm.fit(stats.CensoredData.interval_censored(*repeated))
    fit = fit_gaussian(levels)
    assert (fit.centres[0], fit.parameter) == pytest.approx((mean, sd), rel=1e-3)


def test_both_families_have_one_parameter_so_akaike_compares_likelihoods():
    levels = measured(GAUSSIAN, 3, 300, 1.0, 5.0)
    noise = fit_noise(levels, np.random.default_rng(2))
    difference = fit_gaussian(levels).log_likelihood - fit_uniform(levels).log_likelihood
    assert noise.aic_difference == pytest.approx(2.0 * difference)


@pytest.mark.parametrize("half_width", [0.8, 3.0])
def test_the_uniform_fit_is_the_most_likely_one(half_width):
    levels = measured(UNIFORM, 1, 40, 1.0, half_width)

    def cost(what):
        """Of one centre and half width, or of many, along further axes."""
        centre, half = np.asarray(what)[..., np.newaxis]
        low, high = levels.edges
        cells = np.minimum(high, centre + half) - np.maximum(low, centre - half)
        possible = (cells.min(axis=-1) > 0.0) & (half[..., 0] > 0.0)
        likely = (levels.count * np.log(np.where(possible[..., np.newaxis], cells / (2.0 * half), 1.0))).sum(axis=-1)
        return np.where(possible, -likely, np.inf)

    fit = fit_uniform(levels)
    middle = 0.5 * (levels.level[0] + levels.level[-1])
    reach = 0.5 * (levels.level[-1] - levels.level[0])
    ranges = [(middle - 1.0, middle + 1.0), (max(reach - 0.5, 0.1), reach + 0.6)]
    grid = np.stack(np.meshgrid(*(np.linspace(*ends, 300) for ends in ranges)))
    best = np.unravel_index(cost(grid).argmin(), grid.shape[1:])
    found = optimize.fmin(cost, grid[:, *best], disp=False)
    assert -fit.log_likelihood == pytest.approx(cost(found), abs=1e-3)
    assert cost((fit.centres[0], fit.parameter)) == pytest.approx(-fit.log_likelihood, abs=1e-9)


def test_the_fit_of_the_right_family_is_good():
    """Of 12, five with the least p-value that there can be: 792 (1 / 200)^5 = 2.5e-10."""
    cases = [(family, seed) for family in FAMILIES for seed in range(6)]
    fits = [fit_noise(measured(family, 3, 300, 1.0, 5.0, seed), np.random.default_rng(seed)) for family, seed in cases]
    assert [fit.family for fit in fits] == [family for family, _ in cases]
    assert sum(fit.p_value <= 1.0 / (SIMULATIONS + 1) for fit in fits) < 5


def two_humps(random, n):
    return random.choice([-5.0, 5.0], n) + random.normal(0.0, 1.0, n)


def with_tails(random, n):
    return random.laplace(0.0, 4.0, n)


@pytest.mark.parametrize("draw", [two_humps, with_tails])
def test_the_fit_of_other_noise_is_bad(draw):
    levels = levels_of(np.repeat(np.arange(3), 300), draw(np.random.default_rng(3), 900), 1.0)
    assert fit_noise(levels, np.random.default_rng(2)).p_value == 1.0 / (SIMULATIONS + 1)


def test_the_seed_decides():
    levels = measured(GAUSSIAN, 3, 300, 1.0, 5.0)
    first, again, other = (fit_noise(levels, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert (first.parameter, first.interval, first.p_value) == (again.parameter, again.interval, again.p_value)
    assert first.interval != other.interval
