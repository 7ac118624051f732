"""The gallery: saved designs, and the winners of jobs."""

from collections.abc import Sequence
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from mercator_design.serve.accounts.users import User
from mercator_design.serve.designs import Design
from mercator_design.serve.http.context import TheService, TheUser
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.web.layout import page
from mercator_design.serve.web.machines import SCRIPTS, STYLES
from mercator_design.show.charts import number
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html, facts_list

router = APIRouter(include_in_schema=False)

_MAX_SHOWN = 60
"""Designs and jobs on the page, of each kind, the newest first."""


@router.get("/gallery")
def gallery(
    service: TheService, user: TheUser, text: Annotated[str, Query(max_length=200)] = "", own: bool = False
) -> HTMLResponse:
    """Own and shared designs, and own and shared jobs that have finished."""
    whose = user.name if own else ""
    saved = service.designs.find(user.name, owner=whose, text=text)[:_MAX_SHOWN]
    rows, _ = service.index.find(user.name, states=("finished",), owner=whose, text=text, limit=_MAX_SHOWN)
    cards = [
        *((one.created, _design_card(one, user)) for one in saved),
        *((row.job.ended or row.job.submitted, _job_card(row)) for row in rows if not row.is_study),
    ]
    cards.sort(key=lambda card: card[0], reverse=True)
    checked = " checked" if own else ""
    shown = "".join(card for _, card in cards)
    nothing = '<p class="faint">Nothing is here yet: save a design in the <a href="/fsm">FSM editor</a>.</p>'
    return page(
        "Gallery",
        f"""<form class="actions run" role="search">
<div><label for="text">Name or mission</label>
<input id="text" name="text" maxlength="200" value="{escaped(text)}"></div>
<label class="check"><input type="checkbox" name="own" value="true"{checked}> Only mine</label>
<button>Show</button><button type="button" id="compare" disabled>Compare the chosen</button></form>
<div class="cards" id="cards">{shown}</div>{"" if cards else nothing}
<dialog class="large" id="viewer" aria-label="Replay">
<div class="actions"><button type="button" id="close">Close</button></div><div id="replay"></div></dialog>""",
        user=user,
        here="/gallery",
        scripts=(*SCRIPTS, "gallery.js"),
        styles=STYLES,
    )


def _design_card(one: Design, user: User) -> Html:
    score = None if one.mean is None else f"{number(one.mean)} on {len(one.scores)} fresh instances ({one.direction})"
    facts = [("Mission", one.mission), ("Score", score), ("By", one.owner), ("Saved", one.created[:10])]
    mine = ""
    if user.owns(one.owner):
        word = "Keep to yourself" if one.shared else "Share"
        mine = (
            f'<button type="button" data-share="{str(not one.shared).lower()}">{word}</button>'
            '<button type="button" class="danger" data-delete>Delete</button>'
        )
    fetch = f"/api/v1/designs/{one.id}/fsm.txt"
    return _card("design", one.id, one.name, facts, fetch, f"{mine}<span class='problem' role='alert'></span>")


def _job_card(row: IndexRow) -> Html:
    job = row.job
    score = None if row.best is None else f"{number(row.best)} {row.measured} ({job.direction})"
    link = Html(f'<a href="/jobs/{quote(row.id)}"><bdi>{escaped(row.id)}</bdi></a>') if row.is_job else row.id
    facts = [("Job", link), ("Score", score), ("By", job.owner or None), ("Ended", (job.ended or job.submitted)[:10])]
    return _card("job", row.id, job.name, facts, f"/api/v1/jobs/{quote(row.id)}/files/fsm.txt", "")


def _card(kind: str, identity: str, name: str, facts: Sequence[tuple[str, object]], fetch: str, more: str) -> Html:
    key = escaped(identity)
    return Html(
        f'<article class="card" id="{key}" data-kind="{kind}" data-id="{key}"><h2><bdi>{escaped(name)}</bdi></h2>'
        f'<div class="diagram" aria-busy="true"></div>{facts_list(facts)}'
        f'<label class="check"><input type="checkbox" data-compare> Compare'
        f'<span class="sr"> {escaped(name)}</span></label>'
        f'<div class="actions"><button type="button" data-replay>Replay</button>'
        f'<a class="button" href="/fsm?{kind}={quote(identity)}">Edit</a>'
        f'<a class="button" href="{escaped(fetch)}" download="fsm.txt">fsm.txt</a>{more}</div></article>'
    )
