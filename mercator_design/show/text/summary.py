"""The summary of a race, as text."""

import shlex
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mercator_design.designer import Designer
from mercator_design.errors import printable
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.modules.architecture import Software
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.words import with_parameters
from mercator_design.plugins.loading import plugins
from mercator_design.race.elimination.fronts import nondominated
from mercator_design.race.elimination.summary import CONFIDENCE, Scores
from mercator_design.race.session.record import Record
from mercator_design.race.session.task import RaceResult, Task
from mercator_design.race.session.view import RaceView
from mercator_design.results.analysis.front import FRONT, front_of
from mercator_design.results.folder import RunFolder
from mercator_design.scores import ScoreRange
from mercator_design.show.text.columns import aligned
from mercator_design.show.text.iterations import iteration_notes, iterations_table
from mercator_design.sim.checks.no_effect import dead_conditions, dead_transitions
from mercator_design.software.architectures import architecture_of, text_of

_FILES = ("results.csv", "journal.jsonl", "provenance.json")


def race_summary(result: RaceResult, folder: RunFolder, *, new: int, tested: int, seconds: float, jobs: int) -> str:
    """The request, the iterations and the winner of a race; `written` comes after it.

    Args:
        result: The result of the race.
        folder: The run folder.
        new: Number of experiments that this process has run.
        tested: Number of tests that this process has run.
        seconds: Run time of this process [s].
        jobs: Number of experiments that ran at the same time.
    """
    task, record, optimizer = folder.task, folder.journal.record, folder.task.optimizer
    view = record.view
    all_equal = len({one.score for one in result.finished}) == 1
    failed = sum(one.score is None for one in result.finished)
    iterations = sum(not iteration.postselection for iteration in optimizer.iterations)
    if new + tested:
        now = "" if new == optimizer.used else f"{new} of them now, "
        now += f"{seconds:.1f} s with {jobs} job{'s' * (jobs != 1)}, "
        now += f"{(new + tested) / max(seconds, 1e-3):.0f} experiments/s"
    else:
        now = "it had ended: continue with --resume and a larger budget"
    lines = [
        *_request(task),
        f"Race       {task.method}, {optimizer.used} of {optimizer.budget} experiments, "
        f"{iterations} iteration{'s' * (iterations != 1)}, seed {optimizer.seed}; {now}",
        *(task.runs(new, tested) if new + tested else []),
        *(f"Note       {note}" for note in optimizer.notes),
        "",
        *iterations_table(view, task.possible_scores),
        f"Ended: {'the whole budget is used' if optimizer.used == optimizer.budget else optimizer.stop_reason}",
        *iteration_notes(record),
        *([f"Failed     {failed} experiments; their configurations were rejected"] if failed else []),
        *(["Note       all experiments had the same score: configurations could not be compared"] if all_equal else []),
        "",
        *(_design(result, task, record, folder.path) if isinstance(task, Designer) else _elites(result, task, view)),
    ]
    return "\n".join(map(printable, lines)) + "\n\n"


def written(folder: RunFolder) -> str:
    """The files of a race, for when they are written."""
    fronts = [FRONT] if folder.task.n_objectives > 1 else []
    return f"Written    {folder.path}: {', '.join([folder.task.WINNER, *fronts, *_FILES, *folder.task.files()])}"


def _request(task: Task[Any]) -> list[str]:
    if not isinstance(task, Designer):
        return task.about(task.start())
    mission, model = task.simulator.mission, task.simulator.robot_model
    dead = dead_conditions(mission, model, task.flavour)
    return [
        f"Mission    {mission.name}: {mission.robots} robots, {mission.duration:g} s, {mission.goal}",
        f"Designed   with {task.flavour}, for robot {model.name}",
        *([f"Note       never fires on this mission: {', '.join(dead)}"] if dead else []),
    ]


