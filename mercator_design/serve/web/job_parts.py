"""Shared parts of the list of jobs and the page of a job: state, progress, actions."""

from datetime import datetime
from typing import NamedTuple
from urllib.parse import quote

from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import State
from mercator_design.show.charts import number
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html


class Action(NamedTuple):
    """An action of a user on a job, by a request without a body."""

    word: str
    method: str
    path: str  # below that of the job
    states: tuple[State, ...]
    confirm: str = ""  # what is asked before


CANCEL = Action(
    "Cancel", "POST", "/cancel", ("queued", "running", "paused"),
    "Cancel this job? It cannot be resumed; its results so far stay.",
)  # fmt: skip
ACTIONS = (
    Action("Pause", "POST", "/pause", ("queued", "running")),
    Action("Resume", "POST", "/resume", ("paused", "failed")),
    CANCEL,
)
DELETE = Action(
    "Delete", "DELETE", "", ("queued", "paused", "finished", "failed", "cancelled"),
    "Delete this job with all its files? This cannot be undone.",
)  # fmt: skip


def address(row: IndexRow, after: str = "") -> str:
    """The address of a job's page, as an attribute."""
    return f"/jobs/{quote(row.id, safe='')}{after}"


def api_address(row: IndexRow, after: str = "") -> str:
    """The address of a job in the API, as an attribute."""
    return f"/api/v1/jobs/{quote(row.id, safe='')}{after}"


def button(row: IndexRow, action: Action) -> Html:
    path = address(row, action.path)
    confirm = f' data-confirm="{escaped(action.confirm)}"' if action.confirm else ""
    danger = ' class="danger"' if action.confirm else ""
    identity = escaped(f"{action.word.lower()}-{row.id}")
    label = escaped(f"{action.word} {row.job.name} {row.id}")
    return Html(
        f'<button type="button" id="{identity}" aria-label="{label}"{danger} data-do="{action.method} {path}"{confirm}>'
        f"{action.word}</button>"
    )


def buttons(row: IndexRow, *actions: Action) -> Html:
    """The buttons of the actions that are possible in the state of a job."""
    if row.state == "running" and row.job.wish != "run":
        actions = () if row.job.wish == "cancel" else (CANCEL,)
    return Html("".join(button(row, one) for one in actions if row.state in one.states))


def state(row: IndexRow) -> Html:
    """State of a job as a word, with its message."""
    message = f' <span class="why">{escaped(row.message)}</span>' if row.message else ""
    return Html(f'<span class="state state-{row.state}">{row.state}</span>{message}')


def progress(row: IndexRow) -> Html:
    """The progress of a job as a bar with figures."""
    budget = row.job.request.budget
    label = f"{row.experiments} of {budget} experiments"
    left = f'<span class="faint"> · {time_left(row)}</span>' if time_left(row) else ""
    return Html(
        f'<progress max="{max(budget, 1)}" value="{row.experiments}" aria-label="{label}"></progress>'
        f'<span class="figures">{row.experiments} of {budget}{left}</span>'
    )


def best(row: IndexRow) -> Html:
    """The score of a job's winner, or of its best so far, and where it was measured."""
    if row.is_study:
        return Html()
    if row.best is None:
        return Html('<span class="faint">none yet</span>' if row.state in ("queued", "running") else "")
    return Html(f'<strong>{number(row.best)}</strong> <span class="faint">{row.measured}</span>')


def time_left(row: IndexRow) -> str:
    """Estimated remaining time of a running race; empty if unknown."""
    if row.state != "running" or row.left is None:
        return ""
    return f"about {duration(row.left)} left" if row.left >= 1 else "tests and report"


def duration(seconds: float) -> str:
    """Duration as text, in a suitable unit."""
    for unit, size in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def moment(time: str) -> Html:
    """Time as HTML; empty if there is none."""
    try:
        shown = datetime.fromisoformat(time).strftime("%Y-%m-%d %H:%M")
    except ValueError:
        return Html(escaped(time))
    return Html(f'<time datetime="{escaped(time)}">{shown}</time>')
