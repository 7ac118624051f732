"""Scores and statistics of many controllers over many seeds: theirs, ours, and whether one could be the other.

Ours run with other seeds, so only distributions can agree, and what can be seen is limited by how often the original
was run. Two things are told from that noise:

* Is a single controller's sample different? Mann-Whitney for each controller and statistic, Benjamini-Hochberg at 1 %
  over all scores of a file, and over all statistics: if nothing differs, either rejects anything in one file of a
  hundred. Controllers that are rejected are looked at again in the light of how the original shuffles; see `judge`.
* How high can the rank correlation of the means be? As high as that of our simulator with itself: some of our seeds,
  as many as the original has, play the recording, the others play us.

All controllers of a recording share their seeds, hence their starting poses; so do ours, which keeps their common luck
common here too.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from benchmarks.argos.recordings import RecordingError, mission_and_robot, shipped_with_original
from benchmarks.argos.repeat import Original
from benchmarks.two_samples import FALSE_DISCOVERIES, rejected
from mercator_design.config.colours import ColourName, rgb
from mercator_design.errors import MercatorError
from mercator_design.fsm import Pfsm, Readings, parse
from mercator_design.race.executors.executor import in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.seeds import instance_seed
from mercator_design.sim.kernels.swarm import History
from mercator_design.sim.simulate import Simulator
from mercator_design.studies.statistics.power import visible_shift
from mercator_design.studies.statistics.rank_tests import rank_sum

COLOURS: tuple[ColourName, ...] = ("black", "gray", "green", "red", "yellow")
MAX_NEIGHBOURS, MAX_STATES = 10, 4  # of the histograms; the last bin of the first is "9 or more"
SINGLE = (*COLOURS, "prox", "front", "nn", "speed_mps", "trans", "r", "spot")
MIN_RUNS = 50  # of ours for each controller
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
    bins = np.minimum(neighbours, MAX_NEIGHBOURS - 1).astype(int).ravel()
    for k, count in enumerate(np.bincount(bins, minlength=MAX_NEIGHBOURS)):
        found[f"nn_hist[{k}]"] = count / bins.size
    for k, count in enumerate(np.bincount(before.ravel(), minlength=MAX_STATES)):
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
        except (OverflowError, TypeError, ValueError):
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
    for name, bins in (("nn_hist", MAX_NEIGHBOURS), ("occ", MAX_STATES)):
        rows = statistics.get(name)
        if rows is not None:
            if isinstance(rows, list):
                rows = [row if row is not None else [None] * bins for row in rows]
            for k, column in enumerate(numbers(name, rows, (n, bins)).T):
                found[f"{name}[{k}]"] = column
    found = {name: column[ran] for name, column in found.items()}
    return {name: column for name, column in found.items() if name == "score" or np.isfinite(column).any()}


@dataclass(eq=False)
class Controller:
    """One controller on a mission, here and there."""

    name: str
    theirs: Columns
    ours: Columns  # in the order of our seeds, which all controllers of a mission share
    pfsm: Pfsm
    seeds: list[int]  # of their runs, as far as they are known
    repeated: Columns | None = None  # from the recorded seeds with the original's random numbers, in theirs' order
    # From as many seeds as ours, which nobody used, with the original's random numbers; empty if that was not needed.
    shuffled: Columns = field(default_factory=dict)

    @property
    def is_shuffled(self) -> bool:
        """Whether it has a state in which the order of conditions matters."""
        return any(len(state.transitions) > 1 for state in self.pfsm.states)


@dataclass
class Comparison:
    """All controllers of a mission."""

    mission: str
    controllers: list[Controller] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # a sentence each: what could not be compared, and why
    failed: list[str] = field(default_factory=list)  # a sentence each: whose runs were recorded as failed
    original: Original | None = None  # repeats its runs, if it can be run and is one of the original's own files
    place: str = ""  # which mission and robot model of ours it is

    def means(self, name: str) -> np.ndarray:
        """Means (2, controllers) of a statistic, theirs and ours, where there are both."""
        pairs = [(np.nanmean(c.theirs[name]), c.ours[name].mean()) for c in self.controllers if name in c.theirs]
        return np.array(pairs).reshape(-1, 2).T

    @property
    def recorded_runs(self) -> int:
        """Of most controllers."""
        return int(np.bincount([len(c.theirs["score"]) for c in self.controllers]).argmax())

    @property
    def our_runs(self) -> int:
        """Of most controllers."""
        return int(np.bincount([len(c.ours["score"]) for c in self.controllers]).argmax())


def compare(
    meta: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
    *,
    experiments: int | None,
    seed: int,
    jobs: int,
    report: Callable[[str], None],
    files: Mapping[str, Path] = MappingProxyType({}),
    flavour: str = "watermelon",
) -> list[Comparison]:
    """Run every controller of a file of scores, mission by mission.

    Args:
        meta: The file's; `missions` says what differs from the shipped mission files.
        runs: The file's.
        experiments: How many of ours for each controller; None: five times as many as were recorded, and MIN_RUNS.
        seed: Master seed of ours.
        jobs: Experiments at once.
        report: Called with a line on what is being run.
        files: By name the missions that stand for those of the file.
        flavour: Of the FSMs.
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
            simulator = Simulator(*mission_and_robot(name, settings, files))
            simulator.check_placement()
            comparison.place = f"{simulator.mission.name}, robot model {simulator.robot_model.name}"
            if shipped_with_original(name, settings, files):
                comparison.original = Original(simulator)
        except MercatorError as error:
            comparison.left_out.append(f"{name}: {len(of_mission)} controllers: {error}")
            continue
        report(f"{name}: {len(of_mission)} controllers")
        for run in of_mission:
            try:
                pfsm = parse(run["fsm"], flavour, tolerate=lambda _: None)
                theirs = recorded_columns(run)
                ran, recorded = len(theirs["score"]), len(run["scores"])
                if ran < recorded:
                    comparison.failed.append(f"{name}: {run['name']}: {recorded - ran} of {recorded} runs")
                if not ran:
                    raise RecordingError("no run has a score")
                n = experiments or max(MIN_RUNS, 5 * recorded)
                ours = measured_columns(
                    [instance_seed(seed, "evaluation", k) for k in range(n)], partial(_ours, simulator, pfsm), jobs
                )
                seeds = recorded_seeds(run)
                again = None
                if seeds and comparison.original:
                    again = measured_columns(seeds, partial(_repeated, comparison.original, pfsm), jobs)
            except MercatorError as error:
                comparison.left_out.append(f"{name}: {run['name']}: {error}")
                continue
            comparison.controllers.append(Controller(run["name"], theirs, ours, pfsm, seeds, again))
    return found


