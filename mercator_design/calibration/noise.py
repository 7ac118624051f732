"""Noise fitted to rounded measurements, by maximum likelihood.

Each channel of a sensor measures an unknown constant plus noise with the same distribution for all channels, and rounds
the sum to a multiple of a step. So the likelihood of a measurement is the probability of its cell, which is one step
wide, and each channel's centre is estimated together with the parameter of the noise. Both families have one parameter,
so Akaike's criterion compares likelihoods.

Because many centres are estimated, the estimated parameter is too small (the factor n - 1 corrects this in simple
cases). Here a parametric bootstrap corrects it, for both families and any step: simulated measurements are fitted in
the same way, and the ratio of the fitted to the true parameter corrects the estimate and gives its confidence interval.
The same simulations give the distribution of the distance between fitted and empirical distribution, for which there
are no tables with fitted parameters and steps (Stute, Gonzalez Manteiga and Presedo Quindimil 1993, Bootstrap based
goodness-of-fit-tests).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import optimize, special

from mercator_design.arrays import Floats, Numbers

Distribution: TypeAlias = Literal["gaussian", "uniform"]

CONFIDENCE = 0.95
"""Confidence level of intervals."""
SIMULATIONS = 199
"""Simulations of the bootstrap: the smallest p-value is 1 / (SIMULATIONS + 1)."""

_TOLERANCE = 1e-7  # relative, of the standard deviation
_MAX_STEPS = 2000
_GRID, _TIE = 64, 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Counted measurements of a sensor.

    channel, level, count: (k,) How often a channel measured a level, sorted by channel, then by level; levels are
        multiples of the step.
    """

    channel: Numbers
    level: Floats
    count: Numbers
    step: float

    @property
    def edges(self) -> tuple[Floats, Floats]:
        """The lower and the upper end of each level's cell."""
        return self.level - 0.5 * self.step, self.level + 0.5 * self.step

    @property
    def counts(self) -> Numbers:
        """(channels,) The number of measurements of each channel."""
        return self.totals(np.ones_like(self.level)).astype(np.int64)

    def totals(self, values: Floats) -> Floats:
        """(channels,) The sum of values (k,) over the measurements of each channel."""
        return np.bincount(self.channel, self.count * values).astype(float)


def levels_of(channel: Numbers, value: Floats, step: float) -> Levels:
    """Count measurements, given by (n,) channels, from 0, and values."""
    number = np.rint(value / step).astype(np.int64)
    low = number.min()
    span = number.max() - low + 1
    key, count = np.unique(channel * span + (number - low), return_counts=True)
    return Levels(key // span, (key % span + low) * step, count, step)


class Fit(NamedTuple):
    """The parameter and the centres (channels,) of maximum likelihood.

    slack: Possible error of the centres, for a likelihood that is not smooth.
    """

    parameter: float
    centres: Floats
    slack: float
    log_likelihood: float


@dataclass(frozen=True, slots=True)
class Family:
    """A family of distributions around 0 with one parameter, their width.

    parameter: The name of the parameter in robot models.
    fit: The fit to measurements; a channel must have three levels or more.
    draw: Draws a number of values, for a parameter.
    cumulative: The probability of less than each value, for a parameter.
    """

    name: Distribution
    parameter: str
    fit: Callable[[Levels], Fit]
    draw: Callable[[np.random.Generator, float, int], Floats]
    cumulative: Callable[[Floats, float], Floats]


def fit_gaussian(levels: Levels) -> Fit:
    """Fit by expectation and maximisation; the value before rounding is the hidden variable."""
    n = levels.counts
    centres = levels.totals(levels.level) / n
    spread = levels.totals((levels.level - centres[levels.channel]) ** 2).sum() / n.sum()
    sd = float(np.sqrt(max(spread - levels.step**2 / 12.0, levels.step**2 / 20.0)))
    for _ in range(_MAX_STEPS):
        a, b = ((edge - centres[levels.channel]) / sd for edge in levels.edges)
        inside = _normal(a, b)
        density_a, density_b = (np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi) for z in (a, b))
        first = levels.totals((density_a - density_b) / inside) / n
        second = levels.totals(1.0 + (a * density_a - b * density_b) / inside).sum() / n.sum()
        centres = centres + sd * first
        before, sd = sd, sd * float(np.sqrt(second - (n * first**2).sum() / n.sum()))
        if abs(sd - before) < _TOLERANCE * sd:
            break
    a, b = ((edge - centres[levels.channel]) / sd for edge in levels.edges)
    return Fit(sd, centres, 0.0, float(levels.totals(np.log(_normal(a, b))).sum()))


def _normal(a: Floats, b: Floats) -> Floats:
    """Probability of being between a and b, exact in both tails; never 0."""
    side = np.where(a > 0.0, -1.0, 1.0)
    found: Floats = np.maximum(np.abs(special.ndtr(side * b) - special.ndtr(side * a)), np.finfo(float).tiny)
    return found


