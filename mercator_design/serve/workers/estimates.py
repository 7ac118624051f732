"""Estimates of the duration of races, from a few timed experiments."""

import functools
import statistics
import time
from dataclasses import dataclass

from mercator_design.designer import Designer
from mercator_design.results.analysis.comparison import n_compared
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers.sources import MissionSource
from mercator_design.sim.simulate import Simulator

_SECONDS = 2.0
"""Computing time of the timed experiments [s]."""
_MIN_RUNS, _MAX_RUNS = 3, 40
_ASKED = {"halving": 0.5e-3, "tpe": 2.5e-3, "cma-es": 2.5e-3}
_ASKED_USUALLY = 1e-3
"""Computing time of a method for an experiment [s], measured on two slow cores."""
_STARTED = 3.0, 12.0
"""Time of the start of a race and of its report [s]: low and high."""
_QUICKER, _SLOWER = 0.5, 2.0
"""Factors between experiments of good and of random designs: robots touch less, or more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """The computing time of a race; low and high are the ends of a range.

    experiment: Mean of an experiment [s].
    timed: Number of timed experiments.
    experiments: Number of experiments, with those of tests and report.
    core_seconds: Total on all cores [s], low and high.
    seconds: Time from the start of the race to its report [s], low and high.
    """

    experiment: float
    timed: int
    experiments: int
    core_seconds: tuple[float, float]
    seconds: tuple[float, float]


def cost_of(request: RaceRequest, limits: UserLimits, cores: int) -> Cost:
    """The computing time of the race of a job.

    Args:
        request: The request of the job.
        limits: Limits of the service.
        cores: Number of experiments at the same time.

    Raises:
        MercatorError: The mission is not valid, or a race of it cannot begin.
    """
    source = MissionSource.of(request)
    simulator = Simulator(source.read(limits))
    Designer(simulator, budget=request.budget, seed=request.seed, flavour=request.flavour, method=request.method)
    compared = n_compared(request.flavour, request.test_runs)
    times = computing_times(source, request.flavour, limits)
    experiment = statistics.fmean(times)
    error = statistics.stdev(times) / len(times) ** 0.5 if len(times) > 1 else experiment
    n = request.budget + request.test_runs + compared
    asked = request.budget * _ASKED.get(request.method, _ASKED_USUALLY)
    low, high = _QUICKER * max(0.0, experiment - error), _SLOWER * (experiment + error)
    return Cost(
        experiment=experiment,
        timed=len(times),
        experiments=n,
        core_seconds=(_STARTED[0] + n * low + 0.5 * asked, _STARTED[1] + n * high + 2.0 * asked),
        seconds=(_STARTED[0] + n * low / cores + 0.5 * asked, _STARTED[1] + n * high / cores + 2.0 * asked),
    )


@functools.lru_cache(maxsize=64)
def computing_times(source: MissionSource, flavour: str, limits: UserLimits) -> tuple[float, ...]:
    """Computing times of some experiments [s], of random control software; remembered for other budgets."""
    simulator = Simulator(source.read(limits))
    designer = Designer(simulator, budget=_MAX_RUNS * 100, seed=1, flavour=flavour, method="random")
    simulator.rehearse(announce=lambda _: None, flavour=flavour)
    times: list[float] = []
    for number, configuration in enumerate(dict.fromkeys(one.configuration for one in designer.optimizer.ask())):
        if number >= _MIN_RUNS and (number >= _MAX_RUNS or sum(times) >= _SECONDS):
            break
        software, start = designer.software(configuration), time.thread_time()
        simulator.run(software, number)
        times.append(time.thread_time() - start)
    return tuple(times)
