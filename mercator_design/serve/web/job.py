"""The page of a job: its race or study, winner or report, files and actions."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse, Response

from mercator_design.errors import MercatorError
from mercator_design.results.files import JOURNAL
from mercator_design.serve.accounts.users import LOCAL, User
from mercator_design.serve.designs import FSM
from mercator_design.serve.http.context import OwnJob, TheService, TheUser, VisibleJob, may_change
from mercator_design.serve.http.files import files_of
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import ENDED, MAX_PRIORITY, RaceRequest
from mercator_design.serve.jobs.processes import last_messages
from mercator_design.serve.jobs.races import end_of, length_of
from mercator_design.serve.jobs.store import MISSION, OUTPUT
from mercator_design.serve.service import Service
from mercator_design.serve.settings import ServiceError
from mercator_design.serve.web.job_parts import (
    ACTIONS,
    DELETE,
    address,
    api_address,
    best,
    buttons,
    duration,
    moment,
    progress,
    state,
)  # fmt: skip
from mercator_design.serve.web.layout import fragment, page
from mercator_design.serve.web.part_cache import FolderState, PartCache
from mercator_design.serve.workers.races import PagePart, about_part, race_part
from mercator_design.serve.workers.studies import study_part
from mercator_design.show.charts import number
from mercator_design.show.markup import escaped, escaped_lines
from mercator_design.show.report.markup import Html, facts_list, folded, section
from mercator_design.show.report.page import REPORT
from mercator_design.studies.folder import CELLS, FACTS, PLAN, lock_file

router = APIRouter(prefix="/jobs/{id}", include_in_schema=False)

_SECONDS = 15  # between two refreshes without an event
_READING = '<p class="faint">Reading its folder …</p>'
_FIRST = (FSM, REPORT, "results.csv", "journal.jsonl", MISSION, PLAN)
"""Files that are listed first."""


def _part_cache(request: Request) -> PartCache:
    return request.app.state.part_cache  # type: ignore[no-any-return]


_ThePartCache = Annotated[PartCache, Depends(_part_cache)]


@router.get("")
def job(service: TheService, user: TheUser, row: VisibleJob) -> HTMLResponse:
    at = escaped(api_address(row))
    replay = section(
        "replay", "Replay",
        '<p><button type="button" id="watch">Replay the best so far</button> <span id="shown" class="faint"></span></p>'
        '<div class="tabs" id="runs" role="group" aria-label="Runs"></div><div id="stage"></div>',
    )  # fmt: skip
    body = (
        f'<div id="job" data-id="{escaped(row.id)}" data-api="{at}">{_now(service, user, row)}'
        f'<p id="notice" class="problem" role="status"></p>{_changes(user, row)}{replay}'
        f"{_live_part(row, 'race', _READING)}"
        f"{_files(service, row)}{_live_part(row, 'about', '')}"
        f"{_messages(service, row) if may_change(user, row) else ''}</div>"
    )
    scripts = ("viewer.js", "page.js", "live.js", "job.js")
    return page(row.job.name, body, user=user, scripts=scripts, styles=("viewer.css", "jobs.css"))


@router.get("/now")
def now(service: TheService, user: TheUser, row: VisibleJob) -> HTMLResponse:
    """The state of a job, for its page."""
    return fragment(_now(service, user, row))


@router.get("/files")
def files(service: TheService, row: VisibleJob) -> HTMLResponse:
    """The files of a job, for its page."""
    return fragment(_files(service, row))


@router.get("/messages")
def messages(service: TheService, row: OwnJob) -> HTMLResponse:
    """The messages of a job's process, for its page."""
    return fragment(_messages(service, row))


@router.get("/race")
def race(
    service: TheService, parts: _ThePartCache, row: VisibleJob, have: Annotated[str, Query(max_length=40)] = ""
) -> Response:
    """The race or study of a job, for its page; nothing new if the page has it."""
    part, is_fresh = _part(service, parts, row, study_part if row.is_study else race_part)
    if isinstance(part, MercatorError):
        return fragment(
            _live_part(
                row, "race", f'<p class="problem">{escaped_lines(service.store.without_data_folder(str(part)))}</p>'
            )
        )
    report = _study_report(service, row)
    if part is None:
        answer: Response = fragment(_live_part(row, "race", _without_race(row) if is_fresh else _READING))
    elif have == (version := part.version + "-report" * bool(report)):
        answer = Response(status_code=204)
    else:
        answer = fragment(
            _live_part(
                row,
                "race",
                report + service.store.without_data_folder(part.text),
                f'{_best_runs(part)} data-have="{version}"',
            )
        )
    return _with_refresh_hint(answer, is_fresh=is_fresh)


