"""The page with the list of jobs."""

from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from mercator_design.serve.accounts.users import LOCAL, User
from mercator_design.serve.http.context import TheService, TheUser, may_change
from mercator_design.serve.jobs.index import ORDERS, IndexRow
from mercator_design.serve.jobs.job import STATES
from mercator_design.serve.service import Service
from mercator_design.serve.web.job_parts import ACTIONS, address, best, buttons, moment, progress, state
from mercator_design.serve.web.layout import fragment, options, page
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html

router = APIRouter(include_in_schema=False)

_PAGE = 25  # rows of a page
_SECONDS = 3  # between two refreshes
_WHOSE = {"": "all", "mine": "mine", "shared": "shared"}
_ORDERS = {name: name for name in ORDERS} | {"submitted": "time", "name": "mission", "best": "score"}


class _JobFilter:
    """Filter and order of the list of jobs; unknown values are ignored."""

    def __init__(
        self,
        state: Annotated[str, Query(max_length=20)] = "",
        whose: Annotated[str, Query(max_length=20)] = "",
        owner: Annotated[str, Query(max_length=100)] = "",
        text: Annotated[str, Query(max_length=200)] = "",
        order: Annotated[str, Query(max_length=20)] = "submitted",
        direction: Annotated[str, Query(max_length=4)] = "down",
        page: Annotated[str, Query(max_length=9)] = "1",
    ) -> None:
        self.state = state if state in STATES else ""
        self.whose = whose if whose in _WHOSE else ""
        self.order = order if order in ORDERS else "submitted"
        self.direction = "up" if direction == "up" else "down"
        self.owner, self.text = owner.strip(), text.strip()
        self.page = max(1, int(page)) if page.isascii() and page.isdigit() else 1

    def query(self, *, page: int | None = None) -> str:
        """Query string with a question mark, without default values."""
        known = {
            "state": self.state, "whose": self.whose, "owner": self.owner, "text": self.text,
            "order": "" if self.order == "submitted" else self.order,
            "direction": "" if self.direction == "down" else "up",
            "page": "" if (number := page or self.page) == 1 else str(number),
        }  # fmt: skip
        return "?" + urlencode({name: value for name, value in known.items() if value})

    def find(self, service: Service, user: User) -> tuple[list[IndexRow], int]:
        """A page of rows, and the number of all."""
        return service.index.find(
            user.viewer,
            states=[one for one in STATES if one == self.state],
            owner=user.name if self.whose == "mine" else self.owner,
            text=self.text, shared=self.whose == "shared", order=self.order, descending=self.direction == "down",
            limit=_PAGE, offset=(self.page - 1) * _PAGE,
        )  # fmt: skip


_TheFilter = Annotated[_JobFilter, Depends()]


@router.get("/")
def jobs(service: TheService, user: TheUser, wanted: _TheFilter) -> HTMLResponse:
    """All jobs that the user may see."""
    notice = Html('<p id="notice" class="problem" role="status"></p>')
    body = (_form(wanted, user), notice, _list(service, user, wanted))
    return page("Jobs", *body, user=user, here="/", scripts=("live.js",), styles=("jobs.css",))


@router.get("/jobs")
def part(service: TheService, user: TheUser, wanted: _TheFilter) -> HTMLResponse:
    """The list alone, for a page that is open."""
    return fragment(_list(service, user, wanted))


def _form(wanted: _JobFilter, user: User) -> Html:
    def select(name: str, label: str, offered: dict[str, str], chosen: str) -> str:
        return f'<label>{label}<select name="{name}">{options(offered.items(), chosen)}</select></label>'

    def text(name: str, label: str, value: str) -> str:
        return f'<label>{label}<input type="search" name="{name}" value="{escaped(value)}" maxlength="100"></label>'

    users = user.name != LOCAL.name
    fields = [
        text("text", "Mission or job", wanted.text),
        select("state", "State", {"": "all", **{one: one for one in STATES}}, wanted.state),
        select("whose", "Whose", _WHOSE, wanted.whose) if users else "",
        text("owner", "Owner", wanted.owner) if users else "",
        select("order", "Order by", _ORDERS, wanted.order),
        select(
            "direction",
            "Direction",
            {"down": "largest or latest first", "up": "smallest or oldest first"},
            wanted.direction,
        ),
    ]
    return Html(
        '<form class="fields filter" action="/" hx-get="/jobs" hx-target="#jobs" hx-swap="outerMorph" '
        f'hx-trigger="submit, input delay:250ms" role="search" aria-label="Jobs to show">{"".join(fields)}'
        "<noscript><button>Show</button></noscript></form>"
    )


