"""The page of a new job: an editor of its mission, and the settings of its race."""

from collections.abc import Iterable
from html import escape
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from mercator_design.config import shipped
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MercatorError, MissionError
from mercator_design.modules.flavour import flavour_names
from mercator_design.race.methods.table import METHODS
from mercator_design.serve.http.context import TheService, TheUser, visible_job
from mercator_design.serve.http.missions import shipped_missions, text_of_job
from mercator_design.serve.http.schemas import MAX_ID, MAX_SEED
from mercator_design.serve.jobs.job import MAX_PRIORITY, MAX_TESTS, RaceRequest
from mercator_design.serve.web.layout import options, page
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html

router = APIRouter(include_in_schema=False)

_FIRST = "foraging"
_BUDGETS = {"first look": 300, "usual": 2000, "thorough": 10_000}
_WORDS = {
    "halving": "halving (recommended)",
    "tpe": "tpe, of Optuna",
    "cma-es": "cma-es, of Optuna",
    "evostick": "evostick: an evolutionary algorithm, for networks",
    "random": "random search",
    "watermelon": "watermelon: for Mercator",
    "chocolate": "chocolate: for e-pucks, without colours",
}
"""Labels of methods and flavours; others have their names as labels."""
_KEYS = (
    "Ctrl-Space: what may be written here. F8: the next mistake. Ctrl-] and Ctrl-[: indent more and less. "
    "Tab leaves the editor; if a menu is open, press Esc, then Tab."
)


@router.get("/new")
def new(
    service: TheService,
    user: TheUser,
    mission: Annotated[str, Query(max_length=200)] = "",
    job: Annotated[str, Query(alias="from", max_length=MAX_ID)] = "",
) -> HTMLResponse:
    """A new job: from a shipped mission, or from the mission of another job."""
    request, name, text, problem = RaceRequest(mission="", budget=_BUDGETS["usual"]), mission or _FIRST, "", ""
    try:
        if job:
            row = visible_job(service, user, job)
            text, name = text_of_job(service, row), ""
            if isinstance(row.job.request, RaceRequest):
                request = row.job.request
        elif name not in shipped.missions():
            raise MissionError(f"there is no shipped mission {name}")
    except MercatorError as error:
        problem, name = str(error), _FIRST
    start = f"mission:{name}" if name else f"job:{job}"
    if name:
        text = _named(text_of(shipped.missions()[name], error=MissionError), name)
    body = (
        f'<p class="problem" role="alert">{escaped(problem)}</p>' if problem else "",
        tabs("/new"),
        _start(name, "" if name else job),
        f'<form id="new" novalidate data-start="{escaped(start)}" data-shipped="{escaped(name)}">',
        _editor(text),
        _settings(service.settings.limits.budget, request),
        "</form>",
    )
    return page("New job", *body, user=user, here="/new", scripts=("codemirror.js", "new.js"), styles=("new.css",))


def _named(text: str, name: str) -> str:
    """Text of a shipped mission, with its name added if the file has none."""
    lines = text.split("\n")
    if any(line.startswith("name:") for line in lines):
        return text
    place = next((number for number, line in enumerate(lines) if line.startswith("schema:")), -1)
    return "\n".join([*lines[: place + 1], f"name: {name}", *lines[place + 1 :]])


def _start(name: str, job: str) -> Html:
    """Form with the mission to start from."""
    own = f'<option value="" selected>job {escaped(job)}</option>' if job else ""
    offered = (
        (one.name, f"{one.name}: {one.robots} robots, {one.duration:g} s, {one.direction} {one.objective}")
        for one in shipped_missions().values()
    )
    about = shipped_missions()[name] if name else None
    words = f'{escaped(about.description)} <span class="faint">{escaped(about.source)}</span>' if about else ""
    return Html(
        '<form id="start" class="start" method="get" action="/new"><div><label for="mission">Start from</label>'
        f'<select id="mission" name="mission">{own}{options(offered, name)}</select></div><button>Open</button></form>'
        f'<p class="about">{words}</p>'
    )


def _editor(text: str) -> Html:
    return Html(
        '<div class="desk"><section class="write" aria-labelledby="text-label">'
        '<label id="text-label" for="text">Mission (YAML)</label>'
        f'<div id="editor"></div><textarea id="text" rows="30" spellcheck="false">\n{escape(text)}</textarea>'
        f'<p id="keys" class="faint">{escaped(_KEYS)}</p>'
        '<div class="actions"><button type="button" id="back" disabled>Discard my changes</button>'
        '<span id="kept" class="faint" role="status"></span></div>'
        '<p id="summary" class="summary" role="status">Reading …</p><ol id="findings" class="findings"></ol></section>'
        '<section class="show" aria-label="Picture and facts">'
        '<figure><img id="picture" alt="" hidden><figcaption id="caption" role="status">Drawing …</figcaption></figure>'
        '<dl id="facts"></dl></section></div>'
    )


def _settings(limit: int, request: RaceRequest) -> Html:
    presets = "".join(
        f'<button type="button" data-budget="{budget}">{budget}, {name}</button>'
        for name, budget in _BUDGETS.items()
        if budget <= limit
    )
    budget = number_field("budget", "Budget (number of experiments)", max(1, request.budget), 1, limit)
    fields = (
        _choice("method", "Method", METHODS, request.method),
        _choice("flavour", "Flavour of modules", flavour_names(), request.flavour),
        number_field("seed", "Seed", request.seed, 0, MAX_SEED),
        number_field("test_runs", "Fresh instances to test the winner on", request.test_runs, 0, MAX_TESTS),
        number_field("priority", "Priority among your jobs", request.priority, -MAX_PRIORITY, MAX_PRIORITY),
    )
    return Html(
        f'<section id="race"><h2>Race</h2><div class="budget">{budget}'
        f'<div class="presets" role="group" aria-label="Usual budgets">{presets}</div></div>'
        f'<div class="fields">{"".join(fields)}</div>'
        '<p id="estimate" role="status">Estimating the time … On a new machine this takes a minute, because the '
        "simulator is compiled. You need not wait for it.</p>"
        '<p id="notice" class="problem" role="alert" tabindex="-1"></p>'
        '<div class="actions"><button id="submit" class="main">Submit the job</button></div></section>'
    )


def tabs(here: str) -> Html:
    """Links to the forms of the kinds of jobs."""
    kinds = {"/new": "A race", "/new/study": "A study"}
    links = (f'<a href="{to}"{" aria-current=page" * (to == here)}>{word}</a>' for to, word in kinds.items())
    return Html(f'<nav class="tabs" aria-label="Kind of job">{"".join(links)}</nav>')


def number_field(name: str, label: str, value: int, low: int, high: int) -> str:
    field = (
        f'<input type="number" id="{name}" name="{name}" value="{value}" min="{low}" max="{high}" step="1" required>'
    )
    return f'<div><label for="{name}">{escaped(label)}</label>{field}</div>'


def _choice(name: str, label: str, words: Iterable[str], chosen: str) -> str:
    shown = options(((word, _WORDS.get(word, word)) for word in words), chosen)
    return f'<div><label for="{name}">{escaped(label)}</label><select id="{name}" name="{name}">{shown}</select></div>'
