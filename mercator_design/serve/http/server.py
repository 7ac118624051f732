"""The server of the application: addresses, TLS, and how long it waits for clients."""

import asyncio
import contextlib
import resource
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from mercator_design.serve.settings import ServiceError

HEADER_SECONDS = 20.0
"""Seconds in which the headers of a request have to come, from the connection or the answer before on."""
READ_SECONDS = 30.0
"""Seconds in which a client has to read something, when more of its answer waits than is kept for it."""
_MAX_CONNECTIONS = 1000
_LAST_SECONDS = 10
"""Seconds for open answers when the service ends."""


def listening(host: str, port: int) -> socket.socket:
    """A socket that listens on an address.

    Raises:
        ServiceError: It cannot.
    """
    try:
        family, *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server((host, port), family=family, backlog=2048)
    except OSError as error:
        raise ServiceError(f"--host {host} --port {port}: cannot listen there: {error.strerror}") from None


def run(
    app: ASGIApp,
    listener: socket.socket,
    *,
    certificate: Path | None = None,
    key: Path | None = None,
    at_end: Callable[[], None],
) -> None:
    """Serve an application until a signal ends this process; then call `at_end`, which ends event streams."""
    _, limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(ValueError, OSError):  # not more than the system allows
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
    config = uvicorn.Config(
        app,
        http=PatientProtocol,
        ws="none",
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,  # guarded() believes only a known proxy
        ssl_certfile=certificate,
        ssl_keyfile=key,
        limit_concurrency=_MAX_CONNECTIONS,
        timeout_graceful_shutdown=_LAST_SECONDS,
    )
    _Server(config, at_end).run([listener])


class _Server(uvicorn.Server):
    """A server that does not wait for answers without an end."""

    def __init__(self, config: uvicorn.Config, at_end: Callable[[], None]) -> None:
        super().__init__(config)
        self._at_end = at_end

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._at_end()
        await super().shutdown(sockets)


class PatientProtocol(H11Protocol):
    """HTTP that waits neither for the headers of a request for ever, nor for a client to read its answer.

    Of too many connections, the one that has waited longest is closed, so idle clients keep nobody out.
    """

    _waiting: asyncio.TimerHandle | None = None
    _unread: asyncio.TimerHandle | None = None
    since = 0.0  # the time since which it waits

    def connection_made(self, transport: Any) -> None:  # noqa: ANN401 - as its base
        """Wait for the first request."""
        super().connection_made(transport)
        self._wait()
        if self.limit_concurrency is not None and len(self.connections) >= self.limit_concurrency:
            self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        if self._waiting is not None:
            self._waiting.cancel()
        self.resume_writing()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._wait()

    def pause_writing(self) -> None:
        """Wait for the client to read."""
        super().pause_writing()
        self.since = self.loop.time()
        self._unread = self.loop.call_later(READ_SECONDS, self.give_up)

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None

    def _wait(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
        self.since = self.loop.time()
        self._waiting = self.loop.call_later(HEADER_SECONDS, self.give_up)

    def _make_room(self) -> None:
        """Close the connection that has waited longest for its client, this one excepted."""
        others = [one for one in self.connections if isinstance(one, PatientProtocol) and one.is_waiting]
        longest = min(others, key=lambda one: one.since)
        if longest is not self:
            longest.give_up()

    @property
    def is_waiting(self) -> bool:
        """Whether it waits for a request, or for the client to read."""
        if self._unread is not None:
            return True
        return (self.cycle is None or self.cycle.response_complete) and not self.transport.is_closing()

    def give_up(self) -> None:
        """Close the connection if it waits for its client; what the client does not read is dropped."""
        if self._unread is not None:
            self.transport.abort()
        elif self.is_waiting:
            self.transport.close()