def _design(result: RaceResult, designer: Designer, record: Record, folder: Path) -> list[str]:
    view = record.view
    software = designer.software(result.configuration)
    loaded = [word for plugin in plugins() for word in ("--plugin", str(plugin.file))]
    evaluate = ["mdesign", "evaluate", str(folder / designer.WINNER), *loaded]
    if result.headline.is_fresh:
        evaluate += ["-n", str(len(result.headline.scores.values))]
    return [
        *winner_lines(result.configuration, view, designer.possible_scores),
        f"           on {'the same' if result.headline.is_fresh else 'fresh'} instances: {shlex.join(evaluate)}",
        *test_lines(view, {} if designer.n_objectives > 1 else result.tests),
        *front_lines(designer, record),
        *(f"           {line}" for line in _parts(software, designer)),
        "",
        text_of(software),
    ]


def _elites(result: RaceResult, task: Task[Any], view: RaceView) -> list[str]:
    """The best configurations as a table with a line for each parameter, and the best one as a command line."""
    optimizer = task.optimizer
    numbers = [elite.configuration for elite in optimizer.elites]
    columns = task.columns(task.start(), [optimizer.configurations[number] for number in numbers])
    rows: list[list[object]] = [
        ["configuration", *numbers],
        ["race mean", *(f"{task.score(elite.mean):.6g}" for elite in optimizer.elites)],
        ["runs", *(elite.n_results for elite in optimizer.elites)],
        *([name, *values] for name, values in columns.items()),
    ]
    tested = [*winner_lines(numbers[0], view, task.possible_scores), *test_lines(view, result.tests)]
    return ["Best", *aligned(rows), "", *tested, "", optimizer.space.command_line(optimizer.configurations[numbers[0]])]


def winner_lines(winner: int, view: RaceView, possible: ScoreRange) -> list[str]:
    """The winner with its score, and its score in the race if that is another one."""
    headline, raced = (view.headline(possible, fresh=fresh) for fresh in (True, False))
    assert headline is not None  # noqa: S101 - a winner has scores
    assert raced is not None  # noqa: S101
    first = f"Winner     configuration {winner}: score {headline.scores.mean:.4g}{possible.limit} {headline.where}"
    first += interval_words(headline.scores)
    optimistic = "optimistic: it was chosen by these runs"
    if not headline.is_fresh:
        return [first, f"           {optimistic}"]
    return [first, f"           {raced.where}: {raced.scores.mean:.4g} ({optimistic})"]


def interval_words(scores: Scores) -> str:
    """The confidence interval of the mean in words that follow it; empty for a single score."""
    interval = scores.confidence_interval
    return "" if interval is None else f" ({interval[0]:.4g} to {interval[1]:.4g} at {CONFIDENCE:.0%})"


def front_lines(designer: Designer, record: Record) -> list[str]:
    """A line for each design on the front of several objectives."""
    designs = [one for one in front_of(designer, record) if one.is_on_front]
    if not designs:
        return []
    winner = record.view.winner
    dominated = [] if any(one.configuration == winner for one in designs) else ["the winner is dominated on these runs"]
    mission = designer.simulator.mission
    named = zip(mission.objective_names, mission.all_objectives, strict=True)
    rows: list[tuple[object, ...]] = [("configuration", *(f"{name} ({one.direction})" for name, one in named), "")]
    for one in designs:
        figures = (f"{mean:.4g} ± {error:.2g}" for mean, error in zip(one.means, one.errors, strict=True))
        rows.append((one.configuration, *figures, "winner" if one.configuration == winner else ""))
    where = "on fresh instances" if designs[0].is_fresh else "in the race, optimistic"
    lines = (f"           {line}" for line in [*aligned(rows), *dominated])
    return [f"Front      {where}, mean ± standard error; files front-N.txt:", *lines]


