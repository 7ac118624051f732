"""The guard in front of every request: it refuses requests of unknown users.

It refuses by default: it knows no routes, but for a few exact addresses that need no login.
"""

import asyncio
import logging
import re
import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mercator_design.serve.accounts import refusals
from mercator_design.serve.accounts.accounts import Accounts
from mercator_design.serve.accounts.entrance import Entrance
from mercator_design.serve.accounts.refusals import SAFE, Gone, Refusal
from mercator_design.serve.accounts.users import LOCAL, Holder, User
from mercator_design.serve.settings import ServiceError

_log = logging.getLogger(__name__)

HEALTH = frozenset({"/healthz", "/readyz"})
"""Pages that say only whether the service is well, to anybody and under any name."""
LOGIN, LOGOUT = "/login", "/logout"
LOOK_SECONDS = 0.5
"""Seconds between two looks whether the user of an event stream is still logged in."""
_POLICY = "default-src 'none'; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # not no-referrer: then forms of our pages would have no Origin
    "X-Frame-Options": "SAMEORIGIN",
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "Cache-Control": "no-store",
}
"""Headers of every answer that does not have its own."""
_YEAR = "max-age=31536000"
_JOB = re.compile(r"/(?:api/v1/)?jobs/([^/]+)")


def cookie_name(scope: Scope) -> str:
    """The name of the cookie of a session. Over TLS, a browser takes this name from no other host."""
    return "__Host-session" if scope["scheme"] == "https" else "session"


def session_of(scope: Scope) -> str | None:
    """The secret of the session that a browser says it has."""
    return HTTPConnection(scope).cookies.get(cookie_name(scope))


def address_of(scope: Scope) -> str:
    """The address of the client, or "unknown"."""
    client = scope.get("client")
    return str(client[0]) if client else "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Openings:
    """What the guard has to know of the application.

    login_page: Makes the page on which one logs in, which then leads to an address.
    assets: Addresses of what that page loads.
    is_stream: Whether an address has an event stream.
    """

    login_page: Callable[[str], Response]
    assets: frozenset[str]
    is_stream: Callable[[str], bool]

    def are_open(self, method: str, path: str) -> bool:
        """Whether a request needs no login."""
        if path == LOGIN:
            return method in ("GET", "POST")
        return method == "GET" and (path in HEALTH or path in self.assets)


