"""Checks of every request: host, sizes, origin, body. A check that fails raises a Refusal."""

import asyncio
import re
from collections.abc import Callable, Iterator, Mapping

from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope

from mercator_design.errors import excerpt, printable
from mercator_design.serve.accounts.endpoint import Endpoint

MAX_BODY = 1_000_000
"""Maximum size of a body [bytes]."""
MAX_FORM = 4096
"""Maximum size of the login form [bytes]."""
BODY_SECONDS = 30.0
"""Time limit of reading a body [s]."""
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""
_MAX_HEADERS, _MAX_HEADER_BYTES, _MAX_TARGET = 100, 16_384, 4096
_FORWARDED = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip")
_JSON = re.compile(r"application/(?:[\w.-]+\+)?json\s*(?:;.*)?", re.IGNORECASE)
_FORM = re.compile(r"application/x-www-form-urlencoded\s*(?:;.*)?", re.IGNORECASE)


class Refusal(Exception):  # noqa: N818 - an answer
    """An answer with a problem instead of the requested one."""

    def __init__(self, status: int, title: str, error: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(error)
        self.status, self.title, self.error = status, title, printable(error)
        self.headers = dict(headers or {})


def check_sizes(scope: Scope, headers: Headers) -> None:
    """Refuse a long target, many or long headers, and a body on a method that takes none."""
    if len(scope.get("raw_path") or b"") + len(scope.get("query_string") or b"") > _MAX_TARGET:
        raise Refusal(414, "Address too long", f"expected an address of at most {_MAX_TARGET} bytes")
    if (
        len(headers.raw) > _MAX_HEADERS
        or sum(len(name) + len(value) for name, value in headers.raw) > _MAX_HEADER_BYTES
    ):
        raise Refusal(
            431, "Headers too large", f"expected at most {_MAX_HEADERS} headers of {_MAX_HEADER_BYTES} bytes in all"
        )
    if scope["method"] in SAFE and has_body(headers):
        raise Refusal(413, "Too large", f"expected no body: {scope['method']} changes nothing")


def check_host(headers: Headers, endpoint: Endpoint) -> None:
    """Refuse a request for another host: a page of another site may have rebound its name to this machine."""
    hosts = headers.getlist("host")
    if len(hosts) != 1 or not endpoint.serves_host(hosts[0]):
        found = excerpt(", ".join(hosts)) or "none"
        raise Refusal(
            421,
            "Misdirected request",
            f"Host: expected a name of this service, found {found}; hosts in serve.yaml adds one",
        )


def check_forwarding(scope: Scope, headers: Headers, endpoint: Endpoint, *, is_local_user: bool) -> None:
    """Refuse forwarded requests on a service without users, and requests that reached the proxy without TLS."""
    if is_local_user and (found := [name for name in _FORWARDED if name in headers]):
        raise Refusal(
            403,
            "Not allowed",
            f"{found[0]}: a service without users is for this machine alone, and a proxy has forwarded this: "
            "add users and --behind-proxy",
        )
    if endpoint.is_behind_proxy and scope["scheme"] != "https":
        raise Refusal(403, "Not allowed", "expected a request over TLS by the proxy: X-Forwarded-Proto: https")


def check_site(headers: Headers, method: str) -> None:
    """Refuse requests by pages of other sites, except links."""
    if headers.get("sec-fetch-site") in ("cross-site", "same-site") and not (
        method == "GET" and headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    ):
        raise Refusal(403, "Not allowed", "a page of another site may link here, but not use this service")


def check_origin(scope: Scope, headers: Headers, *, has_cookie: bool) -> None:
    """Refuse a change that a page of another site asks for in the name of a user (CSRF).

    A browser says where a change comes from. A program may say nothing, but then it has no cookie.
    """
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site is not None:
        allowed = site == "same-origin"
    elif origin is not None:
        allowed = origin.lower() == f"{scope['scheme']}://{headers['host']}".lower()
    else:
        allowed = not has_cookie and not headers.get("user-agent", "").startswith("Mozilla/")
    if not allowed:
        found = f"Sec-Fetch-Site: {site}" if site is not None else f"Origin: {origin}" if origin else "no Origin"
        raise Refusal(
            403, "Not allowed", f"expected a change that a page of this service asks for, found {excerpt(found)}"
        )


def check_content_type(headers: Headers, *, is_login: bool) -> None:
    """Refuse a content type that a form of another site could send."""
    kind = headers.get("content-type", "")
    if has_body(headers) and not (_FORM if is_login else _JSON).fullmatch(kind):
        expected = "application/x-www-form-urlencoded" if is_login else "application/json"
        raise Refusal(415, "Not this kind", f"Content-Type: expected {expected}, found {excerpt(kind) or 'none'}")


def has_body(headers: Headers) -> bool:
    return "transfer-encoding" in headers or headers.get("content-length", "0") != "0"


async def read_body(
    receive: Receive, headers: Headers, limit: int, seconds: float, clock: Callable[[], float]
) -> bytes:
    """The body of a request.

    Raises:
        Refusal: It is larger than `limit` bytes, or it takes longer than `seconds`.
        ClientGone: The client has gone.
    """
    too_slow = Refusal(408, "Too slow", f"expected the body within {seconds:g} s")
    too_large = Refusal(413, "Too large", f"expected a body of at most {limit} bytes")
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdecimal() and len(length) < 16) or int(length) > limit:
        raise too_large
    end, parts, size, more = clock() + seconds, list[bytes](), 0, True
    try:
        async with asyncio.timeout(seconds):
            while more:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise ClientGone
                parts.append(message.get("body", b""))
                size, more = size + len(parts[-1]), message.get("more_body", False)
                if size > limit:
                    raise too_large
                if clock() > end:
                    raise too_slow
    except TimeoutError:
        raise too_slow from None
    return b"".join(parts)


class ClientGone(Exception):  # noqa: N818 - nothing is wrong
    """The client disconnected before its request was complete."""


def receive_again(body: bytes, receive: Receive) -> Receive:
    """Receiver of a request whose body was read before."""
    given: Iterator[Message] = iter([{"type": "http.request", "body": body, "more_body": False}])

    async def again() -> Message:
        return next(given, None) or await receive()

    return again