def recorded_seeds(run: Mapping[str, Any]) -> list[int]:
    """Those of the runs that have a score; none if they are not all recorded, or one was taken from the clock (0)."""
    seeds = run.get("seeds")
    if not isinstance(seeds, list) or len(seeds) != len(run["scores"]):
        return []
    if not all(isinstance(seed, int) and 0 < seed < 2**32 for seed in seeds):
        return []
    ran = np.isfinite(np.array(run["scores"], dtype=float))
    return [seed for seed, has_score in zip(seeds, ran, strict=True) if has_score]


def shuffle_alike(comparisons: Sequence[Comparison], *, jobs: int) -> None:
    """Run controllers that are rejected, and whose conditions are shuffled, with the original's random numbers too."""
    differing = {test.controller for kind in (True, False) for test in first_tests(comparisons, of_scores=kind)[1]}
    for comparison in comparisons:
        for one in comparison.controllers:
            if one in differing and one.is_shuffled and comparison.original:
                unused = (seed for seed in itertools.count(_NOT_RECORDED) if seed not in one.seeds)
                seeds = list(itertools.islice(unused, len(one.ours["score"])))
                one.shuffled = measured_columns(seeds, partial(_repeated, comparison.original, one.pfsm), jobs)


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


def measured_columns(seeds: Sequence[int], measure: Callable[[int], dict[str, float]], jobs: int) -> Columns:
    """What an experiment measures, by its name, over the seeds."""
    with ThreadExecutor(jobs) as executor:
        rows = in_order(executor, measure, seeds)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True)
