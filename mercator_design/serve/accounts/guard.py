"""The guard in front of every request: it refuses requests of unknown users, except to a few public addresses."""

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
from mercator_design.serve.accounts.endpoint import Endpoint
from mercator_design.serve.accounts.refusals import SAFE, ClientGone, Refusal
from mercator_design.serve.accounts.users import LOCAL, Holder, User
from mercator_design.serve.settings import ServiceError

_log = logging.getLogger(__name__)

HEALTH = frozenset({"/healthz", "/readyz"})
"""Addresses of health checks, public under any host name."""
LOGIN, LOGOUT = "/login", "/logout"
CHECK_SECONDS = 0.5
"""Seconds between two checks of the login of an event stream's user."""
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
"""Default headers of every answer."""
_YEAR = "max-age=31536000"
_JOB = re.compile(r"/(?:api/v1/)?jobs/([^/]+)")


def cookie_name(scope: Scope) -> str:
    """The name of the cookie of a session. Over TLS, a browser takes this name from no other host."""
    return "__Host-session" if scope["scheme"] == "https" else "session"


def session_of(scope: Scope) -> str | None:
    """Secret of the session in a request's cookie."""
    return HTTPConnection(scope).cookies.get(cookie_name(scope))


def address_of(scope: Scope) -> str:
    """The address of the client, or "unknown"."""
    client = scope.get("client")
    return str(client[0]) if client else "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteInfo:
    """Facts of the application's routes that the guard needs.

    login_page: Login page that leads to an address.
    assets: Addresses that the login page loads.
    is_stream: Whether an address has an event stream.
    """

    login_page: Callable[[str], Response]
    assets: frozenset[str]
    is_stream: Callable[[str], bool]

    def is_public(self, method: str, path: str) -> bool:
        """Whether a request needs no login."""
        if path == LOGIN:
            return method in ("GET", "POST")
        return method == "GET" and (path in HEALTH or path in self.assets)


