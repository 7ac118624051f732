"""One page of text about a race or an evaluation."""

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from mercator_design.design import CONFIDENCE, Design, Designer, Evaluation, Scores
from mercator_design.fsm.conditions import COLOUR_LABELS
from mercator_design.fsm.modules import Parameter
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import to_text
from mercator_design.missions.plugins import plugin_files
from mercator_design.race.journal import Record
from mercator_design.report.iterations import iteration_notes, iterations_table
from mercator_design.sim.simulate import Simulator


def race_summary(
    design: Design,
    designer: Designer,
    record: Record,
    *,
    new: int,
    tested: int,
    seconds: float,
    jobs: int,
    folder: Path,
) -> str:
    """What was asked, what happened in each iteration, what won, and where it lies.

    Args:
        design: What the race came to.
        designer: Of it.
        record: Of it.
        new: Experiments that were run by this process, not before the race was resumed.
        tested: Tests that were.
        seconds: That this took.
        jobs: Experiments run at once.
        folder: Of the race.
    """
    race, mission = designer.race, designer.simulator.mission
    objective, scores = mission.objective, design.scores
    all_equal = len({one.score for one in design.finished}) == 1
    failed = sum(one.score is None for one in design.finished)
    plugins = [word for file in plugin_files() for word in ("--plugin", str(file))]
    evaluate = ["mdesign", "evaluate", str(folder / "fsm.txt"), *plugins]
    iterations = sum(not iteration.postselection for iteration in race.iterations)
    lines = [
        f"Mission    {mission.name}: {mission.robots} robots, {mission.duration:g} s, "
        f"{objective.direction} {objective.name}",
        f"Designed   with {designer.flavour}, for robot {designer.simulator.robot_model.name}",
        f"Race       {designer.method}, {race.used} of {race.budget} experiments, "
        f"{iterations} iteration{'s' * (iterations != 1)}, seed {race.seed}; "
        f"{'' if new == race.used else f'{new} of them now, '}{seconds:.1f} s with {jobs} jobs, "
        f"{(new + tested) / max(seconds, 1e-3):.0f} experiments/s",
        *(f"Note       {note}" for note in race.notes),
        "",
        *iterations_table(record),
        f"Ended: {'the whole budget is used' if race.used == race.budget else race.stop_reason}",
        *iteration_notes(record),
        *([f"Failed     {failed} experiments; their configurations were rejected"] if failed else []),
        *(["Note       all experiments had the same score: the race could tell nothing apart"] if all_equal else []),
        "",
        f"Winner     configuration {design.configuration}, score {scores.mean:.4g} ± "
        f"{scores.standard_deviation or 0.0:.3g} (n={len(scores.values)}) over the race's instances"
        f"{'' if design.tests else '; measure it on fresh ones:'}",
        *([] if design.tests else [f"           {shlex.join(evaluate)}"]),
        *_test_lines(design.tests, evaluate),
        *(f"           {line}" for line in describe(design.winner)),
        "",
        to_text(design.winner),
        "",
        f"Written    {folder}: fsm.txt, mission.yaml, robot_model.yaml, results.csv, journal.jsonl, provenance.json",
    ]
    return "\n".join(lines) + "\n"


def _test_lines(tests: Mapping[int, Scores], evaluate: Sequence[str]) -> list[str]:
    """What the tests came to; the winner's are the first."""
    if not tests:
        return []
    rows = [(f"configuration {c}", scores) for c, scores in tests.items()]
    n = len(rows[0][1].values)
    return [
        f"Tested     on fresh instances, as {shlex.join([*evaluate, '-n', str(n)])} does for the winner:",
        *(f"           {name:<20}{test_figures(scores)}" for name, scores in rows),
    ]


def test_figures(scores: Scores) -> str:
    """Mean, confidence interval and number of tests."""
    interval = scores.confidence_interval
    around = "" if interval is None else f", {interval[0]:.4g} to {interval[1]:.4g} at {CONFIDENCE:.0%}"
    return f"mean {scores.mean:.4g}{around} (n={len(scores.values)})"


def describe(pfsm: Pfsm) -> list[str]:
    """A PFSM in words, a line for each state and transition."""
    lines = []
    for i, state in enumerate(pfsm.states):
        lines.append(f"state {i}: {_called(state.behaviour, state.module.parameters, state.parameters)}")
        for transition in state.transitions:
            condition = _called(transition.condition, transition.module.parameters, transition.parameters)
            lines.append(f"  -> {transition.target} on {condition}")
    return lines


def evaluation_summary(result: Evaluation, simulator: Simulator, *, seed: int | None) -> str:
    """The figures of an evaluation, a line each; instances that were given have no master seed."""
    scores, mission, robot_model = result.scores, simulator.mission, simulator.robot_model
    low, middle, high = scores.quartiles
    lines = [
        f"mission              {mission.name} ({mission.objective.direction} {mission.objective.name})",
        f"                     {mission.robots} robots, {mission.duration:g} s, robot model {robot_model.name}",
        f"runs                 {len(scores.values)}, {'on given instances' if seed is None else f'seed {seed}'}",
        f"mean                 {scores.mean:.6g}",
    ]
    if scores.confidence_interval is not None:
        lines += [
            f"standard deviation   {scores.standard_deviation:.6g}",
            f"confidence interval  {scores.confidence_interval[0]:.6g} to {scores.confidence_interval[1]:.6g} "
            f"({CONFIDENCE:.0%} for the mean)",
        ]
    return "\n".join([*lines, f"quartiles            {low:.6g}  {middle:.6g}  {high:.6g}"])


def evaluation_json(result: Evaluation, simulator: Simulator, *, seed: int | None) -> str:
    """The figures of an evaluation as JSON; what is not defined, as for one run, is null."""
    scores, mission = result.scores, simulator.mission
    return json.dumps(
        {
            "mission": mission.name,
            "direction": mission.objective.direction,
            "robots": mission.robots,
            "duration": mission.duration,
            "robot_model": simulator.robot_model.name,
            "runs": len(scores.values),
            "seed": seed,
            "scores": scores.values,
            "seeds": result.seeds,
            "mean": scores.mean,
            "standard_deviation": scores.standard_deviation,
            "quartiles": scores.quartiles,
            "confidence_interval": scores.confidence_interval,
        },
        allow_nan=False,
    )


def _called(name: str, parameters: tuple[Parameter, ...], values: tuple[float, ...]) -> str:
    given = ", ".join(
        f"{p.name} {COLOUR_LABELS[int(value)] if p.name == 'label' else format(value, 'g')}"
        for p, value in zip(parameters, values, strict=True)
    )
    return f"{name} ({given})" if given else name
