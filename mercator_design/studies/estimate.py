"""How long a study will take: experiments that are left, and the time of one on each mission, which is measured."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mercator_design.designer import Designer, Experimenter
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.seeds import generator, instance_seed
from mercator_design.software.architectures import decoded
from mercator_design.studies.layout import Cell
from mercator_design.studies.resolving import Study

N_TIMED = 5
"""Experiments that are timed, after one that compiles and loads what is needed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyEstimate:
    """What is left of a study.

    seconds: Of an experiment, by mission and method.
    experiments: That are left, by mission and method.
    jobs: Experiments that run at once.
    """

    seconds: Mapping[tuple[str, str], float]
    experiments: Mapping[tuple[str, str], int]
    jobs: int

    @property
    def total(self) -> float:
        """Seconds of all experiments that are left, if all workers are busy."""
        return sum(self.seconds[key] * n for key, n in self.experiments.items()) / self.jobs


def estimated(
    study: Study,
    left: Mapping[Cell, int],
    jobs: int,
    *,
    announce: Callable[[str], None],
    clock: Callable[[], float] = time.perf_counter,
) -> StudyEstimate:
    """Time a few experiments of random control software on each mission.

    Args:
        study: The study.
        left: The number of experiments that are left of each cell.
        jobs: Experiments that will run at once.
        announce: Called with a message if there is something to compile.
        clock: Returns the time [s].
    """
    experiments: dict[tuple[str, str], int] = {}
    for cell, n in left.items():
        if n:
            key = cell.mission, cell.method
            experiments[key] = experiments.get(key, 0) + n
    seconds: dict[tuple[str, str], float] = {}
    for mission, method in experiments:
        one = next(cell for cell in left if (cell.mission, cell.method) == (mission, method))
        seconds[mission, method] = _measured(study, one, announce, clock)
    return StudyEstimate(seconds=seconds, experiments=experiments, jobs=jobs)


def _measured(study: Study, cell: Cell, announce: Callable[[str], None], clock: Callable[[], float]) -> float:
    """Mean seconds of an experiment of a cell, in one thread."""
    method, simulator = study.methods[cell.method], study.missions[cell.mission].simulator
    simulator.rehearse(announce, flavour=method.flavour)
    software = [method.made[k % len(method.made)] for k in range(N_TIMED + 1)] if method.made else _random(study, cell)
    run = Experimenter(simulator, flavour_of(method.flavour))
    run((software[0], instance_seed(1, "timing", 0)))
    started = clock()
    for number, one in enumerate(software[1:], start=1):
        run((one, instance_seed(1, "timing", number)))
    return (clock() - started) / N_TIMED


def _random(study: Study, cell: Cell) -> list[Software]:
    designer: Designer = study.designer(cell)
    draws, space = generator(1, "timing"), designer.optimizer.space
    drawn = [
        space.build(lambda parameter, bounds: parameter.quantile(float(draws.random()), bounds))
        for _ in range(N_TIMED + 1)
    ]
    return [decoded(one, designer.flavour) for one in drawn]