class Test:
    """Of one controller's statistic: is theirs another distribution than ours?"""

    mission: str
    controller: Controller
    statistic: str
    p: float


@dataclass(frozen=True)
class Excuse:
    """A test that rejected, until the controller ran with its conditions shuffled as the original's."""

    first: Test
    final: Test
    p_effect: float  # that ours, with and without that, are of one distribution


@dataclass(frozen=True)
class Judgement:
    """What the tests of all scores of a file, or of all statistics, come to."""

    tests: list[Test]
    rejected: list[Test]
    excused: list[Excuse]
    lapsed: list[Test]  # rejected at first, and now no longer because fewer others are


def first_tests(comparisons: Sequence[Comparison], *, of_scores: bool) -> tuple[list[Test], list[Test]]:
    """Tests of all scores, or of all statistics; and which of them are rejected, ours as they are."""
    tests = [
        Test(comparison.mission, controller, name, p_value(name, column, controller.ours[name]))
        for comparison in comparisons
        for controller in comparison.controllers
        for name, column in controller.theirs.items()
        if (name == "score") == of_scores
    ]
    return tests, [tests[k] for k in rejected([test.p for test in tests])]


def judge(comparisons: Sequence[Comparison], *, of_scores: bool) -> Judgement:
    """Test, excuse, and test again.

    The original shuffles the conditions of a state by the C library's rand(), which is the same in all its runs: they
    are no independent sample of what its random numbers could do. So a controller that is rejected is compared again,
    with as many runs of ours that are shuffled alike. That is no second chance for a sample to pass by luck:

    * Only where a state has more than one condition.
    * Only if shuffling alike matters: ours with and without it must differ themselves, in the statistic that was
      rejected, by the same test at FALSE_DISCOVERIES divided by all statistics looked at. As ours are more than theirs,
      this sees what the rejection saw. A difference that has another cause remains.
    * All p of such a controller are replaced, and the procedure is applied to the whole family again.
    """
    tests, differing = first_tests(comparisons, of_scores=of_scores)
    doubted = [test for test in differing if test.controller.shuffled]
    effects = {test: _p_of(test, test.controller.ours) for test in doubted}
    shown = {test: p for test, p in effects.items() if p <= FALSE_DISCOVERIES / len(doubted)}
    affected = {test.controller for test in shown}
    finals = {
        test: replace(test, p=_p_of(test, test.controller.theirs))
        for test in tests
        if test in shown or (test.controller in affected and test not in differing)
    }
    final = [finals.get(test, test) for test in tests]
    still = [final[k] for k in rejected([test.p for test in final])]
    return Judgement(
        tests=final,
        rejected=still,
        excused=[Excuse(test, finals[test], p) for test, p in shown.items() if finals[test] not in still],
        lapsed=[test for test in differing if test not in shown and test not in still],
    )


def _p_of(test: Test, columns: Columns) -> float:
    """Of a test's statistic, between these runs and those of ours that are shuffled alike."""
    return p_value(test.statistic, columns[test.statistic], test.controller.shuffled[test.statistic])


def p_value(name: str, theirs: np.ndarray, ours: np.ndarray) -> float:
    """Of the Mann-Whitney test, to as many digits as are recorded: six of scores, six decimals of statistics."""
    theirs = theirs[np.isfinite(theirs)]
    digits = 5 - math.floor(math.log10(max(1.0, np.abs(theirs).max()))) if name == "score" else 6
    return rank_sum(np.round(theirs, digits), np.round(ours, digits))


def visible(comparison: Comparison, tests: int) -> float:
    """The smallest difference of one controller's mean [sd] that would have been found with probability POWER."""
    return visible_shift(comparison.recorded_runs, comparison.our_runs, FALSE_DISCOVERIES / tests)


def can_reject(comparison: Comparison) -> bool:
    """Whether any test can, at these numbers of runs, even if all controllers differ as much as can be."""
    return math.isfinite(visible_shift(comparison.recorded_runs, comparison.our_runs, FALSE_DISCOVERIES))
