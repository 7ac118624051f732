"""Scores and statistics of many controllers over many seeds: theirs, ours, and whether one could be the other.

Ours run with other seeds, so only distributions can agree, and what can be seen is limited by how often the original
was run. Two things are told from that noise:

* Is a single controller's sample different? Mann-Whitney for each controller and statistic, Benjamini-Hochberg at 1 %
  over all of a mission. If nothing differs, a mission has a rejection by luck in one file of a hundred.
* How high can the rank correlation of the means be? As high as that of our simulator with itself: some of our seeds,
  as many as the original has, play the recording, the others play us.

All controllers of a recording share their seeds, hence their starting poses; so do ours, which keeps their common luck
common here too.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks.argos.recordings import RecordingError, mission_and_robot
from benchmarks.argos.repeat import Original
from mercator_design.errors import FsmError, MercatorError
from mercator_design.fsm import Pfsm, Readings, parse
from mercator_design.missions.floor import ColourName, rgb
from mercator_design.race.executors import ThreadExecutor, in_order
from mercator_design.seeds import instance_seed
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.swarm import History

COLOURS: tuple[ColourName, ...] = ("black", "gray", "green", "red", "yellow")
MOST_NEIGHBOURS, MOST_STATES = 10, 4  # of the histograms; the last bin of the first is "9 or more"
SINGLE = (*COLOURS, "prox", "front", "nn", "speed_mps", "trans", "r", "spot")
FALSE_DISCOVERIES = 0.01
WANTED_CORRELATION = 0.97
RESAMPLES = 500
_NOT_RECORDED = 2**31  # seeds from here on

Columns = dict[str, np.ndarray]  # name of a statistic -> its value in each run; "score" among them


def statistics(score: float, history: History, control_period: float) -> dict[str, float]:
    """Score and statistics of an experiment that was recorded: averages over all robots and cycles."""
    poses, after, readings = history.poses, history.states, history.readings
    x, y = readings[..., 0], readings[..., 1]  # proximity
    near = np.hypot(x, y) >= 0.1 - 1e-12
    ground = readings[..., Readings._fields.index("ground_red") :][..., :3]
    neighbours = readings[..., Readings._fields.index("neighbours")]
    before = np.vstack([np.zeros_like(after[:1]), after[:-1]])
    away = np.hypot(poses[1:, :, 0], poses[1:, :, 1])
    steps = np.hypot(*np.moveaxis(np.diff(poses[..., :2], axis=0), -1, 0))
    found: dict[str, float | np.floating] = {}
    found |= {name: np.mean(np.all(ground == rgb(name), axis=-1)) for name in COLOURS}
    found |= {
        "score": score,
        "prox": np.mean(near),
        "front": np.mean(near & (x >= 0.0)),
        "nn": np.mean(neighbours),
        "speed_mps": np.mean(steps) / control_period,
        "trans": np.mean(before != after),
        "r": np.mean(away),
        "spot": np.mean(away <= 0.5),
    }
    bins = np.minimum(neighbours, MOST_NEIGHBOURS - 1).astype(int).ravel()
    for k, count in enumerate(np.bincount(bins, minlength=MOST_NEIGHBOURS)):
        found[f"nn_hist[{k}]"] = count / bins.size
    for k, count in enumerate(np.bincount(before.ravel(), minlength=MOST_STATES)):
        found[f"occ[{k}]"] = count / before.size
    return {name: float(value) for name, value in found.items()}


def recorded_columns(run: Mapping[str, Any]) -> Columns:
    """Theirs: failed runs have no score, and their statistics do not count either.

    Raises:
        RecordingError: if scores or statistics are not numbers.
    """
    where = f"{run['mission']}, {run['name']}"

    def numbers(name: str, values: object, shape: tuple[int, ...]) -> np.ndarray:
        try:
            array = np.array(values, dtype=float)  # None becomes nan
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.shape != shape:
            raise RecordingError(f"{where}: {name}: expected {' x '.join(map(str, shape))} numbers")
        return array

    scores = run["scores"]
    if not isinstance(scores, list):
        raise RecordingError(f"{where}: scores: expected a list")
    n = len(scores)
    found = {"score": numbers("scores", scores, (n,))}
    ran = np.isfinite(found["score"])
    statistics = run.get("stats") or {}
    if not isinstance(statistics, Mapping):
        raise RecordingError(f"{where}: stats: expected an object")
    for name in SINGLE:
        if statistics.get(name) is not None:
            found[name] = numbers(name, statistics[name], (n,))
    for name, bins in (("nn_hist", MOST_NEIGHBOURS), ("occ", MOST_STATES)):
        if statistics.get(name) is not None:
            rows = [row if row is not None else [None] * bins for row in statistics[name]]
            for k, column in enumerate(numbers(name, rows, (n, bins)).T):
                found[f"{name}[{k}]"] = column
    return {name: column[ran] for name, column in found.items()}


@dataclass
class Controller:
    """One controller on a mission, here and there."""

    name: str
    theirs: Columns
    ours: Columns  # in the order of our seeds, which all controllers of a mission share
    repeated: Columns | None = None  # from the recorded seeds with the original's random numbers, in theirs' order
    # Of one whose samples differ: from seeds of ours, but with the original's generators. What then no longer differs
    # comes from rand(), which is the same in all runs of the original, so that they are not independent.
    shuffled: Columns | None = None


@dataclass
class Comparison:
    """All controllers of a mission."""

    mission: str
    controllers: list[Controller] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # a sentence each: what could not be compared, and why

    def means(self, name: str) -> np.ndarray:
        """Means (2, controllers) of a statistic, theirs and ours, where there are both."""
        pairs = [(c.theirs[name].mean(), c.ours[name].mean()) for c in self.controllers if len(c.theirs.get(name, ()))]
        return np.array(pairs).reshape(-1, 2).T

    @property
    def recorded_runs(self) -> int:
        """Of most controllers."""
        return int(np.median([len(c.theirs["score"]) for c in self.controllers]))


def compare(
    meta: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
    *,
    experiments: int | None,
    seed: int,
    jobs: int,
    tell: Callable[[str], None],
) -> list[Comparison]:
    """Run every controller of a file of scores, mission by mission.

    Args:
        meta: The file's; `missions` says what differs from the shipped mission files.
        runs: The file's.
        experiments: How many of ours for each controller; None: five times as many as were recorded.
        seed: Master seed of ours.
        jobs: Experiments at once.
        tell: Called with a line on what is being run.
    """
    known = meta.get("missions", {})
    found = []
    for name in dict.fromkeys(run["mission"] for run in runs):
        comparison = Comparison(name)
        found.append(comparison)
        of_mission = [run for run in runs if run["mission"] == name]
        try:
            settings = known.get(name, {}) if isinstance(known, Mapping) else {}
            if not isinstance(settings, Mapping):
                raise RecordingError(f"mission '{name}': expected an object")
            simulator = Simulator(*mission_and_robot(name, settings))
            simulator.check_placement()
            original = Original(simulator)
        except MercatorError as error:
            comparison.left_out.append(f"{name}: {len(of_mission)} controllers: {error}")
            continue
        tell(f"{name}: {len(of_mission)} controllers")
        pfsms = []
        for run in of_mission:
            try:
                pfsm = parse(run["fsm"], tolerate=lambda _: None)
                theirs = recorded_columns(run)
            except (FsmError, RecordingError) as error:
                comparison.left_out.append(f"{name}: {run['name']}: {error}")
                continue
            failed = len(run["scores"]) - len(theirs["score"])
            if failed:
                comparison.left_out.append(
                    f"{name}: {run['name']}: {failed} of {len(run['scores'])} runs have no score"
                )
            if not len(theirs["score"]):
                continue
            seeds = [
                instance_seed(seed, "evaluation", instance) for instance in range(experiments or 5 * len(run["scores"]))
            ]
            ours = _columns(seeds, partial(_ours, simulator, pfsm), jobs)
            again = recorded_seeds(run)
            repeated = _columns(again, partial(_repeated, original, pfsm), jobs) if again else None
            comparison.controllers.append(Controller(run["name"], theirs, ours, repeated))
            pfsms.append(pfsm)
        differing = {test.controller for kind in (True, False) for test in rejected(tests(comparison, of_scores=kind))}
        for pfsm, controller in zip(pfsms, comparison.controllers, strict=True):
            if controller.name in differing:
                seeds = [_NOT_RECORDED + k for k in range(len(controller.ours["score"]))]
                controller.shuffled = _columns(seeds, partial(_repeated, original, pfsm), jobs)
    return found


def recorded_seeds(run: Mapping[str, Any]) -> list[int]:
    """Those of the runs that have a score; none if they are not all recorded, or one was taken from the clock (0)."""
    seeds = run.get("seeds")
    if not isinstance(seeds, list) or len(seeds) != len(run["scores"]):
        return []
    if not all(isinstance(seed, int) and 0 < seed < 2**32 for seed in seeds):
        return []
    return [seed for seed, score in zip(seeds, run["scores"], strict=True) if score is not None]


def same(theirs: Columns, ours: Columns, names: Sequence[str]) -> np.ndarray:
    """Whether runs (n,) have the same values, as far as they are recorded: six digits of scores, six decimals."""
    agree = [
        np.isclose(theirs[name], ours[name], rtol=1e-5 if name == "score" else 0.0, atol=1.5e-6, equal_nan=False)
        | np.isnan(theirs[name])
        for name in names
    ]
    return np.asarray(np.all(agree, axis=0))


def _ours(simulator: Simulator, pfsm: Pfsm, seed: int) -> dict[str, float]:
    outcome = simulator.run(pfsm, seed, record=True)
    return statistics(outcome.score, outcome.recording.history, simulator.mission.control_period)


def _repeated(original: Original, pfsm: Pfsm, seed: int) -> dict[str, float]:
    score, history = original.run(pfsm, seed)
    return statistics(score, history, original.mission.control_period)


def _columns(seeds: Sequence[int], measure: Callable[[int], dict[str, float]], jobs: int) -> Columns:
    with ThreadExecutor(jobs) as executor:
        rows = in_order(executor, measure, seeds)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True)
class Test:
    """Of one controller's statistic: is theirs another distribution than ours?"""

    controller: str
    statistic: str
    p: float


