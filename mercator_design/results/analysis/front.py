"""The front of a race by several objectives: which of its designs none beats in all, and by what they were measured.

Candidates are those of the race's own results (race/elimination/fronts.py), with the winner. They run again on the
fresh instances on which the winner is tested; those that no other dominates there, by their means, are the front.
Without tests, the results of the race take their place, which are optimistic.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.designer import Designer
from mercator_design.race.elimination.fronts import MAX_FRONT, front_candidates, hypervolume, nondominated
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.events import ExperimentDone, IterationEnded, TestDone
from mercator_design.race.session.record import Record
from mercator_design.software.architectures import decoded, text_of
from mercator_design.system.csv_text import csv_text

FRONT = "front.csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontDesign:
    """A candidate for the front.

    scores: By each objective.
    is_fresh: Whether they are of fresh instances; else of the race.
    is_on_front: Whether no other candidate is at least as good by all means, and better by one.
    """

    configuration: int
    scores: tuple[Scores, ...]
    is_fresh: bool
    is_on_front: bool

    @property
    def means(self) -> list[float]:
        """By each objective."""
        return [one.mean for one in self.scores]

    @property
    def errors(self) -> list[float]:
        """The standard errors of the means; 0 of a single score."""
        return [(one.standard_deviation or 0.0) / math.sqrt(len(one.values)) for one in self.scores]

    @property
    def file(self) -> str:
        """Its file in the run folder, if it is on the front."""
        return file_on_front(self.configuration)


def file_on_front(configuration: int | None) -> str:
    """The name of the file of a configuration on the front."""
    return f"front-{configuration}.txt"


def front_of(designer: Designer, record: Record) -> list[FrontDesign]:
    """The winner and the candidates for the front, in the order of the first objective, the best first.

    Of designs with equal scores on all instances, only one is returned, as they do the same. Nothing is returned for a
    race by one cost, or that has no winner yet.
    """
    winner = record.view.leader
    if designer.n_objectives == 1 or winner is None:
        return []
    tests: dict[int, list[TestDone]] = {}
    for where in sorted(record.tests):
        if (one := record.tests[where]).scores:
            tests.setdefault(one.configuration, []).append(one)
    if len(tests) > 1:
        results: dict[int, Sequence[ExperimentDone | TestDone]] = {**tests}
    else:
        raced = record.view.results()
        numbers = dict.fromkeys([winner, *_candidates(_tables(designer, record, raced), record.view.iterations)])
        results = {number: [one for one in raced if one.configuration == number and one.scores] for number in numbers}
    results = _different(results, winner)
    mission = designer.simulator.mission
    ranges = mission.possible_by_objective()
    scores = {
        number: tuple(Scores(tuple(one.scores[k] for one in own), ranges[k]) for k in range(len(ranges)))
        for number, own in results.items()
    }
    costs = np.array([mission.costs([one.mean for one in own]) for own in scores.values()])
    found = [
        FrontDesign(configuration=number, scores=own, is_fresh=len(tests) > 1, is_on_front=bool(is_on))
        for (number, own), is_on in zip(scores.items(), nondominated(costs), strict=True)
    ]
    return [found[k] for k in costs[:, 0].argsort(kind="stable")]


def _different(
    results: Mapping[int, Sequence[ExperimentDone | TestDone]], winner: int
) -> dict[int, Sequence[ExperimentDone | TestDone]]:
    """One configuration of each set with equal scores on all instances: the winner, or the first."""
    found: dict[object, int] = {}
    for number in sorted(results, key=lambda one: (one != winner, one)):
        found.setdefault(tuple((one.seed, one.scores) for one in results[number]), number)
    return {number: results[number] for number in found.values()}


def front_csv(designer: Designer, record: Record, designs: Sequence[FrontDesign]) -> str:
    """The designs as CSV, a row each: means and standard errors by each objective."""
    names = designer.simulator.mission.objective_names
    columns = [f"{name} {what}" for name in names for what in ("mean", "standard error")]
    rows: list[list[object]] = [
        ["configuration", "on_front", "winner", *columns, "runs", "fresh", "file", "fsm"],
    ]
    for one in designs:
        figures = [figure for pair in zip(one.means, one.errors, strict=True) for figure in pair]
        is_winner, file = one.configuration == record.view.winner, one.file if one.is_on_front else ""
        fsm = text_of(decoded(record.configurations[one.configuration], designer.flavour))
        runs = len(one.scores[0].values)
        rows.append([one.configuration, one.is_on_front, is_winner, *figures, runs, one.is_fresh, file, fsm])
    return csv_text(rows)


class Growth(NamedTuple):
    """The hypervolume of the front after each iteration, by the results of the race until then."""

    experiments: list[int]
    volumes: list[float]


def growth_of_front(designer: Designer, record: Record) -> Growth:
    """How the front grew: the share that it dominates of the box between the best and the worst of all fronts."""
    fronts, experiments = list[Floats](), list[int]()
    for place, ended in enumerate(record.view.iterations, start=1):
        until = [one for one in record.view.results() if one.iteration <= ended.iteration]
        tables = _tables(designer, record, until)
        numbers = _candidates(tables, record.view.iterations[:place])
        fronts.append(np.array([[fmean(own[number].values()) for own in tables] for number in numbers]))
        experiments.append(len(until))
    known = [front for front in fronts if len(front)]
    if not known:
        return Growth([], [])
    everywhere = np.vstack(known)
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    reference = np.full(len(low), 1.0 + 1e-9)  # an end of a front that is the worst of all adds nothing
    volumes = [hypervolume((front - low) / span, reference) if len(front) else 0.0 for front in fronts]
    return Growth(experiments, volumes)


def _candidates(tables: Sequence[Sequence[Mapping[int, float]]], ended: Sequence[IterationEnded]) -> list[int]:
    return front_candidates(tables, {number for one in ended for number in one.elites}, MAX_FRONT)


def _tables(designer: Designer, record: Record, results: Sequence[ExperimentDone]) -> list[list[dict[int, float]]]:
    """By each objective, of each configuration its costs by instance; infinite where an experiment failed."""
    tables: list[list[dict[int, float]]] = [[{} for _ in record.configurations] for _ in range(designer.n_objectives)]
    for one in results:
        cost = designer.cost_of(one)
        for k, table in enumerate(tables):
            table[one.configuration][one.instance] = cost[k] if isinstance(cost, tuple) else cost
    return tables