class Guard:
    """Middleware that refuses requests, or adds the user to the state of the request."""

    def __init__(
        self,
        app: ASGIApp,
        accounts: Accounts,
        endpoint: Endpoint,
        route_info: RouteInfo,
        *,
        body_seconds: float = refusals.BODY_SECONDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._app, self._accounts, self._endpoint, self._routes = app, accounts, endpoint, route_info
        self._body_seconds, self._clock = body_seconds, clock

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # there are no WebSockets here
            await send({"type": "websocket.close", "code": 1008})
            return
        scope.setdefault("state", {})["user"] = None
        exchange = _Exchange(scope, send)
        try:
            await self._answer(exchange, receive)
        except Refusal as refusal:
            await self._refuse(exchange, refusal, receive)
        except ClientGone:
            return
        finally:
            self._record(exchange)

    async def _answer(self, exchange: "_Exchange", receive: Receive) -> None:
        scope, headers = exchange.scope, exchange.headers
        refusals.check_sizes(scope, headers)
        if not (exchange.path in HEALTH and exchange.method == "GET"):
            refusals.check_host(headers, self._endpoint)
            try:
                self._identify(exchange)
            except (ServiceError, sqlite3.Error) as error:
                _log.error("%s", error)
                wrong = "the service cannot read its users"
                raise Refusal(503, "Not available", wrong, {"Retry-After": "5"}) from None
            refusals.check_forwarding(scope, headers, self._endpoint, is_local_user=exchange.user is LOCAL)
            refusals.check_site(headers, exchange.method)
        if exchange.user is None and not self._routes.is_public(exchange.method, exchange.path):
            raise self._not_logged_in(exchange)
        if exchange.method not in SAFE:
            is_login = exchange.path == LOGIN
            if not exchange.has_bearer:
                refusals.check_origin(scope, headers, has_cookie=exchange.holder is not None)
            refusals.check_content_type(headers, is_login=is_login)
        if exchange.method == "GET" and self._routes.is_stream(exchange.path):
            await self._stream(exchange, receive)
        elif exchange.user is None:
            await self._request(exchange, receive)
        else:
            with self._accounts.requests.count(exchange.user.name):
                await self._request(exchange, receive)

    async def _request(self, exchange: "_Exchange", receive: Receive) -> None:
        """Read the body of a request, and let the application answer."""
        if exchange.method not in SAFE:
            limit = refusals.MAX_FORM if exchange.path == LOGIN else refusals.MAX_BODY
            body = await refusals.read_body(receive, exchange.headers, limit, self._body_seconds, self._clock)
            exchange.is_read = True
            receive = refusals.receive_again(body, receive)
        await self._app(exchange.scope, receive, exchange.send)

    def _identify(self, exchange: "_Exchange") -> None:
        """Find the user of a request, by token or session."""
        scope, headers, accounts = exchange.scope, exchange.headers, self._accounts
        if "authorization" in headers:
            exchange.has_bearer = True
            given = headers.getlist("authorization")
            scheme, _, token = given[0].partition(" ")
            if len(given) == 1 and scheme.lower() == "bearer":
                exchange.holder = accounts.users.verify(token.strip())
            exchange.has_failed = exchange.holder is None
            if exchange.has_failed and exchange.path not in (LOGIN, *self._routes.assets):
                raise self._not_logged_in(exchange)
        elif (secret := session_of(scope)) is not None:
            exchange.holder = accounts.holder_of_session(secret)
        if exchange.holder is not None:
            scope["state"]["user"] = exchange.holder.user
        elif not exchange.has_bearer and self._endpoint.is_local and not accounts.users.accounts():
            scope["state"]["user"] = LOCAL

    def _not_logged_in(self, exchange: "_Exchange") -> Refusal:
        """Refusal of a request without a valid login."""
        error = "expected the token of a user: Authorization: Bearer md_...; or a session: log in at /login"
        if exchange.has_bearer:
            error = "Authorization: expected Bearer and a token that is known, has not expired and was not revoked"
        return Refusal(401, "Not logged in", error, {"WWW-Authenticate": "Bearer"})

    async def _refuse(self, exchange: "_Exchange", refusal: Refusal, receive: Receive) -> None:
        headers, exchange.is_refused = exchange.headers, True
        response: Response
        if refusal.status == 401 and not exchange.has_bearer and not exchange.path.startswith("/api/"):
            if "hx-request" in headers:  # a part of a page: the browser shows the login instead of the page
                refusal.headers["HX-Redirect"] = LOGIN
            elif exchange.method == "GET" and "text/html" in headers.get("accept", ""):
                query = exchange.scope.get("query_string", b"").decode("latin-1")
                response = self._routes.login_page(exchange.path + (f"?{query}" if query else ""))
                response.status_code = 401
                await response(exchange.scope, receive, exchange.send)
                return
        if refusals.has_body(headers) and not exchange.is_read:
            refusal.headers["Connection"] = "close"  # nobody reads what follows
        problem = {"title": refusal.title, "status": refusal.status, "errors": [refusal.error]}
        response = JSONResponse(problem, refusal.status, refusal.headers, "application/problem+json")
        await response(exchange.scope, receive, exchange.send)

    async def _stream(self, exchange: "_Exchange", receive: Receive) -> None:
        """Answer with an event stream, until its user is logged out."""
        ended, name = asyncio.Event(), exchange.user.name if exchange.user else ""

        async def received() -> Message:
            message, end = asyncio.ensure_future(receive()), asyncio.ensure_future(ended.wait())
            try:
                while not (message.done() or ended.is_set()):
                    await asyncio.wait((message, end), timeout=CHECK_SECONDS, return_when=asyncio.FIRST_COMPLETED)
                    if not self._is_still_logged_in(exchange):
                        ended.set()
                return message.result() if message.done() else {"type": "http.disconnect"}
            finally:
                message.cancel()
                end.cancel()

        async def sent(message: Message) -> None:
            is_start = message["type"] == "http.response.start"
            if not (is_start or self._is_still_logged_in(exchange)):
                ended.set()
            if is_start or not ended.is_set():
                await exchange.send(message)

        with self._accounts.streaming(name, ended):
            await self._app(exchange.scope, received, sent)
            if ended.is_set() and exchange.status and not exchange.is_complete:
                await exchange.send({"type": "http.response.body", "body": b""})

    def _is_still_logged_in(self, exchange: "_Exchange") -> bool:
        """Whether the user of a stream is still logged in."""
        try:
            if exchange.holder is None:
                return self._endpoint.is_local and not self._accounts.users.accounts()
            if exchange.has_bearer:
                return self._accounts.users.holder(exchange.holder.token) is not None
            return self._accounts.holder_of_session(session_of(exchange.scope) or "") is not None
        except (ServiceError, sqlite3.Error) as error:
            _log.error("%s", error)
            return False

    def _record(self, exchange: "_Exchange") -> None:
        """Count an answer, and write it to the audit log if it is about a change or a failed login."""
        self._accounts.answers[exchange.status] += 1
        is_due = exchange.method not in SAFE or (exchange.has_failed and exchange.status == 401)
        is_stranger = exchange.holder is None and (exchange.user is None or exchange.is_refused)
        if is_due and not (is_stranger and self._accounts.audit_rate.is_exceeded(address_of(exchange.scope))):
            job = _JOB.match(exchange.location or exchange.path)
            self._accounts.audit.write(
                user=exchange.user.name if exchange.user else "",
                address=address_of(exchange.scope),
                what=f"{exchange.method} {exchange.path}",
                job=job[1] if job else "",
                answer=exchange.status,
            )


class _Exchange:
    """A request, the known facts of its sender, and its answer."""

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
        """Sender; None if unknown."""
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