@router.get("/about")
def about(service: TheService, parts: _ThePartCache, row: VisibleJob) -> Response:
    """Request and origin of a race, for the page of a job."""
    if row.is_study:  # its file says what was requested
        return fragment(_live_part(row, "about", ""))
    part, is_fresh = _part(service, parts, row, about_part)
    text = (
        service.store.without_data_folder(part.text) if isinstance(part, PagePart) else ""
    )  # what is wrong with the race, its own part says
    return _with_refresh_hint(fragment(_live_part(row, "about", text)), is_fresh=part is not None or is_fresh)


def _part(
    service: Service, parts: PartCache, row: IndexRow, make: Callable[[Path], PagePart]
) -> tuple[PagePart | MercatorError | None, bool]:
    """A part of the page, or the error of the race, and whether it is up to date.

    Without a part, True says that the race has not begun.
    """
    folder = service.store.run_folder(row.id)
    state = FolderState(row.experiments, (row.state,)) if row.is_study else None
    try:
        return parts.get(make, folder, state) if (folder / (FACTS if state else JOURNAL)).exists() else (None, True)
    except ServiceError:
        raise
    except MercatorError as error:
        return error, True


def _best_runs(part: PagePart) -> str:
    """HTML attributes with the best configuration and its runs, for replays."""
    if part.best is None:
        return ""
    runs = [{"label": f"{run.name}: {number(run.score)}", "seed": run.seed, "score": run.score} for run in part.runs]
    return f' data-best="{part.best}" data-runs="{escaped(json.dumps(runs))}"'


def _live_part(row: IndexRow, part: str, content: str, attributes: str = "") -> Html:
    """A part of the page that is refreshed."""
    return Html(f'<div id="{part}" data-live="{address(row, f"/{part}")}"{attributes}>{content}</div>')


def _with_refresh_hint(answer: Response, *, is_fresh: bool) -> Response:
    """An answer; if it is not fresh, with the header by which the page asks again."""
    if not is_fresh:
        answer.headers["X-Again"] = "1"
    return answer


def _now(service: Service, user: User, row: IndexRow) -> Html:
    """State and possible actions of a job."""
    ends = "true" if row.state in ENDED else "false"
    facts = f' data-seconds="{_SECONDS}" data-ended="{ends}" data-state="{row.state}"'
    facts += f' data-place="{_journal_place(service, row)}"'
    job, request = row.job, row.job.request
    what: list[tuple[str, object]] = [
        ("score", best(row) or None),
        (request.kind if row.is_study else "mission", job.name),
        ("job", row.id),
    ]
    if user.name != LOCAL.name:
        what.append(("owner", job.owner or "a run folder of no job"))
    method = None
    if isinstance(request, RaceRequest) and request.method:
        method = f"{request.method}, {request.flavour}, seed {request.seed}"
    what += [("method", method), ("priority", request.priority or None)]
    what += [("submitted", moment(job.submitted) or None), ("ended", moment(job.ended) or None)]
    what += [("has run", duration(job.seconds) if job.seconds else None)]
    words = f'<p class="big">{state(row)}</p>{_advice(row)}<div class="bar-of-race">{progress(row)}</div>'
    actions = buttons(row, *ACTIONS, DELETE) if may_change(user, row) else ""
    again = (
        f'<a class="button" href="/new?from={quote(row.id, safe="")}">Run again</a>'
        if row.is_job and not row.is_study
        else ""
    )
    key, links = quote(row.id, safe=""), ""
    if row.best is not None and isinstance(request, RaceRequest) and request.flavour:
        links = f'<a class="button" href="/fsm?job={key}">Edit its FSM</a>'
        links += f'<a class="button" href="/compare?job={key}">Compare</a>'
    all_actions = f'<div class="actions">{_design(service, row)}{actions}{again}{links}</div>'
    return _live_part(row, "now", f"{words}{all_actions}{facts_list(what)}", facts)


def _study_report(service: Service, row: IndexRow) -> Html:
    """The page of a study that has finished."""
    if row.state != "finished" or not row.is_study or not (service.store.run_folder(row.id) / REPORT).exists():
        return Html()
    to = api_address(row, f"/files/{REPORT}")
    return section("report", "Report", f'<iframe class="report" src="{to}" title="The report of the study"></iframe>')


