"""Reports on races from their journals: a table of all, or a page on one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mercator_design.errors import MercatorError, RaceError, printable
from mercator_design.race.elimination.summary import CONFIDENCE, Scores
from mercator_design.race.session.events import SessionStarted, SessionStopped
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import Record
from mercator_design.results.files import TASKS, goal_of, possible_scores, read_journal, scores_by_objective
from mercator_design.results.listing import COLUMNS, run_of, runs_of
from mercator_design.show.charts import Axis
from mercator_design.show.text.columns import aligned, narrowed
from mercator_design.show.text.iterations import best_line, iteration_notes, iterations_table
from mercator_design.show.text.summary import test_lines, test_lines_by_each, winner_lines

_DISPENSABLE = ("started", "seed", "name", "budget", "experiments", "flavour")


def runs_table(folder: Path, width: int | None = None) -> tuple[str, list[str]]:
    """A table of the races in the subfolders of a folder, and notes on damaged ones.

    Args:
        folder: The folder.
        width: Of a line [characters]; less important columns are left out if there is too little space. None: no limit.

    Raises:
        RaceError: if there is no such folder.
    """
    found = runs_of(folder)
    rows = [[f"{cell:.4g}" if isinstance(cell := run[name], float) else cell for name in COLUMNS] for run in found]
    wrong = [run for run in found if run["state"] in {"damaged", "end missing"}]
    return "\n".join(narrowed([[*COLUMNS], *rows], _DISPENSABLE, width)), [
        note for run in wrong for note in run["notes"]
    ]


def runs_json(folder: Path) -> str:
    """The table as JSON.

    Raises:
        RaceError: if there is no such folder.
    """
    return json.dumps(runs_of(folder), indent=2)


def run_summary(path: Path) -> str:
    """A page on the race of a run folder.

    Raises:
        RaceError: if there is no race, or its journal is corrupt.
    """
    reading = read_journal(path)
    record, run, view = reading.record, run_of(path, reading), reading.record.view
    if not record.start:
        return f"{path}: no race has begun here yet"
    task, possible = TASKS[record.start["task"]], possible_scores(path)
    counted = ((one.configuration, one.instance) for one in record.experiments.values())
    n_extra = len({*record.speculative}.difference(counted))
    failed = sum(one.score is None for one in view.results())
    extended = ", ".join(map(str, record.budgets[:-1]))
    lines = [
        *task.about(record.start),
        f"Race       {record.start['method']}, {run['experiments']} of {run['budget']} experiments, "
        f"{len(record.configurations)} configurations",
        *([f"Extended   from a budget of {extended}"] if extended else []),
        *([f"Failed     {failed} experiments; their configurations were rejected"] if failed else []),
        *([f"Extra      {n_extra} speculative experiment{'s' * (n_extra != 1)}, not counted"] if n_extra else []),
        f"State      {run['state']}",
        *(f"           {_session(session)}" for session in record.sessions),
        *([f"Note       {reading.torn}: incomplete, for example after a loss of power"] if reading.torn else []),
        *(f"Note       {note}" for note in run["notes"]),
        f"Digest     {record.digest()}",
    ]
    if view.incumbents:
        lines += ["", *iterations_table(view, possible), *iteration_notes(record), ""]
    if run["winner"] is not None:
        columns, lack = _shown(path, record, run["winner"])
        lines += [*winner_lines(run["winner"], view, possible), *_tests(path, record), ""]
        lines += [f"{value}" if len(columns) == 1 else f"{name} = {value}" for name, [value] in columns.items()]
        lines += [f"Not shown: {message}" for message in lack]
    return "\n".join(map(printable, lines))


def _tests(path: Path, record: Record) -> list[str]:
    """The tests of configurations, or why those by several objectives are not shown."""
    try:
        objectives = scores_by_objective(path, record.start)
    except MercatorError as error:
        return [f"Not shown: {message}" for message in error.messages]
    if len(objectives) > 1:
        return test_lines_by_each(record.view, objectives)
    (possible,) = objectives.values()
    return test_lines(record.view, {n: Scores(scores, possible) for n, scores in record.view.test_scores().items()})


def _shown(path: Path, record: Record, configuration: int) -> tuple[dict[str, list[Any]], tuple[str, ...]]:
    """A configuration as columns, and why there are none if what it is made of is not loaded."""
    task, found = TASKS[record.start["task"]], [record.configurations[configuration]]
    try:
        task.recall(path, record.start)
    except MercatorError as error:
        return {}, error.messages
    task.check(record.start, found)
    return task.columns(record.start, found), ()


def side_by_side(folders: Sequence[Path]) -> str:
    """Races as the columns of a table.

    Raises:
        RaceError: A folder has no race that has begun, or its journal is corrupt.
    """
    columns = [_cells(folder, _begun(folder)) for folder in folders]
    rows = zip(columns[0], *(column.values() for column in columns), strict=True)
    return "\n".join(aligned([row for row in rows if any(cell is not None for cell in row[1:])]))


def races_json(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """The facts of `runs_json` on each race; errors are those of `side_by_side`."""
    return [run_of(folder, _begun(folder)) for folder in folders]


def what_races_show(folders: Sequence[Path]) -> str:
    """What the comparison of single races shows, and what it cannot show; empty for one race."""
    if len(folders) < 2:
        return ""
    return (
        f"this shows how {len(folders)} designs differ, the winners of these races. It does not show how their methods "
        "differ: another seed gives another design, and many runs of one design are still one design "
        "(pseudo-replication). To compare methods, flavours or budgets: several races of each with other seeds, and "
        "mdesign study compare"
    )


def _begun(folder: Path) -> Reading:
    reading = read_journal(folder)
    if not reading.record.start:
        raise RaceError(f"{folder}: expected a race that has begun, found none")
    return reading


def _cells(folder: Path, reading: Reading) -> dict[str, object]:
    """The column of a race."""
    record, run = reading.record, run_of(folder, reading)
    start, winner, view, possible = record.start, run["winner"], record.view, possible_scores(folder)
    return {
        "": str(folder),
        "name": start["name"],
        "task": start["task"],
        "objectives": goal_of(start) or None,
        "scores": "by the first of these" if goal_of(start) else None,
        "mission digest": start.get("mission_digest"),
        "robot model": start.get("robot_model"),
        "flavour": start.get("flavour"),
        "method": start["method"],
        "seed": start["seed"],
        "budget": record.budget,
        "experiments": run["experiments"],
        "iterations": len(record.iterations),
        "configurations": len(record.configurations),
        "state": run["state"],
        "winner": winner,
        **_scores("race", Scores(tuple(view.scores(winner).values()), possible)),
        **_scores("fresh", Scores(view.test_scores().get(winner, ()), possible)),
    }


def _scores(where: str, of: Scores) -> dict[str, object]:
    """Mean, confidence interval and number of scores, in cells of their own, so that several races fit a line."""
    interval = of.confidence_interval if of.values else None
    return {
        f"{where} mean": f"{of.mean:.4g}" if of.values else None,
        f"{where} interval": None if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}",
        f"{where} runs": len(of.values) or None,
    }


def save_races(path: Path, folders: Sequence[Path], *, command: str) -> None:
    """Draw the best of each iteration over the experiments so far, a line with its confidence band for each race.

    Races of one method and flavour have one colour.

    The suffix of the path, .png or .svg, is the format; the command that draws the picture is in its caption.

    Raises:
        OSError: The picture cannot be written.
        RaceError: As `side_by_side`.
    """
    from mercator_design.show.pictures.figures import save_curves

    lines, names, methods = [], [], []
    for folder in folders:
        record = _begun(folder).record
        method = ", ".join(filter(None, (record.start["method"], record.start.get("flavour"))))
        methods.append(method)
        label = f"{printable(method)}: {printable(str(folder))}"
        lines.append(best_line(label, record.view.incumbents, possible_scores(folder)))
        names.append(printable(str(record.start["name"])))
    caption = (
        "The best of each iteration in the race, on the instances that it had seen by then: one design of each race. "
        f"{printable(command)}"
    )
    of_first = " by the first objective" * any(goal_of(_begun(folder).record.start) for folder in folders)
    y = Axis(f"mean score{of_first}, interval of {CONFIDENCE:.0%}")
    title = ", ".join(dict.fromkeys(names))
    save_curves(path, lines, Axis("budget used", "experiments"), y, title=title, caption=caption, groups=methods)


def _session(session: SessionStarted | SessionStopped) -> str:
    if isinstance(session, SessionStopped):
        return f"{session.time}  stopped: {session.why}"
    how = f"{session.executor}, {session.jobs} jobs" if session.executor else ""
    return f"{session.time}  process {session.process} on {session.host}: {how}"
