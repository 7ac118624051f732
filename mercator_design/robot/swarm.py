"""What is told to all robots of a swarm over UDP: stop; and heartbeats, the silence of which stops them too."""

import contextlib
import select
import socket
import time
from collections.abc import Iterable
from typing import Self

from mercator_design.errors import RobotError

STOP, HEARTBEAT, STOPPED = b"mercator-robot stop", b"mercator-robot heartbeat", b"mercator-robot stopped "
_LONGEST = 200  # bytes of a message
_MOST = 100  # messages heard at once


def listener(port: int) -> socket.socket:
    """The socket of a robot that hears what is told to the swarm.

    Raises:
        RobotError: if the port is not free.
    """
    heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        heard.bind(("", port))
    except OSError as error:
        heard.close()
        raise RobotError(f"swarm: UDP port {port}: {error.strerror}; does another mercator-robot run here?") from None
    heard.setblocking(False)
    return heard


def hear(listening: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    """What has been told, and by whom; not all at once, if it is much."""
    told: list[tuple[bytes, tuple[str, int]]] = []
    with contextlib.suppress(BlockingIOError):
        while len(told) < _MOST:
            told.append(listening.recvfrom(_LONGEST))
    return told


class Speaker:
    """Tells robots something; a context manager."""

    def __init__(self, hosts: Iterable[str], port: int) -> None:
        """Find the robots; a broadcast address is all of a network.

        Raises:
            RobotError: if a host's name is not known.
        """
        self._robots = []
        for host in hosts:
            try:
                self._robots.append((socket.gethostbyname(host), port))
            except (OSError, UnicodeError):
                raise RobotError(f"{host}: no such host") from None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def tell(self, message: bytes) -> None:
        """Send a message to each; which one gets it, only an answer shows."""
        for robot in self._robots:
            with contextlib.suppress(OSError):  # no way to this one now; the others are told nevertheless
                self._socket.sendto(message, robot)

    def stop(self, seconds: float = 0.5) -> list[str]:
        """Tell the robots to stop, again and again for a while; the names of those that say that they have."""
        names: dict[str, None] = {}
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.tell(STOP)
            select.select([self._socket], [], [], 0.05)
            with contextlib.suppress(ConnectionError):  # nobody listens there
                for answer, (host, _) in hear(self._socket):
                    if answer.startswith(STOPPED):
                        names[f"{answer.removeprefix(STOPPED).decode('ascii', 'replace')} ({host})"] = None
        return list(names)