def _design(service: Service, row: IndexRow) -> str:
    """The link that downloads the winner."""
    if row.state not in ENDED or FSM not in files_of(service.store.run_folder(row.id)):
        return ""
    to = api_address(row, f"/files/{FSM}")
    return f'<a class="button main" href="{to}" download="{FSM}">Download {FSM}</a>'


def _advice(row: IndexRow) -> str:
    """Advice on a waiting or failed job."""
    if not row.is_job:
        return '<p class="faint">A run folder in the data folder: it can be looked at here, and not be changed.</p>'
    if row.state == "queued" and not row.message:
        return '<p class="faint">It waits until other jobs have ended.</p>'
    if row.state == "running" and not row.experiments:
        return (
            '<p class="faint">Its process starts. On a new machine, the first one compiles the simulator, which takes '
            "about a minute.</p>"
        )
    if row.state != "failed":
        return ""
    return (
        "<p>Resume it to try again: finished experiments are kept. If it fails again, "
        f"{'submit a changed study' if row.is_study else 'change the mission with <em>Run again</em>'}; "
        "the messages of its process, below, may say more.</p>"
    )


def _without_race(row: IndexRow) -> str:
    if row.state in ("queued", "running"):
        return f'<p class="faint">The {row.job.request.kind} has not begun yet; it will appear here.</p>'
    return f'<p class="faint">The {row.job.request.kind} has not begun.</p>'


def _journal_place(service: Service, row: IndexRow) -> int:
    """Byte offset in the journal from which the page follows the race."""
    journal = service.store.run_folder(row.id) / JOURNAL
    if not length_of(journal):  # as that of a pipe: opening one would wait
        return 0
    with journal.open("rb") as file:
        return end_of(file)


def _changes(user: User, row: IndexRow) -> Html:
    """Form for budget, priority and sharing."""
    if not may_change(user, row):
        return Html()
    request = row.job.request
    shared = (
        f'<label class="tick"><input type="checkbox" name="shared"{" checked" if row.job.shared else ""}> '
        "Show it to all users</label>"
        if user.name != LOCAL.name
        else ""
    )
    budget = (
        ""
        if row.is_study
        else (
            f'<label>New budget (experiments)<input type="number" name="budget" min="{request.budget + 1}" step="1" '
            f'placeholder="{request.budget}" inputmode="numeric"></label>'
        )
    )
    fields = (
        f'{budget}<label>Priority among your jobs<input type="number" name="priority" min="{-MAX_PRIORITY}" '
        f'max="{MAX_PRIORITY}" value="{request.priority}"></label>{shared}<div><button>Change</button></div>'
    )
    form = f'<form class="fields" id="change">{fields}</form>'
    what = "Change its priority" if row.is_study else "Extend its budget, change its priority"
    return folded(what + (", share it" if shared else ""), form)


def _files(service: Service, row: IndexRow) -> Html:
    found = files_of(service.store.run_folder(row.id))
    others = sorted(found.keys() - {*_FIRST})
    if row.is_study:  # of its races there may be thousands; the report and `fetch` lead to them
        others = [name for name in others if not name.startswith((f"{CELLS}/", f"{lock_file(Path()).parent}/"))]
    names = [*(one for one in _FIRST if one in found), *others]
    if not names:
        return _live_part(row, "files", "")
    links = "".join(f"<li>{_link(row, name, found[name])}</li>" for name in names)
    report = ""
    if REPORT in found:
        to = api_address(row, f"/files/{REPORT}")
        report = f'<p><a class="button main" href="{to}" target="_blank" rel="noopener">Open the full report</a></p>'
    return _live_part(row, "files", section("artefacts", "Files", report, f'<ul class="files">{links}</ul>'))


def _link(row: IndexRow, name: str, path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError:  # just removed
        size = 0
    shown = f"{size / 1000:.0f} kB" if size >= 1000 else f"{size} bytes"
    to = api_address(row, f"/files/{quote(name)}")
    link = f'<a href="{to}" target="_blank" rel="noopener"><bdi>{escaped(name)}</bdi></a>'
    return f'{link} <span class="faint">{shown}</span>'


def _messages(service: Service, row: IndexRow) -> Html:
    """The messages of the process of a job, for its owner."""
    text = service.store.without_data_folder(last_messages(service.store.folder(row.id) / OUTPUT))
    shown = f'<pre tabindex="0">{escaped_lines(text)}</pre>' if text else '<p class="faint">There are none.</p>'
    is_open = " open" if row.state == "failed" and text else ""
    return _live_part(row, "messages", f"<details{is_open}><summary>Messages of its process</summary>{shown}</details>")