def fit_uniform(levels: Levels) -> Fit:
    """Fit to the outermost levels of each channel; others have no information.

    The interval of the noise covers all cells between these two, and parts of these, which maximise the likelihood.
    """
    first = np.flatnonzero(np.diff(levels.channel, prepend=-1))
    last = np.append(first[1:], len(levels.channel)) - 1
    bottom, reach = levels.level[first], levels.level[last] - levels.level[first]
    lowest, highest, n = levels.count[first], levels.count[last], levels.counts
    step, one = levels.step, reach == 0.0
    between = (n - lowest - highest) * np.log(step)

    def parts(half_width: float | Floats) -> tuple[Floats, Floats]:
        """The covered parts of the lowest and the highest cell of each channel; a column of half widths gives rows."""
        covered = np.minimum(2.0 * half_width - (reach - step), 2.0 * step)  # of both cells together
        low = np.clip(covered * lowest / (lowest + highest), covered - step, step)
        return low, covered - low

    def log_likelihood(half_width: float | Floats) -> Any:  # noqa: ANN401 - one, or a column of them
        low, high = parts(half_width)
        if one.any():
            low, high = np.where(one, 1.0, low), np.where(one, 1.0, high)
        found = lowest * np.log(low) + highest * np.log(high)
        found += np.where(one, n * np.log(np.minimum(step, 2.0 * half_width)), between)
        return found.sum(axis=-1, keepdims=np.ndim(half_width) > 0) - n.sum() * np.log(2.0 * half_width)

    longest = float(reach.max())
    low, high = 0.5 * max(longest - step, 1e-3 * step), 0.5 * (longest + step)
    grid = np.linspace(low, high, _GRID)[1:]
    likelihoods = log_likelihood(grid[:, np.newaxis])[:, 0]
    best = int(np.flatnonzero(likelihoods >= likelihoods.max() - _TIE)[-1])  # two levels only give a bound
    bounds = (grid[best - 1] if best else low + 1e-6 * step, grid[min(best + 1, len(grid) - 1)])
    found = optimize.minimize_scalar(
        lambda half_width: -log_likelihood(half_width), bounds=bounds, method="bounded", options={"xatol": 1e-6 * step}
    )
    half_width = float(found.x)
    centres = np.where(one, bottom, bottom + 0.5 * step - parts(half_width)[0] + half_width)
    return Fit(half_width, centres, 0.5 * step, float(log_likelihood(half_width)))


FAMILIES = (
    Family(
        "gaussian",
        "sd",
        fit_gaussian,
        draw=lambda random, sd, n: random.normal(0.0, sd, n),
        cumulative=lambda x, sd: special.ndtr(x / sd),
    ),
    Family(
        "uniform",
        "half_width",
        fit_uniform,
        draw=lambda random, half, n: random.uniform(-half, half, n),
        cumulative=lambda x, half: np.clip((x + half) / (2.0 * half), 0.0, 1.0),
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """The noise of a sensor.

    family: The more likely family.
    parameter: The standard deviation or half width.
    interval: The interval of the parameter at CONFIDENCE.
    aic_difference: Excess of the other family's criterion; below 2 the families cannot be distinguished.
    p_value: Probability of a larger distance between fitted and empirical distribution, if the noise is of this family.
    levels, centres: The measurements, and what each channel would measure without noise.
    """

    family: Family
    parameter: float
    interval: tuple[float, float]
    aic_difference: float
    p_value: float
    levels: Levels
    centres: Floats


def fit_noise(levels: Levels, random: np.random.Generator) -> Noise:
    """The noise in measurements; a channel must have three levels or more."""
    fits = [(family, family.fit(levels)) for family in FAMILIES]
    family, fit = max(fits, key=lambda each: each[1].log_likelihood)
    (other,) = (each for _, each in fits if each is not fit)
    simulated = [_simulated(levels, family, fit, random) for _ in range(SIMULATIONS)]
    refits = [family.fit(each) for each in simulated]
    distance = _distance(levels, family, fit)
    farther = sum(_distance(one, family, refit) >= distance for one, refit in zip(simulated, refits, strict=True))
    ratios = np.array([each.parameter for each in refits]) / fit.parameter
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, middle, high = (fit.parameter / float(ratio) for ratio in np.quantile(ratios, [1.0 - tail, 0.5, tail]))
    return Noise(
        family=family,
        parameter=middle,
        interval=(low, high),
        aic_difference=2.0 * (fit.log_likelihood - other.log_likelihood),
        p_value=(1 + farther) / (1 + SIMULATIONS),
        levels=levels,
        centres=fit.centres,
    )


def _simulated(levels: Levels, family: Family, fit: Fit, random: np.random.Generator) -> Levels:
    channel = np.repeat(np.arange(len(fit.centres)), levels.counts)
    centres = fit.centres + random.uniform(-fit.slack, fit.slack, len(fit.centres))
    noise = family.draw(random, fit.parameter, len(channel))
    return levels_of(channel, centres[channel] + noise, levels.step)


def _distance(levels: Levels, family: Family, fit: Fit) -> float:
    """Kolmogorov's distance between the distributions of noise and measurements, at the middle of cells."""
    centres = fit.centres[levels.channel]
    low, high = (family.cumulative(edge - centres, fit.parameter) for edge in levels.edges)
    place = 0.5 * (low + high)
    order = np.argsort(place)
    below = np.cumsum(levels.count[order]) / levels.count.sum()
    return float(np.abs(below - place[order]).max())
