"""The page on which designs are compared: on one mission, on the same instances."""

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from mercator_design.serve.http.context import TheService, TheUser
from mercator_design.serve.http.machines.schemas import MAX_FSMS
from mercator_design.serve.web.layout import page
from mercator_design.serve.web.machines import SCRIPTS, STYLES, designs, instances, missions

router = APIRouter(include_in_schema=False)


@router.get("/compare")
def compare(service: TheService, user: TheUser) -> HTMLResponse:
    """Compare designs: `?job=ID&job=ID&design=ID&fsm=TEXT`, in any order and number up to six."""
    return page(
        "Compare designs",
        f"""<p>Two to {MAX_FSMS} designs run on the same fresh instances of one mission.</p>
<form class="fields" id="adding">
<div><label for="design">Winner or saved design</label><select id="design"><option value="">choose …</option>
{designs(service, user)}</select></div>
<div><label for="pasted">An FSM as text</label>
<input id="pasted" spellcheck="false" placeholder="--nstates 1 --s0 …"></div>
<div><button id="add">Add</button></div>
</form>
<ol id="chosen" class="chosen" data-most="{MAX_FSMS}"></ol>
<form id="running" class="actions run">
<div><label for="mission">Mission</label><select id="mission"><option value="">of the first design</option>
{missions(service, user)}</select></div>
{instances(service)}
<button class="main" id="run">Compare</button><span id="progress" class="faint" role="status"></span>
</form>
<div id="results"></div>
<noscript><p class="problem">This page needs JavaScript.</p></noscript>""",
        user=user,
        here="/compare",
        scripts=(*SCRIPTS, "compare.js"),
        styles=STYLES,
    )