def test_lines(view: RaceView, tests: Mapping[int, Scores]) -> list[str]:
    """A line for each configuration that was tested: the winner, other elites, those of iterations before.

    There are none if it is only the winner.
    """
    if tests.keys() <= {view.winner}:
        return []
    roles = _roles(view)
    rows = [
        (f"configuration {number}", roles.get(number), f"mean {tests[number].mean:.4g}{interval_words(tests[number])}")
        for number in dict.fromkeys([*roles, *tests])
        if number in tests
    ]
    n = max(len(one.values) for one in tests.values())
    how = f"on {n} fresh instance{'s' * (n != 1)}, beyond the budget"
    return [f"Tested     {how}:", *(f"           {line}" for line in aligned(rows))]


def test_lines_by_each(view: RaceView, objectives: Mapping[str, ScoreRange]) -> list[str]:
    """As `test_lines`, by each of several objectives, with who is on the front."""
    tests: dict[int, list[tuple[float, ...]]] = {}
    for one in view.tests.values():
        if one.scores:
            tests.setdefault(one.configuration, []).append(one.scores)
    if not tests:
        return []
    found = {number: np.array(scores) for number, scores in tests.items()}
    signs = [-1.0 if possible.maximise else 1.0 for possible in objectives.values()]
    is_on = dict(zip(found, nondominated(np.array([signs * one.mean(axis=0) for one in found.values()])), strict=True))
    roles = _roles(view)
    goals = (f"{'maximise' if possible.maximise else 'minimise'} {name}" for name, possible in objectives.items())
    rows: list[tuple[object, ...]] = [("configuration", "", *goals, "")]
    first: dict[bytes, int] = {}
    for number in dict.fromkeys(one for one in [*roles, *found] if one in found):
        scores = found[number]
        errors = scores.std(axis=0, ddof=min(1, len(scores) - 1)) / np.sqrt(len(scores))
        figures = (f"{mean:.4g} ± {error:.2g}" for mean, error in zip(scores.mean(axis=0), errors, strict=True))
        same = first.setdefault(scores.tobytes(), number)
        where = f"does the same as {same}" if same != number else "on the front" if is_on[number] else ""
        rows.append((number, roles.get(number, ""), *figures, where))
    n = max(map(len, tests.values()))
    how = f"on {n} fresh instance{'s' * (n != 1)}, beyond the budget, mean ± standard error"
    return [f"Tested     {how}:", *(f"           {line}" for line in aligned(rows))]


def _roles(view: RaceView) -> dict[int, str]:
    """The roles of configurations in a race that has ended: their best one, and the latest of equal ones."""
    iterations = view.iterations[::-1]
    last, former = iterations[:1], iterations[1:]
    roles = {} if view.winner is None else {view.winner: "winner"}
    for rank, number in enumerate(last[0].elites if last else (), start=1):
        roles.setdefault(number, f"elite {rank}")
    for rank in range(1, max((len(one.elites) for one in former), default=0) + 1):
        called = "best" if rank == 1 else f"elite {rank}"
        for one in former:
            for number in one.elites[rank - 1 : rank]:
                roles.setdefault(number, f"{called} of iteration {one.iteration}")
    return roles


def _parts(software: Software, designer: Designer) -> list[str]:
    """The parts of control software in words, a line for each."""
    simulator = designer.simulator
    if isinstance(software, Pfsm):
        return describe(software, dead_transitions(simulator.mission, simulator.robot_model, software))
    architecture = architecture_of(software.flavour)
    swarm = KnownSwarm(simulator.mission.control_period, simulator.mission.robots)
    return architecture.explanation(software, architecture.names(software), swarm).splitlines()


def describe(pfsm: Pfsm, dead: Container[tuple[int, int]] = ()) -> list[str]:
    """A PFSM in words, a line for each state and transition; dead transitions, by state and number, never fire."""
    lines = []
    for i, state in enumerate(pfsm.states):
        lines.append(f"state {i}: {with_parameters(state.module, state.parameters)}")
        for j, transition in enumerate(state.transitions):
            condition = with_parameters(transition.module, transition.parameters)
            never = ", which never fires on this mission" if (i, j) in dead else ""
            lines.append(f"  -> {transition.target} on {condition}{never}")
    return lines
