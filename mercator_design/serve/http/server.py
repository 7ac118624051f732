"""The server of the application: its address, TLS, and its end."""

import contextlib
import logging
import resource
import socket
import ssl
from collections.abc import Callable
from functools import partial

import uvicorn
from anyio import to_thread
from starlette.types import ASGIApp

from mercator_design.serve.accounts.accounts import MAX_REQUESTS, MAX_STREAMS
from mercator_design.serve.http.connections import MAX_WAITING, TimedProtocol, WaitingConnections
from mercator_design.serve.settings import ServiceError
from mercator_design.serve.workers.pool import MAX_WORK

_LAST_SECONDS = 10
"""Time limit of open answers when the service ends [s]."""
_OTHER_FILES = 200
"""Number of open files other than connections."""
_THREADS = 40 + MAX_WORK
"""Number of threads that answer requests: those that wait for a worker process, and 40 for all others."""
_FILES = MAX_WAITING + MAX_REQUESTS + MAX_STREAMS + _OTHER_FILES

_log = logging.getLogger(__name__)


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
    tls: ssl.SSLContext | None = None,
    is_proxy: Callable[[str], bool] = lambda _: False,
    at_end: Callable[[], None],
) -> None:
    """Serve an application until a signal ends this process; then call `at_end`, which ends event streams.

    Args:
        app: The application.
        listener: The socket that listens.
        tls: For TLS.
        is_proxy: Whether an address is that of a proxy.
        at_end: Called first at the end.
    """
    _, limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(ValueError, OSError):  # not more than the system allows
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
    if limit != resource.RLIM_INFINITY and limit < _FILES:
        _log.warning("this process may open %d files: expected at least %d; see ulimit -n, LimitNOFILE", limit, _FILES)
    Server(app, WaitingConnections(is_proxy=is_proxy), tls, at_end).run([listener])


class Server(uvicorn.Server):
    """Server with time limits for slow clients, and for open answers at its end."""

    def __init__(
        self,
        app: ASGIApp,
        waiting: WaitingConnections,
        tls: ssl.SSLContext | None = None,
        at_end: Callable[[], None] = lambda: None,
    ) -> None:
        config = uvicorn.Config(
            app,
            http=partial(TimedProtocol, waiting=waiting, tls=tls),  # type: ignore[arg-type]  # makes protocols
            ws="none",
            log_level="error",  # anybody could fill the log with warnings of odd requests
            access_log=False,
            server_header=False,
            proxy_headers=False,  # guarded() believes only a known proxy
            timeout_graceful_shutdown=_LAST_SECONDS,
        )
        super().__init__(config)
        self._at_end = at_end

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        to_thread.current_default_thread_limiter().total_tokens = _THREADS
        await super().startup(sockets)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._at_end()
        await super().shutdown(sockets)
