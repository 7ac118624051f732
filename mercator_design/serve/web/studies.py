"""The page of a new study: its text, the files that it names, and its submission."""

from html import escape
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from mercator_design.config import shipped
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import StudyError
from mercator_design.serve.http.context import TheUser
from mercator_design.serve.jobs.job import MAX_PRIORITY
from mercator_design.serve.web.layout import options, page
from mercator_design.serve.web.missions import number_field, tabs
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html

router = APIRouter(include_in_schema=False)


@router.get("/new/study")
def new_study(user: TheUser, study: Annotated[str, Query(max_length=200)] = "") -> HTMLResponse:
    """A new study, which begins with the text of a shipped one."""
    known, problem = shipped.studies(), ""
    if study and study not in known:
        problem = f'<p class="problem" role="alert">{escaped(f"there is no shipped study {study}")}</p>'
    name = study if study in known else min(known)
    body = (tabs("/new/study"), problem, _start(name), _form(name, text_of(known[name], error=StudyError)))
    return page("New job", *body, user=user, here="/new", scripts=("study.js",), styles=("new.css",))


def _start(name: str) -> Html:
    offered = options(((one, one) for one in shipped.studies()), name)
    return Html(
        '<form id="start" class="start" method="get" action="/new/study"><div><label for="study">Start from</label>'
        f'<select id="study" name="study">{offered}</select></div><button>Open</button></form>'
    )


def _form(name: str, text: str) -> Html:
    priority = number_field("priority", "Priority among your jobs", 0, -MAX_PRIORITY, MAX_PRIORITY)
    return Html(
        f'<form id="new" novalidate data-shipped="{escaped(name)}"><label for="text">Study (YAML)</label>'
        f'<textarea id="text" rows="26" spellcheck="false">\n{escape(text)}</textarea>'
        '<label for="files">Files that it names: missions (YAML), and control software of <code>files</code></label>'
        '<input type="file" id="files" multiple aria-describedby="files-help"><p id="files-help" class="faint">The '
        "study names a file by its name alone, as in <code>missions: [own.yaml]</code> or <code>files: [by-hand.txt]"
        '</code>. Flavours and robot models are shipped ones.</p><ul id="chosen"></ul>'
        f'<div class="fields">{priority}</div>'
        '<p id="notice" class="problem" role="alert" tabindex="-1"></p>'
        '<div class="actions"><button id="submit" class="main">Submit the study</button></div></form>'
    )
