"""The page of a race: all sections in one HTML file that makes no request; and the page of a race that is followed."""

from collections.abc import Sequence
from importlib.resources import files
from itertools import compress

from mercator_design.errors import excerpt
from mercator_design.results.analysis.comparison import WinnerComparison
from mercator_design.results.experiments.winner import WinnerRuns
from mercator_design.results.facts import Facts
from mercator_design.show.charts import STYLE
from mercator_design.show.markup import escaped
from mercator_design.show.page import POLICY, document, viewer_script, viewer_style
from mercator_design.show.replay import replay_of
from mercator_design.show.report.answer import answer
from mercator_design.show.report.comparison import comparison_part, elites_part
from mercator_design.show.report.course import course
from mercator_design.show.report.front import front_part
from mercator_design.show.report.importance import importance
from mercator_design.show.report.markup import Html, contents, note
from mercator_design.show.report.origin import origin
from mercator_design.show.report.replays import winner_at_work
from mercator_design.show.report.request import request

REPORT = "report.html"
MAX_SIZE = 1_200_000
"""Bytes of a page; replays that do not fit are left out."""


def report_page(facts: Facts, shown: WinnerRuns, comparison: WinnerComparison | None = None, without: str = "") -> str:
    """The page of a race, at whatever stage it is.

    The comparison is that of the winner with others on fresh instances; `without` says why there is none.
    """
    of_winner = [run.configuration == facts.best for run in shown.runs]
    traces = [one.trace for one in compress(shown.experiments, of_winner)]
    first = Html(answer(facts, comparison, traces) + front_part(facts))
    last = [
        comparison_part(facts, comparison, without),
        request(facts),
        course(facts),
        elites_part(facts),
        importance(facts),
        origin(facts),
    ]
    replays = [replay_of(one) for one in shown.experiments]
    while True:
        page = _page(facts, [first, winner_at_work(facts, shown, replays), *last], viewer=bool(replays))
        if len(page.encode()) <= MAX_SIZE or not replays:
            return page
        replays = replays[:-1]


def live_part(facts: Facts) -> Html:
    """The part of a page that changes while the race runs."""
    record = facts.record
    done = len(record.experiments)
    bar = f'<progress max="{record.budget}" value="{done}">{done} of {record.budget}</progress>'
    return Html(f'<p id="state">{_state(facts)}</p>{bar}{answer(facts, None, [])}{course(facts)}')


def following_page(facts: Facts) -> str:
    """The page of a race that is running, which asks for its live part again and again."""
    sections = [Html(f'<div id="live">{live_part(facts)}</div>'), request(facts), origin(facts)]
    return _page(facts, sections, viewer=False, follows=True)


def _page(facts: Facts, sections: Sequence[str], *, viewer: bool, follows: bool = False) -> str:
    title = excerpt(str(facts.start["name"]))
    body = "".join([*(note(f"Note: {text}") for text in facts.notes), *sections])
    head = "" if follows else f'<p>{_state(facts)}</p><nav class="toc">{contents(body)}</nav>'
    styles = [*([viewer_style()] if viewer else []), STYLE, asset("page.css")]
    scripts = [*([viewer_script()] if viewer else []), asset("page.js"), *([asset("follow.js")] if follows else [])]
    policy = f"{POLICY}; connect-src 'self'" if follows else POLICY
    whole = f'<header class="top"><h1><bdi>{escaped(title)}</bdi></h1>{head}</header>\n<main>{body}</main>'
    return document(f"{title}: report of a race", "".join(styles), whole, "\n".join(scripts), policy=policy)


def _state(facts: Facts) -> str:
    record = facts.record
    n = sum(not one.postselection for one in record.iterations.values())
    return escaped(
        f"Race by {facts.start['method']}, {facts.state}: {len(record.experiments)} of {record.budget} experiments, "
        f"{n} iteration{'s' * (n != 1)}, {len(record.configurations)} configurations"
    )


def asset(name: str) -> str:
    """A file of the page: its style, page.css; its scripts, page.js for copying and replays, and follow.js."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
