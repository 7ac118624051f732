"""Studies as text: progress on stderr, the state of a folder, what a dry run says."""

from collections import Counter
from datetime import timedelta

from mercator_design.show.text.progress import Display
from mercator_design.study.estimate import StudyEstimate
from mercator_design.study.layout import StudyLayout
from mercator_design.study.reading import State, StudyStatus
from mercator_design.study.running import StudyProgress

_STATES: tuple[State, ...] = ("done", "to assess", "running", "interrupted", "to run")


class StudyDisplay(Display):
    """Progress of a study: the cell that runs, the experiments of all, their rate, and the time left."""

    def note(self, progress: StudyProgress) -> None:
        """Show the progress; the first of each cell in any case."""
        self.known = progress.known
        stage = "assessing" if progress.is_assessed else "racing"
        text = f"cell {progress.number} of {progress.n_cells}: {progress.cell}: {stage}"
        if not self._is_silent():
            self.show(progress.done, text, progress.total)


def status_text(status: StudyStatus, layout: StudyLayout) -> str:
    """The state of a study, with a line for each method on each mission."""
    lines = [
        f"Study      {status.name}: {status.counts['done']} of {len(status.cells)} designs are assessed, "
        f"{status.done} of {status.total} experiments have run"
    ]
    groups: dict[tuple[str, str, int], Counter[State]] = {}
    for one in status.cells:
        key = one.cell.mission, one.cell.method, one.cell.budget
        groups.setdefault(key, Counter())[one.state] += 1
    names = [
        f"{mission}, {method}{f', budget {budget}' * (len(layout.budgets) > 1)}" for mission, method, budget in groups
    ]
    width = max(map(len, names))
    for name, counts in zip(names, groups.values(), strict=True):
        states = ", ".join(f"{counts[state]} {state}" for state in _STATES if counts[state])
        lines.append(f"  {name:{width}}  {states}")
    return "\n".join(lines)


def status_data(status: StudyStatus) -> dict[str, object]:
    """The same as JSON data, with a record for each cell."""
    return {
        "name": status.name,
        "cells": len(status.cells),
        "counts": {state: status.counts[state] for state in _STATES},
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
    """What a study will run, and how long that takes."""
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
    return "\n".join(lines)
