"""Connections: how long each waits for its client, and which are closed when too many wait.

A connection waits while its client owes something: the handshake of TLS, a request, the rest of its body, or to read an
answer. All others work for a user; the guard limits these.
"""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from mercator_design.serve.accounts.entrance import network_of

REQUEST_SECONDS = 20.0
"""Seconds in which a handshake, and the headers of a request, have to come."""
READ_SECONDS = 30.0
"""Seconds in which a client has to read something, when more of its answer waits than is kept for it."""
MAX_WAITING = 1000
"""Connections that wait at a time."""
MAX_OF_ADDRESS = 400
"""Of them, those of an address: thirty browsers that hold six each use less than half."""

_Owed: TypeAlias = Literal["handshake", "request", "body", "reading", "nothing"]


class Waiting:
    """The connections that wait for their clients, by address, in the order in which they began to.

    Of too many, one is closed: the one that has waited longest, of those of an address that has too many; else of the
    address that has the most. So clients that are slow take the places of each other, and keep nobody out.

    Args:
        limit: Their number.
        of_address: The number of those of an address.
        is_proxy: Whether an address is that of a proxy, which may have all of them.
    """

    def __init__(
        self,
        limit: int = MAX_WAITING,
        of_address: int = MAX_OF_ADDRESS,
        is_proxy: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._limit, self._of_address, self._is_proxy = limit, of_address, is_proxy
        self._groups: dict[str, dict[PatientProtocol, None]] = {}
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def group_of(self, address: str) -> str:
        """The group of an address; that of proxies has no name."""
        return "" if self._is_proxy(address) else network_of(address)

    def add(self, one: "PatientProtocol") -> None:
        """Add a connection that begins to wait; close another one if there are too many."""
        group = self._groups.setdefault(one.group, {})
        group[one] = None
        self._n += 1
        if len(group) > self._of_address and one.group:
            next(iter(group)).give_up()
        elif self._n > self._limit:
            fullest = max(self._groups, key=lambda name: len(self._groups[name]))
            next(iter(self._groups[fullest])).give_up()

    def discard(self, one: "PatientProtocol") -> None:
        """Forget a connection that waits no longer, if it did."""
        group = self._groups.get(one.group, {})
        if one in group:
            del group[one]
            self._n -= 1
        if not group:
            self._groups.pop(one.group, None)


class PatientProtocol(H11Protocol):
    """HTTP over a connection that counts from the first moment on, with TLS or without.

    Args:
        waiting: All connections that wait.
        tls: For TLS.
        config, server_state, app_state, _loop: As its base has them.
    """

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
        *,
        waiting: Waiting,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self.group = ""  # among the connections that wait
        self._waiting, self._tls = waiting, tls
        self._plain: asyncio.Transport | None = None  # the connection itself, below TLS; None once it is lost
        self._early = b""  # data that came with the end of the handshake
        self._owed: _Owed = "nothing"
        self._timer: asyncio.TimerHandle | None = None
        self._securing: asyncio.Task[None] | None = None

    def connection_made(self, transport: Any) -> None:  # noqa: ANN401 - as its base
        """Wait for the handshake, or for the first request."""
        self._plain = transport
        peer = transport.get_extra_info("peername")
        self.group = self._waiting.group_of(str(peer[0])) if peer else ""
        if self._tls is not None:
            self._securing = self.loop.create_task(self._secure(transport, self._tls))
        else:
            super().connection_made(transport)
        self._look()

    async def _secure(self, transport: asyncio.Transport, tls: ssl.SSLContext) -> None:
        try:
            secured = await self.loop.start_tls(transport, self, tls, server_side=True)
        except OSError:  # as errors of TLS are
            secured = None
        if secured is None or self._plain is None:  # lost in the meantime
            self._lose()
            return
        super().connection_made(secured)
        self._look()
        if self._early:
            self.data_received(self._early)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._lose()
        if self.transport is not None:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Look whether the request is complete."""
        if self.transport is None:
            self._early += data
            return
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """Wait for the next request; close the connection if it came before the answer, as in a flood."""
        if self.conn.trailing_data[0]:
            self.transport.close()
        super().on_response_complete()
        self._look()

    def pause_writing(self) -> None:
        """Wait for the client to read."""
        super().pause_writing()
        self._look()

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        self._look()

    def give_up(self) -> None:
        """Close the connection; what its client has not read is dropped."""
        plain = self._plain
        self._lose()
        if plain is not None:
            plain.abort()

    def _lose(self) -> None:
        self._plain = None
        self._look()

    def _look(self) -> None:
        """Begin to wait if the client owes something else than before, or stop if it owes nothing."""
        owed = self._now_owed()
        if owed == self._owed:
            return
        self._owed = owed
        self._waiting.discard(self)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if owed == "nothing":
            return
        if owed != "body":  # the guard answers bodies that are late
            self._timer = self.loop.call_later(READ_SECONDS if owed == "reading" else REQUEST_SECONDS, self.give_up)
        self._waiting.add(self)

    def _now_owed(self) -> _Owed:
        if self._plain is None:
            return "nothing"
        if self.transport is None:
            return "handshake"
        if self.flow.write_paused:
            return "reading"
        if self.cycle is None or self.cycle.response_complete:
            return "request"
        return "body" if self.cycle.more_body else "nothing"