def tests(comparison: Comparison, *, of_scores: bool) -> list[Test]:
    """Tests of a mission's scores, or of all its statistics."""
    return [
        Test(controller.name, name, p_value(name, column, controller.ours[name]))
        for controller in comparison.controllers
        for name, column in controller.theirs.items()
        if (name == "score") == of_scores and np.isfinite(column).any()
    ]


def p_value(name: str, theirs: np.ndarray, ours: np.ndarray) -> float:
    """Of the Mann-Whitney test, to as many digits as are recorded: six of scores, six decimals of statistics."""
    from scipy.stats import mannwhitneyu

    theirs = theirs[np.isfinite(theirs)]
    digits = 5 - math.floor(math.log10(max(1.0, np.abs(theirs).max()))) if name == "score" else 6
    theirs, ours = np.round(theirs, digits), np.round(ours, digits)
    return 1.0 if len({*theirs, *ours}) == 1 else float(mannwhitneyu(theirs, ours).pvalue)


def comes_from_shuffling(comparison: Comparison, test: Test) -> bool:
    """Whether a rejected test would not be, had our runs been shuffled as all of the original's."""
    one = next(c for c in comparison.controllers if c.name == test.controller)
    if one.shuffled is None:
        return False
    p = p_value(test.statistic, one.theirs[test.statistic], one.shuffled[test.statistic])
    return p > FALSE_DISCOVERIES