def _list(service: Service, user: User, wanted: _JobFilter) -> Html:
    rows, total = wanted.find(service, user)
    if not rows and wanted.page > 1:
        wanted.page = max(1, -(-total // _PAGE))
        rows, total = wanted.find(service, user)
    live = f'id="jobs" data-live="/jobs{escaped(wanted.query())}" data-seconds="{_SECONDS}"'
    return Html(f"<div {live}>{_shortage(service)}{_table(rows, user) if rows else _empty_list(wanted)}"
                f"{_pages(wanted, total)}</div>")  # fmt: skip


def _shortage(service: Service) -> str:
    what = service.supervisor.shortage
    return f'<p class="problem">The disk is nearly full: every job {escaped(what)}.</p>' if what else ""


def _empty_list(wanted: _JobFilter) -> Html:
    if wanted.query() != "?":
        return Html('<p>No job matches. <a href="/">Show all jobs</a></p>')
    return Html(
        '<div class="card first"><h2>No jobs yet</h2><p>A job designs control software for a swarm: you choose or '
        "write a mission, the service tries controllers in simulation, and you watch, replay and keep the best.</p>"
        '<p><a class="button main" href="/new">Submit the first job</a></p></div>'
    )


def _table(rows: list[IndexRow], user: User) -> Html:
    has_owners = user.name != LOCAL.name
    head = ["Mission", "State", "Experiments", "Score", *(["Owner"] if has_owners else []), "Submitted", "Actions"]
    titles = "".join(f'<th scope="col">{one}</th>' for one in head)
    lines = "".join(_table_row(row, user, has_owners=has_owners) for row in rows)
    whole = f'<table class="jobs"><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>'
    return Html(f'<div class="scroll" tabindex="0">{whole}</div>')


def _table_row(row: IndexRow, user: User, *, has_owners: bool) -> Html:
    name = f'<a href="{address(row)}"><bdi>{escaped(row.job.name)}</bdi></a>'
    shared = ' <span class="tag">shared</span>' if row.job.shared and has_owners else ""
    cells = [
        ("mission", f'{name}{shared}<span class="id faint">{escaped(row.id)}</span>'),
        ("what", state(row)),
        ("done", progress(row)),
        ("best", f'<span class="label">Score</span> {value}' if (value := best(row)) else ""),
    ]
    if has_owners:
        owner = f'<span class="label">Owner</span> <bdi>{escaped(row.job.owner)}</bdi>' if row.is_job else "run folder"
        cells.append(("owner", owner))
    cells.append(("when", moment(row.job.submitted)))
    cells.append(("actions", buttons(row, *ACTIONS) if may_change(user, row) else ""))
    shown = "".join(f'<td class="{name}">{cell}</td>' for name, cell in cells)
    return Html(f'<tr id="{escaped(f"job-{row.id}")}">{shown}</tr>')


def _pages(wanted: _JobFilter, total: int) -> Html:
    last = max(1, -(-total // _PAGE))
    if last == 1:
        return Html(f'<p class="faint">{total} job{"s" * (total != 1)}</p>' if total else "")
    before = f'<a href="/{escaped(wanted.query(page=wanted.page - 1))}">Previous</a>' if wanted.page > 1 else ""
    after = f'<a href="/{escaped(wanted.query(page=wanted.page + 1))}">Next</a>' if wanted.page < last else ""
    return Html(
        f'<nav class="pages" aria-label="Pages of the list">{before} <span class="faint">page {wanted.page} of {last}, '
        f"{total} jobs</span> {after}</nav>"
    )
