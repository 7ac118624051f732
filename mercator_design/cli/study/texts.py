"""Studies as text: progress on stderr, the state of a folder, what a dry run says."""

import math
from collections import Counter
from datetime import timedelta

from mercator_design.show.text.progress import Display
from mercator_design.studies.estimate import StudyEstimate
from mercator_design.studies.layout import Cell, StudyLayout
from mercator_design.studies.reading import STATES, StudyStatus
from mercator_design.studies.running import StudyProgress
from mercator_design.studies.statistics.comparison import MIN_DESIGNS
from mercator_design.studies.statistics.power import POWER, designs_needed, visible

_MIN_SECONDS, _MIN_EXPERIMENTS = 2.0, 10
"""The least base of a rate."""


class StudyDisplay(Display):
    """Progress of a study: the cell that runs, the experiments of all, their rate, and the time left.

    The rate is counted from the first new experiment on, before which code is compiled, and is told when it has a base.
    """

    _line_of: Cell | None = None
    _first: tuple[float, int] | None = None  # when the first new experiments had ended, and their number

    def note(self, progress: StudyProgress) -> None:
        """Show the progress, in any case when the first experiment of a cell has run."""
        self.known, self._total = progress.known, progress.total
        stage = "assessing" if progress.is_assessed else "racing"
        text = f"cell {progress.number} of {progress.n_cells}: {progress.cell}: {stage}"
        if progress.is_new and progress.cell != self._line_of:
            self._line_of = progress.cell
            self.line.conclude(self._state(text, progress.done))
        elif not self._is_silent():
            self.show(progress.done, text)

    def _rate(self, new: int) -> float:
        if not new:
            return 0.0
        since, before = self._first = self._first or (self.seconds, new)
        seconds, more = self.seconds - since, new - before
        return more / seconds if seconds >= _MIN_SECONDS and more >= _MIN_EXPERIMENTS else 0.0


def status_text(status: StudyStatus, layout: StudyLayout) -> str:
    """The state of a study, with a line for each method on each mission."""
    lines = [
        f"Study      {status.name}: {status.counts['done']} of {len(status.cells)} designs are assessed, "
        f"{status.done} of {status.total} experiments have run"
    ]
    groups = status.counts_by_kind
    names = [
        f"{mission}, {method}{f', budget {budget}' if budget and len(layout.budgets) > 1 else ''}"
        for mission, method, budget in groups
    ]
    width = max(map(len, names))
    for name, counts in zip(names, groups.values(), strict=True):
        states = ", ".join(f"{counts[state]} {state}" for state in STATES if counts[state])
        lines.append(f"  {name:{width}}  {states}")
    return "\n".join(lines)


def status_data(status: StudyStatus) -> dict[str, object]:
    """The same as JSON data, with a record for each cell."""
    return {
        "name": status.name,
        "cells": len(status.cells),
        "counts": {state: status.counts[state] for state in STATES},
        "experiments": status.total,
        "done": status.done,
        "designs": [
            {
                "mission": one.cell.mission,
                "method": one.cell.method,
                "budget": one.cell.budget,
                "repetition": one.cell.repetition,
                "state": one.state,
                "done": one.done,
                "total": one.total,
            }
            for one in status.cells
        ],
    }


def estimate_text(name: str, layout: StudyLayout, estimate: StudyEstimate, n_cells: int) -> str:
    """The experiments that a study will run, and the time that they take."""
    n_left = sum(estimate.experiments.values())
    lines = [
        f"Study      {name}: {n_cells} designs: {len(layout.methods)} methods x {len(layout.missions)} missions x "
        f"{max(len(layout.budgets), 1)} budgets x {layout.repetitions} repetitions",
        f"Assessed   on {layout.runs} fresh instances each, in {', '.join(layout.realities)}",
        f"Left       {n_left} experiments, about {timedelta(seconds=round(estimate.total))} on {estimate.jobs} cores",
    ]
    lines += [
        f"  {mission}, {method}: {n} experiments of {1000 * estimate.seconds[mission, method]:.1f} ms"
        for (mission, method), n in estimate.experiments.items()
    ]
    return "\n".join([*lines, *_power(layout)])


def _power(layout: StudyLayout) -> list[str]:
    """Which difference between two methods the study can see; nothing if it compares none."""
    raced = [layout.repetitions if n is None else n for n in layout.methods.values()]
    n_pairs, of_fronts = math.comb(len(raced), 2), math.comb([*layout.methods.values()].count(None), 2)
    n_tests = max(len(layout.budgets), 1) * sum(
        n_pairs * len(mission.objectives) + of_fronts if mission.objectives else n_pairs
        for mission in layout.missions.values()
    )
    if not n_tests or min(raced) < MIN_DESIGNS:
        return []
    found = visible(min(raced), n_tests)
    shared = Counter(name for row in layout.missions.values() for name in [o.name for o in row.objectives] or [""])
    n_pooled = max(len(layout.budgets), 1) * n_pairs * sum(n > 1 for n in shared.values())
    pooled = [
        f"           the test of {n} missions together sees smaller ones that they share, from "
        f"{designs_needed(n_pooled, n)} designs of each on"
        for n in sorted({n for n in shared.values() if n > 1})
    ]
    if math.isinf(found.shift):
        return [
            f"Sees       no difference on a single mission: {min(raced)} designs of each method are too few for "
            f"{n_tests} {'test' if n_tests == 1 else 'tests'} at 5 %; {designs_needed(n_tests)} are needed",
            *pooled,
        ]
    return [
        f"Sees       a difference of {found.shift:.2g} standard deviations of a method's designs (the better method's "
        f"design is better in {100 * found.a_measure:.0f} %",
        f"           of the pairs) with probability {POWER:g}, at 5 % with Holm's correction for {n_tests} "
        f"{'test' if n_tests == 1 else 'tests'} on single missions",
        *pooled,
    ]
