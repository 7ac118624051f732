"""Limits of connections that wait for their clients, in time and number.

A connection waits for the handshake of TLS, a request, the rest of its body, or for a client that reads its answer. All
other connections work for a user; the guard limits these.
"""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from uvicorn.protocols.http.h11_impl import H11Protocol

from mercator_design.serve.accounts.endpoint import network_of

REQUEST_SECONDS = 20.0
"""Time limit of a handshake, and of the headers of a request [s]."""
READ_SECONDS = 30.0
"""Time limit of a client that does not read its answer [s]."""
MAX_WAITING = 1000
"""Maximum number of waiting connections."""
MAX_OF_ADDRESS = 400
"""Maximum number of waiting connections of an address; thirty browsers with six each use less than half."""

_Awaited: TypeAlias = Literal["handshake", "request", "body", "reading", "nothing"]


class WaitingConnections:
    """Connections that wait for their clients, by address, the oldest first.

    If an address has too many, its oldest is closed. If all together are too many, the oldest of the address with the
    most is closed, so slow clients do not lock others out.

    Args:
        limit: Maximum number of all.
        of_address: Maximum number of an address.
        is_proxy: Whether an address is that of a proxy, which only `limit` bounds.
    """

    def __init__(
        self,
        limit: int = MAX_WAITING,
        of_address: int = MAX_OF_ADDRESS,
        is_proxy: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._limit, self._of_address, self._is_proxy = limit, of_address, is_proxy
        self._groups: dict[str, dict[TimedProtocol, None]] = {}
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def group_of(self, address: str) -> str:
        """Name of the group of an address; empty for proxies."""
        return "" if self._is_proxy(address) else network_of(address)

    def add(self, one: "TimedProtocol") -> None:
        """Add a waiting connection; close one if there are too many."""
        group = self._groups.setdefault(one.group, {})
        group[one] = None
        self._n += 1
        if len(group) > self._of_address and one.group:
            next(iter(group)).abort_connection()
        elif self._n > self._limit:
            fullest = max(self._groups, key=lambda name: len(self._groups[name]))
            next(iter(self._groups[fullest])).abort_connection()

    def discard(self, one: "TimedProtocol") -> None:
        """Remove a connection, if it is there."""
        group = self._groups.get(one.group, {})
        if one in group:
            del group[one]
            self._n -= 1
        if not group:
            self._groups.pop(one.group, None)


class TimedProtocol(H11Protocol):
    """HTTP with or without TLS, with time limits from the start of the connection.

    Args:
        waiting: All connections that wait.
        tls: Context of TLS; None without TLS.
        of_base: Arguments of the base class.
    """

    def __init__(
        self,
        *,
        waiting: WaitingConnections,
        tls: ssl.SSLContext | None = None,
        **of_base: Any,  # noqa: ANN401 - of uvicorn
    ) -> None:
        super().__init__(**of_base)
        self.group = ""  # among the connections that wait
        self._waiting, self._tls = waiting, tls
        self._raw_transport: asyncio.Transport | None = None  # the connection itself, below TLS; None once it is lost
        self._early_data = b""  # data that came with the end of the handshake
        self._awaited: _Awaited = "nothing"
        self._timer: asyncio.TimerHandle | None = None
        self._handshake: asyncio.Task[None] | None = None

    def connection_made(self, transport: Any) -> None:  # noqa: ANN401 - as its base
        """Wait for the handshake, or for the first request."""
        self._raw_transport = transport
        peer = transport.get_extra_info("peername")
        self.group = self._waiting.group_of(str(peer[0])) if peer else ""
        if self._tls is not None:
            self._handshake = self.loop.create_task(self._start_tls(transport, self._tls))
        else:
            super().connection_made(transport)
        self._update_waiting()

    async def _start_tls(self, transport: asyncio.Transport, tls: ssl.SSLContext) -> None:
        try:
            secured = await self.loop.start_tls(transport, self, tls, server_side=True)
        except OSError:  # as errors of TLS are
            secured = None
        if secured is None or self._raw_transport is None:  # lost in the meantime
            self._mark_lost()
            return
        super().connection_made(secured)
        self._update_waiting()
        if self._early_data:
            self.data_received(self._early_data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        self._mark_lost()
        if self.transport is not None:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Pass on data; check whether the request is complete."""
        if self.transport is None:
            self._early_data += data
            return
        super().data_received(data)
        self._update_waiting()

    def on_response_complete(self) -> None:
        """Wait for the next request; close the connection if that came before the answer, as in a flood."""
        if self.conn.trailing_data[0]:
            self.transport.close()
        super().on_response_complete()
        self._update_waiting()

    def pause_writing(self) -> None:
        """Wait for the client to read."""
        super().pause_writing()
        self._update_waiting()

    def resume_writing(self) -> None:
        """Stop waiting for the client to read."""
        super().resume_writing()
        self._update_waiting()

    def abort_connection(self) -> None:
        """Close the connection without sending the rest of the answer."""
        raw = self._raw_transport
        self._mark_lost()
        if raw is not None:
            raw.abort()

    def _mark_lost(self) -> None:
        self._raw_transport = None
        self._update_waiting()

    def _update_waiting(self) -> None:
        """Start or stop waiting, if something else is awaited than before."""
        awaited = self._now_awaited()
        if awaited == self._awaited:
            return
        self._awaited = awaited
        self._waiting.discard(self)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if awaited == "nothing":
            return
        if awaited != "body":  # the guard answers bodies that are late
            self._timer = self.loop.call_later(
                READ_SECONDS if awaited == "reading" else REQUEST_SECONDS, self.abort_connection
            )
        self._waiting.add(self)

    def _now_awaited(self) -> _Awaited:
        if self._raw_transport is None:
            return "nothing"
        if self.transport is None:
            return "handshake"
        if self.flow.write_paused:
            return "reading"
        if self.cycle is None or self.cycle.response_complete:
            return "request"
        return "body" if self.cycle.more_body else "nothing"
