"""The frame of all pages: head, navigation, policy."""

from collections.abc import Iterable, Sequence

from fastapi import Request
from fastapi.responses import HTMLResponse

from mercator_design.serve.accounts.users import LOCAL, User
from mercator_design.serve.http.problems import ProblemAnswer
from mercator_design.serve.web.assets import assets
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Content policy of pages: only own scripts, no other servers."""
_STYLES = ("report.css", "charts.css", "app.css")
_SCRIPTS = ("htmx.min.js", "app.js")
_LOGOUT = '<form method="post" action="/logout"><button>Log out</button></form>'
_LINKS = {"/": "Jobs", "/new": "New job", "/fsm": "FSM editor", "/compare": "Compare", "/gallery": "Gallery"}
_HERE = ' aria-current="page"'
_HEADERS = {"Content-Security-Policy": POLICY}


def page(
    title: str,
    *body: str,
    user: User | None,
    here: str = "",
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    status: int = 200,
) -> HTMLResponse:
    """A page.

    Args:
        title: Title of the page.
        body: Its parts, as HTML.
        user: The user; None before the login.
        here: Its link in the navigation.
        scripts: Further assets.
        styles: Further assets.
        status: Status of the answer.
    """
    known = assets()
    head = [f'<link rel="stylesheet" href="{known[name].address}">' for name in (*_STYLES, *styles)]
    head += [f'<script src="{known[name].address}" defer></script>' for name in (*_SCRIPTS, *scripts)]
    config = '{"includeIndicatorCSS": false, "history": false, "morphIgnore": ["data-htmx-powered", "open"]}'
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="htmx-config" content="{escaped(config)}">
<title>{escaped(title)} · mercator_design</title>
<link rel="icon" href="data:,">
{"".join(head)}</head>
<body>{_navigation(user, here)}
<main id="main" class="app"><h1><bdi>{escaped(title)}</bdi></h1>
{"".join(body)}</main></body></html>
"""
    return HTMLResponse(text, status, headers=_HEADERS)


def fragment(*parts: str) -> HTMLResponse:
    """A part of a page, which a script puts in its place."""
    return HTMLResponse("".join(parts), headers=_HEADERS)


def options(of: Iterable[tuple[str, str]], chosen: str = "") -> Html:
    """The options of a list: value and text."""
    return Html(
        "".join(
            f'<option value="{escaped(value)}"{" selected" * (value == chosen)}>{escaped(text)}</option>'
            for value, text in of
        )
    )


def _navigation(user: User | None, here: str) -> Html:
    if user is None:
        return Html('<header class="bar"><span class="brand">mercator_design</span></header>')
    links = "".join(f'<a href="{to}"{_HERE if to == here else ""}>{word}</a>' for to, word in _LINKS.items())
    return Html(
        '<a class="skip" href="#main">To the content</a>'
        f'<header class="bar"><span class="brand">mercator_design</span><nav>{links}</nav>'
        f'<span class="who" dir="auto">{escaped(user.name)}</span>{_LOGOUT if user != LOCAL else ""}</header>'
    )


def problem_page(request: Request, problem: ProblemAnswer) -> HTMLResponse:
    messages = "".join(f'<p class="problem">{escaped(one)}</p>' for one in problem.errors)
    back = '<p><a href="/">To the jobs</a></p>'
    return page(problem.title, messages, back, user=getattr(request.state, "user", None), status=problem.status)
