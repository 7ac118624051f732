"""The login page, and the ends of sessions."""

from typing import Annotated, Any
from urllib.parse import parse_qs, urlsplit

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from starlette.types import Scope

from mercator_design.serve.accounts.guard import LOGIN, LOGOUT, cookie_name, session_of
from mercator_design.serve.accounts.sessions import DAYS
from mercator_design.serve.http.context import TheService
from mercator_design.serve.web.layout import page
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html

router = APIRouter(include_in_schema=False)

_MAX_TARGET = 2000
_WRONG = "This token is not known, has expired or was revoked."


@router.get(LOGIN)
def login_form(request: Request, target: Annotated[str, Query(alias="to", max_length=_MAX_TARGET)] = "/") -> Response:
    return RedirectResponse("/", 303) if request.state.user else login_page(target)


@router.post(LOGIN)
async def log_in(request: Request, service: TheService) -> Response:
    """Begin a session with a token."""
    accounts, scope = service.accounts, request.scope
    fields = parse_qs((await request.body()).decode("latin-1"))
    (token, *_), (target, *_) = (fields.get(name, [""]) for name in ("token", "to"))
    holder = accounts.users.verify(token.strip())
    if holder is None:
        return login_page(target, _WRONG, status=401)
    request.state.user = holder.user
    if (old := session_of(scope)) is not None:
        accounts.sessions.end(old)
    secret = accounts.sessions.begin(holder.token, holder.expires)
    response = RedirectResponse(_local_target(target), 303)
    response.set_cookie(**_cookie(scope), value=secret, max_age=DAYS * 86_400)
    return response


@router.post(LOGOUT)
def log_out(request: Request, service: TheService) -> Response:
    if (secret := session_of(request.scope)) is not None:
        service.accounts.sessions.end(secret)
    response = RedirectResponse(LOGIN, 303)
    response.delete_cookie(**_cookie(request.scope))
    return response


def _cookie(scope: Scope) -> dict[str, Any]:
    """The name and the attributes of the cookie of a session."""
    return {"key": cookie_name(scope), "secure": scope["scheme"] == "https", "httponly": True, "samesite": "strict"}


def login_page(target: str, wrong: str = "", *, status: int = 200) -> HTMLResponse:
    """The page on which one logs in.

    Args:
        target: Address of this service after the login.
        wrong: Error of the last attempt.
        status: Status of the answer.
    """
    problem = f'<p class="problem" role="alert">{escaped(wrong)}</p>' if wrong else ""
    form = Html(
        f'<form method="post" action="{LOGIN}" class="fields">'
        f'<input type="hidden" name="to" value="{escaped(_local_target(target))}">'
        '<p><label for="token">Token</label><input id="token" name="token" type="password" required autofocus '
        'autocomplete="current-password" spellcheck="false" maxlength="200"></p>'
        '<p><button class="main">Log in</button></p></form>'
        '<p class="faint">The administrator of this service gives you a token: <code>mdesign users add NAME</code>.</p>'
    )
    return page("Log in", problem, form, user=None, status=status)


def _local_target(target: str) -> str:
    """The target, if it is an address of this service; otherwise the first page."""
    try:
        parts = urlsplit(target)
    except ValueError:
        return "/"
    is_own = target.startswith("/") and not target.startswith(("//", "/\\")) and not (parts.scheme or parts.netloc)
    is_plain = target.isascii() and target.isprintable() and "\\" not in target and len(target) <= _MAX_TARGET
    return target if is_own and is_plain and parts.path not in (LOGIN, LOGOUT) else "/"
