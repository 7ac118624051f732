"""Messages to all robots of a swarm over UDP: stops, and heartbeats, whose absence also stops the robots.

Anybody may send a stop. Heartbeats may be signed with a key that robots and the sender share:

    sender  mercator-robot heartbeat?
    robot   mercator-robot sign COUNTER TIME SEAL
    sender  mercator-robot signed COUNTER TIME SEAL SIGNATURE

The counter and the time are the robot's own, so clocks need not agree. The seal, with a key that only this run of the
robot has, proves that: nobody can get them signed in advance, or use those of another run. A signed heartbeat proves
that the holder of the key was there after that time; one that is recorded, delayed or sent again does not let a robot
run for longer.
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
from collections.abc import Iterable, Iterator
from typing import Self

from mercator_design.errors import RobotError

STOP, HEARTBEAT, STOPPED = b"mercator-robot stop", b"mercator-robot heartbeat", b"mercator-robot stopped "
ASK, SIGN, SIGNED = b"mercator-robot heartbeat?", b"mercator-robot sign ", b"mercator-robot signed "
_SEALED = re.compile(rb"\d{1,15} \d{1,12}\.\d{6} [0-9a-f]{32}")
_SIGNATURE = re.compile(rb"(%b) ([0-9a-f]{64})" % _SEALED.pattern)
_MAX_MESSAGE = 200  # bytes
_MAX_MESSAGES = 100  # that are received at once
LOOK_UP_WAIT = 5.0  # [s] for looking up the names of hosts
_CHECK_EVERY = 0.02  # [s] between checks whether they are looked up


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


def receive(listening: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    """Receive the messages that have come, at most `_MAX_MESSAGES`, with their senders."""
    received: list[tuple[bytes, tuple[str, int]]] = []
    with contextlib.suppress(BlockingIOError):
        while len(received) < _MAX_MESSAGES:
            received.append(listening.recvfrom(_MAX_MESSAGE))
    return received


class Heartbeats:
    """Checks the heartbeats to a robot.

    heard: Time at which the sender was certainly there [s, of the clock of `take`]; None before a valid heartbeat.
    refused: Number of heartbeats that were not valid.
    why: Why the latest of these was refused.
    """

    def __init__(self, key: str | None, lasts: float) -> None:
        """Make one, before the first heartbeat.

        Args:
            key: The key of signed heartbeats; None: they need no signature.
            lasts: Time for which a heartbeat is valid [s].
        """
        self._key, self._lasts = key, lasts
        self._seal_key = secrets.token_bytes(32)
        self._counter = 0
        self._used: dict[int, float] = {}  # counters that were signed, and their times
        self.heard: float | None = None
        self.refused, self.why = 0, ""

    def take(self, message: bytes, now: float) -> bytes | None:
        """Take a message that came at a time [s]; return the answer, if there is one."""
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
        number, sent = sealed.split()
        counter, then = int(number), float(sent)
        self._used = {used: time for used, time in self._used.items() if now - time <= self._lasts}
        if not hmac.compare_digest(_digest(self._seal_key, sealed)[:32], seal):
            self._refuse("it is of another run")
        elif now - then > self._lasts:
            self._refuse("it is too old")
        elif counter in self._used:
            self._refuse("it came before")
        else:
            self._used[counter] = then
            self.heard = max(self.heard or then, then)

    def _refuse(self, why: str) -> None:
        self.refused += 1
        self.why = why


def signature(key: str, sealed: bytes) -> bytes:
    """The signature of a text that a robot has sealed."""
    return _digest(key.encode(), SIGNED + sealed)


def _digest(key: bytes, message: bytes) -> bytes:
    return hmac.new(key, message, hashlib.sha256).hexdigest().encode()


class Speaker:
    """Sends messages to robots; a context manager.

    Each host's name is looked up in a thread of its own, so that a slow or unknown one does not delay the others. Each
    host has a socket of its own, which receives its answers from any address.
    """

    def __init__(self, hosts: Iterable[str], port: int) -> None:
        """Begin to look up the hosts of the robots; a broadcast address reaches all robots of a network."""
        self._port = port
        self._sockets = {host: sending_socket() for host in hosts}
        self._waiting = select.poll()  # select takes no more than 1024 descriptors
        for each in self._sockets.values():
            self._waiting.register(each, select.POLLIN)
        self._addresses: dict[str, str] = {}  # of the hosts that are looked up; empty if there is none
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
                with contextlib.suppress(OSError):  # no route to this one now
                    self._sockets[host].sendto(message, (address, self._port))

    def beat(self, key: str | None, seconds: float) -> None:
        """Send a heartbeat, and sign those that robots want signed for so many seconds."""
        self.send(HEARTBEAT if key is None else ASK)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            for host, message, robot in self._received(left):
                sealed = message.removeprefix(SIGN)
                if key is not None and sealed != message and _SEALED.fullmatch(sealed):
                    with contextlib.suppress(OSError):
                        self._sockets[host].sendto(SIGNED + sealed + b" " + signature(key, sealed), robot)

    def _received(self, seconds: float) -> Iterator[tuple[str, bytes, tuple[str, int]]]:
        """Wait for messages, for `seconds` at most; yield each with its host and its sender's address."""
        self._waiting.poll(1000.0 * seconds)
        for host, each in self._sockets.items():
            with contextlib.suppress(OSError):  # nobody listens there, or no route there now
                for message, sender in receive(each):
                    yield host, message, sender

    def look_up(self) -> list[str]:
        """Wait until all hosts are looked up, at most `LOOK_UP_WAIT`; return messages on those without an address."""
        end = time.monotonic() + LOOK_UP_WAIT
        while len(self._addresses) < len(self._sockets) and time.monotonic() < end:
            time.sleep(_CHECK_EVERY)
        return [self._silence(host) for host in self._sockets if not self._addresses.get(host)]

    def stop(self, seconds: float = 0.5) -> tuple[list[str], list[str]]:
        """Send stops to the robots, for some seconds after the last address is known.

        Returns:
            The robots that have stopped, by name and address, and messages on the hosts without an answer.
        """
        stopped: dict[str, None] = {}
        answered = set()
        end = time.monotonic() + seconds
        latest = end + LOOK_UP_WAIT
        while (now := time.monotonic()) < end:
            if len(self._addresses) < len(self._sockets):
                end = min(now + seconds, latest)
            self.send(STOP)
            for host, answer, (address, _) in self._received(0.05):
                if answer.startswith(STOPPED):
                    answered.add(host)
                    stopped[f"{answer.removeprefix(STOPPED).decode('ascii', 'replace')} ({address})"] = None
        return [*stopped], [self._silence(host) for host in self._sockets if host not in answered]

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
        return f"{host}: no answer on UDP port {self._port}"


def sending_socket() -> socket.socket:
    """A socket that sends datagrams, also to all hosts of a network, and waits for nothing."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    found.setblocking(False)
    return found