def rejected(tests: Sequence[Test], rate: float = FALSE_DISCOVERIES) -> list[Test]:
    """Those that Benjamini and Hochberg's procedure rejects, the clearest first."""
    ordered = sorted(tests, key=lambda test: test.p)
    passing = [k for k, test in enumerate(ordered, start=1) if test.p <= rate * k / len(ordered)]
    return ordered[: passing[-1]] if passing else []


def correlation(some: np.ndarray, others: np.ndarray) -> float:
    """Spearman's; nan if either is constant or too short."""
    from scipy.stats import spearmanr

    if len(some) < 3 or len(set(some)) == 1 or len(set(others)) == 1:
        return math.nan
    return float(spearmanr(some, others).statistic)


def correlation_limits(comparison: Comparison, name: str = "score", seed: int = 1) -> tuple[float, float]:
    """What Spearman's correlation of means would be if both were one simulator: the median, and the lowest 1 %."""
    random = np.random.default_rng(seed)
    ours = np.array([c.ours[name] for c in comparison.controllers if len(c.theirs.get(name, ()))])
    n = min(comparison.recorded_runs, ours.shape[1] // 2)
    found = []
    for _ in range(RESAMPLES):
        order = random.permutation(ours.shape[1])
        found.append(correlation(ours[:, order[:n]].mean(axis=1), ours[:, order[n:]].mean(axis=1)))
    return float(np.median(found)), float(np.quantile(found, 0.01))


def halves(comparison: Comparison, name: str = "score", seed: int = 1) -> float:
    """Spearman's correlation of means between two halves of the recorded seeds: the median over ways to halve them."""
    random = np.random.default_rng(seed)
    n = comparison.recorded_runs
    theirs = np.array([c.theirs[name] for c in comparison.controllers if len(c.theirs.get(name, ())) == n])
    found = []
    for _ in range(RESAMPLES // 5):
        order = random.permutation(n)
        if theirs.size and n > 1:
            some, others = theirs[:, order[: n // 2]], theirs[:, order[n // 2 :]]
            found.append(correlation(some.mean(axis=1), others.mean(axis=1)))
    return float(np.median(found)) if found else math.nan


def bias(comparison: Comparison, name: str) -> tuple[float, float]:
    """Ours less theirs of a statistic, averaged over the controllers, and its standard error.

    The error is that over seeds, which the controllers share, so that their common luck is counted once.
    """
    n = comparison.recorded_runs
    pairs = [(c.theirs[name], c.ours[name]) for c in comparison.controllers if len(c.theirs.get(name, ())) == n]
    if not pairs or n < 2:
        return math.nan, math.nan
    theirs, ours = (np.nanmean(side, axis=0) for side in zip(*pairs, strict=True))
    error = math.sqrt(theirs.var(ddof=1) / len(theirs) + ours.var(ddof=1) / len(ours))
    return float(ours.mean() - theirs.mean()), error
