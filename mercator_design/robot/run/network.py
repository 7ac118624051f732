"""Messages to all robots of a swarm over UDP: stop, and heartbeats, whose absence stops the robots, too.

Anybody may say stop. Heartbeats may be signed with a key that robots and the sender share:

    sender  mercator-robot heartbeat?
    robot   mercator-robot sign COUNTER TIME SEAL
    sender  mercator-robot signed COUNTER TIME SEAL SIGNATURE

The counter and the time are the robot's own, so no two clocks need to agree. The seal, with a key that only this run of
the robot knows, shows that they are: nobody can have them signed before their time, or use those of another run. A
signed heartbeat says that who has the key was there after that time; so one that is recorded, delayed or sent again
does not let a robot run for longer.
"""

import contextlib
import hashlib
import hmac
import re
import secrets
import select
import socket
import threading
import time
from collections.abc import Iterable
from typing import NamedTuple, Self

from mercator_design.errors import RobotError

STOP, HEARTBEAT, STOPPED = b"mercator-robot stop", b"mercator-robot heartbeat", b"mercator-robot stopped "
ASK, SIGN, SIGNED = b"mercator-robot heartbeat?", b"mercator-robot sign ", b"mercator-robot signed "
_SEALED = re.compile(rb"\d{1,15} \d{1,12}\.\d{6} [0-9a-f]{32}")
_SIGNATURE = re.compile(rb"(%b) ([0-9a-f]{64})" % _SEALED.pattern)
_LONGEST = 200  # bytes of a message
_MOST = 100  # messages heard at once
_LOOK_UP = 5.0  # [s] for which to wait for the names of hosts
_LOOK = 0.02  # [s] between looks whether they have come


def listener(port: int) -> socket.socket:
    """The socket of a robot for messages to the swarm.

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
    """The messages that have come, with their senders; if there are many, the first of them."""
    told: list[tuple[bytes, tuple[str, int]]] = []
    with contextlib.suppress(BlockingIOError):
        while len(told) < _MOST:
            told.append(listening.recvfrom(_LONGEST))
    return told


class Heartbeats:
    """Checks the heartbeats to a robot.

    heard: When the sender of the latest that counts was there for certain [s, of the clock of `take`]; None: not yet.
    refused: How many did not count.
    why: Of the latest of these.
    """

    def __init__(self, key: str | None, lasts: float) -> None:
        """Begin without one.

        Args:
            key: With which they must be signed; None: they need not be.
            lasts: How long a heartbeat counts [s].
        """
        self._key, self._lasts = key, lasts
        self._seal_key = secrets.token_bytes(32)
        self._counter = 0
        self._used: dict[int, float] = {}  # counters that were signed, and their times
        self.heard: float | None = None
        self.refused, self.why = 0, ""

    def take(self, message: bytes, now: float) -> bytes | None:
        """Take a message that came at a time [s]; the answer, if there is one."""
        if self._key is None:
            if message in {HEARTBEAT, ASK}:
                self.heard = now
        elif message == ASK:
            self._counter += 1
            sealed = b"%d %.6f" % (self._counter, now)
            return SIGN + sealed + b" " + _digest(self._seal_key, sealed)[:32]
        elif message == HEARTBEAT:
            self._refuse("it is not signed")
        elif message.startswith(SIGNED):
            self._take_signed(self._key, message.removeprefix(SIGNED), now)
        return None

    def _take_signed(self, key: str, message: bytes, now: float) -> None:
        found = _SIGNATURE.fullmatch(message)
        if found is None or not hmac.compare_digest(signature(key, found[1]), found[2]):
            self._refuse("its signature is wrong")
            return
        sealed, _, seal = found[1].rpartition(b" ")
        counter, then = (convert(part) for convert, part in zip((int, float), sealed.split(), strict=True))
        self._used = {used: time for used, time in self._used.items() if now - time <= self._lasts}
        if not hmac.compare_digest(_digest(self._seal_key, sealed)[:32], seal):
            self._refuse("it is of another run")
        elif now - then > self._lasts:
            self._refuse("it is too old")
        elif counter in self._used:
            self._refuse("it came before")
        else:
            self._used[int(counter)] = then
            self.heard = max(self.heard or then, then)

    def _refuse(self, why: str) -> None:
        self.refused += 1
        self.why = why


def signature(key: str, sealed: bytes) -> bytes:
    """The proof that the holder of a key has seen the text that a robot has sealed."""
    return _digest(key.encode(), SIGNED + sealed)


def _digest(key: bytes, message: bytes) -> bytes:
    return hmac.new(key, message, hashlib.sha256).hexdigest().encode()


class Answers(NamedTuple):
    """The answers of robots to a stop.

    stopped: Those that say that they have, by name and address.
    silent: Of the hosts from which nothing came, what is known.
    """

    stopped: list[str]
    silent: list[str]


class Speaker:
    """Sends messages to robots; a context manager.

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

    def send(self, message: bytes) -> None:
        """Send a message to each robot whose address is known; only an answer shows that it arrived."""
        for host, address in self._addresses.copy().items():
            if address:
                with contextlib.suppress(OSError):  # no way to this one now; the others are told nevertheless
                    self._sockets[host].sendto(message, (address, self._port))

    def beat(self, key: str | None, seconds: float) -> None:
        """Let robots run for a while, and sign what they want signed in the next seconds."""
        self.send(HEARTBEAT if key is None else ASK)
        waiting = select.poll()
        for each in self._sockets.values():
            waiting.register(each, select.POLLIN)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            waiting.poll(1000.0 * left)
            for each in self._sockets.values():
                with contextlib.suppress(OSError):  # nobody listens there, or no way there now
                    for message, robot in hear(each):
                        sealed = message.removeprefix(SIGN)
                        if key is not None and sealed != message and _SEALED.fullmatch(sealed):
                            each.sendto(SIGNED + sealed + b" " + signature(key, sealed), robot)

    def look_up(self) -> list[str]:
        """Wait until all have been looked up, but not for long; of those without an address, what is known."""
        end = time.monotonic() + _LOOK_UP
        while len(self._addresses) < len(self._sockets) and time.monotonic() < end:
            time.sleep(_LOOK)
        return [self._silence(host) for host in self._sockets if not self._addresses.get(host)]

    def stop(self, seconds: float = 0.5) -> Answers:
        """Send stop to the robots repeatedly, for a while after the last address is known."""
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
            self.send(STOP)
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
        match self._addresses.get(host):
            case None:
                return f"{host}: its name could not be looked up in time"
            case "":
                return f"{host}: no such host"
        return f"{host}: no answer on UDP port {self._port}, as if nothing ran there"


def _speaking() -> socket.socket:
    speaking = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    speaking.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    speaking.setblocking(False)
    return speaking