class Guard:
    """Answers what it refuses, and puts the user of all else in the state of the request."""

    def __init__(
        self,
        app: ASGIApp,
        accounts: Accounts,
        entrance: Entrance,
        openings: Openings,
        *,
        body_seconds: float = refusals.BODY_SECONDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._app, self._accounts, self._entrance, self._openings = app, accounts, entrance, openings
        self._body_seconds, self._clock = body_seconds, clock

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # there are no WebSockets here
            await send({"type": "websocket.close", "code": 1008})
            return
        scope.setdefault("state", {})["user"] = None
        visit = _Visit(scope, send)
        try:
            await self._answer(visit, receive)
        except Refusal as refusal:
            await self._refuse(visit, refusal, receive)
        except Gone:
            return
        finally:
            self._note(visit)

    async def _answer(self, visit: "_Visit", receive: Receive) -> None:
        scope, headers = visit.scope, visit.headers
        refusals.check_sizes(scope, headers)
        if not (visit.path in HEALTH and visit.method == "GET"):
            refusals.check_host(headers, self._entrance)
            try:
                self._identify(visit)
            except (ServiceError, sqlite3.Error) as error:
                _log.error("%s", error)
                wrong = "the service cannot read its users"
                raise Refusal(503, "Not available", wrong, {"Retry-After": "5"}) from None
            refusals.check_forwarding(scope, headers, self._entrance, is_local_user=visit.user is LOCAL)
            refusals.check_site(headers, visit.method)
        if visit.user is None and not self._openings.are_open(visit.method, visit.path):
            raise self._unknown(visit)
        if visit.method not in SAFE:
            is_login = visit.path == LOGIN
            if not visit.has_bearer:
                refusals.check_origin(scope, headers, has_cookie=visit.holder is not None)
            refusals.check_kind(headers, is_login=is_login)
        if visit.method == "GET" and self._openings.is_stream(visit.path):
            await self._stream(visit, receive)
        elif visit.user is None:
            await self._request(visit, receive)
        else:
            with self._accounts.requests.count(visit.user.name):
                await self._request(visit, receive)

    async def _request(self, visit: "_Visit", receive: Receive) -> None:
        """Answer a request with the application, once its body has come."""
        if visit.method not in SAFE:
            limit = refusals.MAX_FORM if visit.path == LOGIN else refusals.MAX_BODY
            body = await refusals.read_body(receive, visit.headers, limit, self._body_seconds, self._clock)
            visit.is_read = True
            receive = refusals.replayed(body, receive)
        await self._app(visit.scope, receive, visit.send)

    def _identify(self, visit: "_Visit") -> None:
        """Find the user of a request, by token or session."""
        scope, headers, accounts = visit.scope, visit.headers, self._accounts
        if "authorization" in headers:
            visit.has_bearer = True
            given = headers.getlist("authorization")
            scheme, _, token = given[0].partition(" ")
            if len(given) == 1 and scheme.lower() == "bearer":
                visit.holder = accounts.users.verify(token.strip())
            visit.has_failed = visit.holder is None
            if visit.has_failed and visit.path not in (LOGIN, *self._openings.assets):
                raise self._unknown(visit)
        elif (secret := session_of(scope)) is not None:
            visit.holder = accounts.holder_of_session(secret)
        if visit.holder is not None:
            scope["state"]["user"] = visit.holder.user
        elif not visit.has_bearer and self._entrance.is_local and not accounts.users.accounts():
            scope["state"]["user"] = LOCAL

    def _unknown(self, visit: "_Visit") -> Refusal:
        """Refusal of a request without a valid login."""
        error = "expected the token of a user: Authorization: Bearer md_...; or a session: log in at /login"
        if visit.has_bearer:
            error = "Authorization: expected Bearer and a token that is known, has not expired and was not revoked"
        return Refusal(401, "Not logged in", error, {"WWW-Authenticate": "Bearer"})

    async def _refuse(self, visit: "_Visit", refusal: Refusal, receive: Receive) -> None:
        headers, visit.is_refused = visit.headers, True
        response: Response
        if refusal.status == 401 and not visit.has_bearer and not visit.path.startswith("/api/"):
            if "hx-request" in headers:  # a part of a page: the browser shows the login instead of the page
                refusal.headers["HX-Redirect"] = LOGIN
            elif visit.method == "GET" and "text/html" in headers.get("accept", ""):
                query = visit.scope.get("query_string", b"").decode("latin-1")
                response = self._openings.login_page(visit.path + (f"?{query}" if query else ""))
                response.status_code = 401
                await response(visit.scope, receive, visit.send)
                return
        if refusals.has_body(headers) and not visit.is_read:
            refusal.headers["Connection"] = "close"  # nobody reads what follows
        problem = {"title": refusal.title, "status": refusal.status, "errors": [refusal.error]}
        response = JSONResponse(problem, refusal.status, refusal.headers, "application/problem+json")
        await response(visit.scope, receive, visit.send)

    async def _stream(self, visit: "_Visit", receive: Receive) -> None:
        """Answer with an event stream, until its user may not see it any more."""
        ended, name = asyncio.Event(), visit.user.name if visit.user else ""

        async def received() -> Message:
            message, end = asyncio.ensure_future(receive()), asyncio.ensure_future(ended.wait())
            try:
                while not (message.done() or ended.is_set()):
                    await asyncio.wait((message, end), timeout=LOOK_SECONDS, return_when=asyncio.FIRST_COMPLETED)
                    if not self._is_still_in(visit):
                        ended.set()
                return message.result() if message.done() else {"type": "http.disconnect"}
            finally:
                message.cancel()
                end.cancel()

        async def sent(message: Message) -> None:
            is_start = message["type"] == "http.response.start"
            if not (is_start or self._is_still_in(visit)):
                ended.set()
            if is_start or not ended.is_set():
                await visit.send(message)

        with self._accounts.streaming(name, ended):
            await self._app(visit.scope, received, sent)
            if ended.is_set() and visit.status and not visit.is_complete:
                await visit.send({"type": "http.response.body", "body": b""})

    def _is_still_in(self, visit: "_Visit") -> bool:
        """Whether the user of a stream is still logged in."""
        try:
            if visit.holder is None:
                return self._entrance.is_local and not self._accounts.users.accounts()
            if visit.has_bearer:
                return self._accounts.users.holder(visit.holder.token) is not None
            return self._accounts.holder_of_session(session_of(visit.scope) or "") is not None
        except (ServiceError, sqlite3.Error) as error:
            _log.error("%s", error)
            return False

    def _note(self, visit: "_Visit") -> None:
        """Count an answer, and write it to the audit log if it is about a change or a failed login."""
        self._accounts.answers[visit.status] += 1
        is_due = visit.method not in SAFE or (visit.has_failed and visit.status == 401)
        is_stranger = visit.holder is None and (visit.user is None or visit.is_refused)
        if is_due and not (is_stranger and self._accounts.noise.is_too_much(address_of(visit.scope))):
            job = _JOB.match(visit.location or visit.path)
            self._accounts.audit.write(
                user=visit.user.name if visit.user else "",
                address=address_of(visit.scope),
                what=f"{visit.method} {visit.path}",
                job=job[1] if job else "",
                answer=visit.status,
            )


class _Visit:
    """A request, what is known of who sends it, and its answer."""

    def __init__(self, scope: Scope, send: Send) -> None:
        self.scope, self._send = scope, send
        self.method, self.path = str(scope["method"]), str(scope["path"])
        self.headers = Headers(scope=scope)
        self.holder: Holder | None = None
        self.has_bearer = False
        self.has_failed = False  # to show a valid token
        self.is_read = False  # whether the body was read
        self.is_refused = False  # by the guard
        self.status = 0
        self.location = ""  # of what was made
        self.is_complete = False  # whether the answer has ended

    @property
    def user(self) -> User | None:
        """Who sends it, if that is known."""
        user: User | None = self.scope["state"]["user"]
        return user

    async def send(self, message: Message) -> None:
        """Send a part of the answer, with the headers that every answer has."""
        if message["type"] == "http.response.start":
            self.status = int(message["status"])
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if "sandbox" not in headers["Content-Security-Policy"]:  # browsers refuse both together
                headers.setdefault("Cross-Origin-Opener-Policy", "same-origin")
            if self.scope["scheme"] == "https":
                headers.setdefault("Strict-Transport-Security", _YEAR)
            self.location = headers.get("location", "") if self.status == 201 else ""
        else:
            self.is_complete = not message.get("more_body", False)
        await self._send(message)
