"""The pages on which users draw FSMs and run them, and compare those of jobs and designs."""

import contextlib
from typing import NamedTuple

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from mercator_design.config import shipped
from mercator_design.modules.flavour import flavour_names
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.serve.accounts.users import LOCAL, User
from mercator_design.serve.designs import Design
from mercator_design.serve.http.context import TheService, TheUser, visible_job
from mercator_design.serve.http.machines.schemas import MAX_FSMS
from mercator_design.serve.http.problems import Missing
from mercator_design.serve.http.requested import visible_design
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.service import Service
from mercator_design.serve.web.layout import options, page
from mercator_design.show.report.markup import Html

router = APIRouter(include_in_schema=False)

SCRIPTS = ("viewer.js", "results.js")
STYLES = ("viewer.css", "fsm.css")
_FIRST = "mission:aggregation"
_MAX_LISTED = 200
"""Maximum number of jobs, and of designs, in a list."""


@router.get("/fsm")
def editor(service: TheService, user: TheUser, job: str = "", design: str = "") -> HTMLResponse:
    """Draw an FSM: `?job=ID` starts from its winner, `?design=ID` from a design."""
    flavours = options((one, one) for one in flavour_names("pfsm"))
    share = '<label class="check"><input id="shared" type="checkbox"> Share it with all users</label>'
    share = "" if user.name == LOCAL.name else share
    offered = _offered(service, user, job, design)
    rivals = Html(f'<option value="">nothing</option>{_rivals(offered)}')
    return page(
        "FSM editor",
        f"""<form class="fields" id="setting">
<div><label for="mission">Mission</label><select id="mission">{_missions(offered, _FIRST)}</select></div>
<div><label for="flavour">Flavour</label><select id="flavour">{flavours}</select></div>
<div><label for="rival">Compare with</label><select id="rival">{rivals}</select></div>
<div><label for="start">Start from</label><select id="start"></select></div>
</form>
<p id="problem" class="problem" role="alert"></p>
<div class="bench">
<section id="drawing" aria-label="Diagram">
<div class="actions"><button type="button" id="add-state">Add a state</button>
<button type="button" id="undo">Undo</button><button type="button" id="redo">Redo</button></div>
<div id="diagram" class="diagram"></div>
<p class="faint hint">Drag from one state to another to add a transition. Click a state or a transition to change it;
Delete removes it. A flavour limits the numbers of states and of transitions.</p>
<div id="notes" aria-live="polite"></div>
</section>
<section id="part" aria-label="Selected part"></section>
</div>
<form id="running" class="actions run">
{_instances(service)}
<button class="main" id="run">Run</button><span id="progress" class="faint" role="status"></span>
</form>
<div id="results"></div>
<section><h2>As text and in words</h2>
<label for="text">fsm.txt: to copy, or to paste another FSM (also an fsm.yaml)</label>
<textarea id="text" rows="3" spellcheck="false" autocapitalize="off"></textarea>
<div class="actions"><button type="button" id="use-text">Use this text</button>
<button type="button" id="copy-text">Copy</button><span id="text-problem" class="problem" role="alert"></span></div>
<pre id="words"></pre></section>
<section><h2>Save this design</h2><form id="saving" class="actions run">
<div><label for="name">Name</label><input id="name" maxlength="100" required autocomplete="off"></div>
{share}
<button>Save</button><span id="saved" role="status"></span></form></section>
<noscript><p class="problem">This page needs JavaScript.</p></noscript>""",  # noqa: S608 - no SQL
        user=user,
        here="/fsm",
        scripts=(*SCRIPTS, "fsm.js"),
        styles=STYLES,
    )


@router.get("/compare")
def compare(service: TheService, user: TheUser) -> HTMLResponse:
    """Compare designs: `?job=ID&job=ID&design=ID&fsm=TEXT`, in any order and number up to six."""
    offered = _offered(service, user)
    return page(
        "Compare designs",
        f"""<p>Two to {MAX_FSMS} designs run on the same fresh instances of one mission.</p>
<form class="fields" id="adding">
<div><label for="design">Winner or saved design</label><select id="design"><option value="">choose …</option>
{_rivals(offered)}</select></div>
<div><label for="pasted">An FSM as text</label>
<input id="pasted" spellcheck="false" placeholder="--nstates 1 --s0 …"></div>
<div><button id="add">Add</button></div>
</form>
<ol id="chosen" class="chosen" data-max="{MAX_FSMS}"></ol>
<form id="running" class="actions run">
<div><label for="mission">Mission</label><select id="mission"><option value="">of the first design</option>
{_missions(offered)}</select></div>
{_instances(service)}
<button class="main" id="run">Compare</button><span id="progress" class="faint" role="status"></span>
</form>
<div id="results"></div>
<noscript><p class="problem">This page needs JavaScript.</p></noscript>""",
        user=user,
        here="/compare",
        scripts=(*SCRIPTS, "compare.js"),
        styles=STYLES,
    )


def _instances(service: Service) -> Html:
    """The fields for the instances on which FSMs run."""
    most = service.settings.limits.runs
    runs = min(TEST_RUNS, most)
    return Html(
        '<div><label for="runs">Fresh instances</label>'
        f'<input id="runs" type="number" min="1" max="{most}" value="{runs}"></div>'
        '<div><label for="seed">Seed</label><input id="seed" type="number" min="0" value="1"></div>'
    )


class _Offered(NamedTuple):
    """The jobs and designs that lists offer to a user."""

    jobs: list[IndexRow]
    designs: list[Design]


def _offered(service: Service, user: User, job: str = "", design: str = "") -> _Offered:
    """The newest jobs and designs that a user may see; and a job and a design that the user has asked for."""
    jobs, _ = service.index.find(user.viewer, limit=_MAX_LISTED)
    designs = service.designs.find(user.viewer)[:_MAX_LISTED]
    with contextlib.suppress(Missing):
        if job and job not in {one.id for one in jobs}:
            jobs.append(visible_job(service, user, job))
    with contextlib.suppress(Missing):
        if design and design not in {one.id for one in designs}:
            designs.append(visible_design(service, user, design))
    return _Offered(jobs, designs)


def _missions(offered: _Offered, chosen: str = "") -> Html:
    """Options: the missions that a user may use, as `kind:name`."""
    own = [(f"job:{one.id}", f"{one.job.name} ({one.id})") for one in offered.jobs]
    saved = [(f"design:{one.id}", f"{one.mission} (design {one.name})") for one in offered.designs]
    return Html(
        _group("Shipped missions", [(f"mission:{name}", name) for name in shipped.missions()], chosen)
        + _group("Missions of jobs", own)
        + _group("Missions of designs", saved)
    )


def _rivals(offered: _Offered) -> Html:
    """Options: winners of jobs, and saved designs, as `kind:id`."""
    jobs = [
        (f"job:{one.id}", f"{one.job.name}: {'winner' if one.state == 'finished' else 'best so far'} of {one.id}")
        for one in offered.jobs
        if one.best is not None
    ]
    saved = [(f"design:{one.id}", f"{one.mission}: {one.name} by {one.owner}") for one in offered.designs]
    return Html(_group("Jobs", jobs) + _group("Designs", saved))


def _group(name: str, of: list[tuple[str, str]], chosen: str = "") -> str:
    return f'<optgroup label="{name}">{options(of, chosen)}</optgroup>' if of else ""
