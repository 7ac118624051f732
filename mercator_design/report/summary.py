"""One page of text about a race or an evaluation."""

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import stdev

from mercator_design.design import CONFIDENCE, Design, Evaluation
from mercator_design.fsm.modules import Parameter
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import to_text
from mercator_design.missions.mission import Mission
from mercator_design.race import IterationSummary


def race_summary(design: Design, mission: Mission, *, seconds: float, jobs: int, folder: Path) -> str:
    """What was asked, what happened in each iteration, what won, and where it lies."""
    race = design.race
    used = race.used
    objective = mission.objective
    lines = [
        f"Mission    {mission.name}: {mission.robots} robots, {mission.duration:g} s, "
        f"{objective.direction} {objective.name}",
        f"Race       {used} of {race.budget} experiments, {race.iteration - 1} iterations, seed {race.seed}; "
        f"{seconds:.1f} s with {jobs} jobs, {used / max(seconds, 1e-3):.0f} experiments/s",
        *(f"Note       {note}" for note in race.notes),
        "",
        "iteration  raced  survivors  experiments  best mean",
        *(_iteration_line(iteration, mission) for iteration in race.iterations),
        f"Ended: {race.stop_reason}",
        "",
        f"Winner     configuration {design.configuration}, score {_mean_and_spread(design.scores)} "
        f"over the race's instances; measure it on fresh ones:",
        f"           mdesign evaluate {folder / 'fsm.txt'}",
        *(f"           {line}" for line in describe(design.winner)),
        "",
        to_text(design.winner),
        "",
        f"Written    {folder}: fsm.txt, mission.yaml, results.csv, journal.jsonl, provenance.json",
    ]
    return "\n".join(lines) + "\n"


def _iteration_line(iteration: IterationSummary, mission: Mission) -> str:
    name = "final" if iteration.postselection else str(iteration.iteration)
    best = mission.cost(iteration.elites[0].mean)
    return f"{name:>9}  {iteration.n_configurations:>5}  {iteration.n_alive:>9}  {iteration.used:>11}  {best:>9.4g}"


def describe(pfsm: Pfsm) -> list[str]:
    """A PFSM in words, a line for each state and transition."""
    lines = []
    for i, state in enumerate(pfsm.states):
        lines.append(f"state {i}: {_called(state.behaviour, state.module.parameters, state.parameters)}")
        for transition in state.transitions:
            condition = _called(transition.condition, transition.module.parameters, transition.parameters)
            lines.append(f"  -> {transition.target} on {condition}")
    return lines


def evaluation_summary(result: Evaluation, mission: Mission, *, seed: int) -> str:
    """The figures of an evaluation, a line each."""
    low, middle, high = result.quartiles
    lines = [
        f"mission              {mission.name} ({mission.objective.direction} {mission.objective.name})",
        f"runs                 {len(result.scores)}, seed {seed}",
        f"mean                 {result.mean:.6g}",
    ]
    if result.confidence_interval is not None:
        lines += [
            f"standard deviation   {result.standard_deviation:.6g}",
            f"confidence interval  {result.confidence_interval[0]:.6g} to {result.confidence_interval[1]:.6g} "
            f"({CONFIDENCE:.0%} of the mean)",
        ]
    return "\n".join([*lines, f"quartiles            {low:.6g}  {middle:.6g}  {high:.6g}"])


def evaluation_json(result: Evaluation, mission: Mission, *, seed: int) -> str:
    """The figures of an evaluation as JSON; what is not defined for one run is null."""
    return json.dumps(
        {
            "mission": mission.name,
            "direction": mission.objective.direction,
            "runs": len(result.scores),
            "seed": seed,
            "scores": result.scores,
            "seeds": result.seeds,
            "mean": result.mean,
            "standard_deviation": result.standard_deviation,
            "quartiles": result.quartiles,
            "confidence_interval": result.confidence_interval,
        },
        allow_nan=False,
    )


def _called(name: str, parameters: tuple[Parameter, ...], values: tuple[float, ...]) -> str:
    given = ", ".join(f"{p.name} {value:g}" for p, value in zip(parameters, values, strict=True))
    return f"{name} ({given})" if given else name


def _mean_and_spread(scores: Sequence[float]) -> str:
    mean = sum(scores) / len(scores)
    spread = stdev(scores) if len(scores) > 1 else 0.0
    return f"{mean:.4g} ± {spread:.3g} (n={len(scores)})"
