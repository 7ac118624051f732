"""What is told to all robots of a swarm over UDP: stop; and heartbeats, the silence of which stops them too."""

import contextlib
import select
import socket
import threading
import time
from collections.abc import Iterable
from typing import NamedTuple, Self

from mercator_design.errors import RobotError

STOP, HEARTBEAT, STOPPED = b"mercator-robot stop", b"mercator-robot heartbeat", b"mercator-robot stopped "
_LONGEST = 200  # bytes of a message
_MOST = 100  # messages heard at once
_LOOK_UP = 5.0  # [s] for which a stop waits for the name of a host


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


class Answers(NamedTuple):
    """What robots said that were told to stop.

    stopped: Those that say that they have, by name and address.
    silent: Of the hosts from which nothing came, what is known.
    """

    stopped: list[str]
    silent: list[str]


class Speaker:
    """Tells robots something; a context manager.

    Each host's name is looked up in a thread of its own: one that takes long, or is not known, keeps no other waiting.
    Each has a socket of its own: what comes there is its answer, whatever address that has.
    """

    def __init__(self, hosts: Iterable[str], port: int) -> None:
        """Begin to look up the robots; a broadcast address is all of a network."""
        self._port = port
        self._sockets = {host: _speaking() for host in hosts}
        self._addresses: dict[str, str] = {}  # of the hosts that have been looked up; empty if there is none
        for host in self._sockets:
            threading.Thread(target=self._look_up, args=(host,), daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets.values():
            each.close()

    @property
    def unknown(self) -> list[str]:
        """The hosts whose name is not known, as far as they have been looked up."""
        return [host for host, address in self._addresses.copy().items() if not address]

    def tell(self, message: bytes) -> None:
        """Send a message to each that has been looked up; which one gets it, only an answer shows."""
        for host, address in self._addresses.copy().items():
            if address:
                with contextlib.suppress(OSError):  # no way to this one now; the others are told nevertheless
                    self._sockets[host].sendto(message, (address, self._port))

    def stop(self, seconds: float = 0.5) -> Answers:
        """Tell the robots to stop, again and again, for a while after the last has been looked up."""
        stopped: dict[str, None] = {}
        answered = set()
        waiting = select.poll()  # select knows no more than 1024 descriptors
        for each in self._sockets.values():
            waiting.register(each, select.POLLIN)
        end = time.monotonic() + seconds
        latest = end + _LOOK_UP
        while (now := time.monotonic()) < end:
            if len(self._addresses) < len(self._sockets):
                end = min(now + seconds, latest)
            self.tell(STOP)
            waiting.poll(50)
            for host, each in self._sockets.items():
                with contextlib.suppress(ConnectionError):  # nobody listens there
                    for answer, (address, _) in hear(each):
                        if answer.startswith(STOPPED):
                            answered.add(host)
                            stopped[f"{answer.removeprefix(STOPPED).decode('ascii', 'replace')} ({address})"] = None
        return Answers([*stopped], [self._silence(host) for host in self._sockets if host not in answered])

    def _look_up(self, host: str) -> None:
        try:
            address = socket.gethostbyname(host)
        except (OSError, UnicodeError):
            address = ""
        self._addresses[host] = address

    def _silence(self, host: str) -> str:
        if host in self.unknown:
            return f"{host}: no such host"
        return f"{host}: {'no answer' if host in self._addresses else 'its name could not be looked up in time'}"


def _speaking() -> socket.socket:
    speaking = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    speaking.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    speaking.setblocking(False)
    return speaking
