"""The twin's ports: pseudo-terminals by stable names, and the loop that moves bytes and keeps time."""

import contextlib
import errno
import fcntl
import math
import os
import select
import socket
import termios
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from mercator_design.config.writing import dump
from mercator_design.errors import RobotError
from mercator_design.robot.devices.ports import DEVICES, DeviceName, PortNames
from mercator_design.robot.devices.settings import Limits, Settings, SwarmSettings
from mercator_design.robot.logs.events import now as time_of_day
from mercator_design.system.files import writing
from mercator_design.twin.arena import dark_limit
from mercator_design.twin.folder import BEGINS, FRESH, ROBOT, check_free
from mercator_design.twin.twin import Twin

_CHUNK = 4096
RATES: dict[DeviceName, float] = {"rvr": 11_520.0}
"""[bytes/s] Rates of lines that are slower than their devices, at 115200 baud."""
_LATE = 0.1
"""[s] A program may notice that its devices are later than this."""
_PIECE = 0.001  # [s] between deliveries of bytes on a busy line


@dataclass(frozen=True, slots=True)
class Timing:
    """Duration and punctuality of a run of the twin."""

    duration: float  # [s]
    cpu: float  # seconds of a processor for each second
    latest: float  # [s] of the greatest delay of a step
    dropped: int  # bytes that no client read in time


class Wire:
    """Bytes on their way along a line of a rate [bytes/s], since a time [s]."""

    def __init__(self, rate: float, since: float) -> None:
        self.data = bytearray()
        self._rate, self._since = rate, since

    def carried(self, now: float) -> bytes:
        """The bytes that have arrived by now."""
        count = int(self._rate * (now - self._since))
        self._since += count / self._rate
        data = bytes(self.data[:count])
        del self.data[:count]
        return data


class Terminals:
    """The ports of all robots: `folder`/N has links to those of robot N, and robot.yaml, which names them."""

    def __init__(self, twin: Twin, folder: Path) -> None:
        """No ports yet: entering the context makes them, and leaving removes them.

        Raises:
            RobotError: on entering, if a file that is not a twin's is in the place of one of them.
        """
        self._twin, self._folder = twin, folder.resolve()
        self._head = BEGINS[ROBOT] + f"# It is process {os.getpid()}.\n".encode()
        self._links: dict[Path, str] = {}  # link -> its target, of the links made here
        self._fds: dict[tuple[int, DeviceName], int] = {}
        self._ports: dict[int, tuple[int, DeviceName]] = {}
        self._open, self._closed = select.poll(), select.poll()  # of ports that a client has open, and of the others
        self._is_open: set[int] = set()
        self._under_way: dict[int, Wire] = {}
        self._latest, self._dropped = 0.0, 0
        self._reported_delay = _LATE  # longer delays are reported
        self._report: Callable[[str], None] = lambda _: None

    @property
    def robots(self) -> list[Path]:
        """The file of port names of each robot."""
        return [self._folder / str(number) / ROBOT for number in range(len(self._twin.robots))]

    def check(self) -> None:
        """Check that no file that is not a twin's is in the place of a port or file.

        Raises:
            RobotError: if one is.
        """
        for file in self.robots:
            if os.path.lexists(file.parent) and not file.parent.is_dir():
                raise RobotError(f"{file.parent} exists and is not a folder; move it, or choose another folder")
            with writing(file.parent, RobotError):
                for left in map(file.with_name, (*DEVICES, *(device + FRESH for device in DEVICES), ROBOT)):
                    check_free(left)

    def __enter__(self) -> Self:
        self.check()
        try:
            for number, (file, port) in enumerate(zip(self.robots, _free_ports(len(self.robots)), strict=True)):
                with writing(file.parent, RobotError):
                    self._make(number, file, port)
        except BaseException:
            self.__exit__()
            raise
        return self

    def _make(self, number: int, file: Path, port: int) -> None:
        """The ports of a robot, and the file that names them."""
        file.parent.mkdir(exist_ok=True)
        for device in DEVICES:
            link = self._link(number, device)
            for left in (link, link.with_name(device + FRESH)):
                left.unlink(missing_ok=True)
            self._plug_in(number, device)
        file.write_bytes(self._head + dump(self._settings(number, port)).encode())

    def __exit__(self, *_: object) -> None:
        for number, device in list(self._fds):
            self._unplug(number, device)
        for file in self.robots:
            with contextlib.suppress(OSError):  # there may be other files
                if self._is_mine(file):
                    file.unlink()
                file.parent.rmdir()

    def run(
        self,
        is_over: Callable[[float], bool],
        report: Callable[[str], None] = lambda _: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> Timing:
        """Keep the twin in step with the clock until it is over.

        Args:
            is_over: Whether it is over, at a time [s].
            report: Called when the twin is late, and again when it is more than twice as late.
            clock: Returns the time [s].
        """
        self._report = report
        start, at, began = clock(), time_of_day(), time.process_time()
        self._twin.note("clock", start=start, at=at)
        due = self._twin.next_tick
        while not is_over(now := clock() - start):
            if now >= due:
                self._keep_up(now)
                self._look(now)
                due = self._twin.next_tick
            self._carry(now)
            wait = max(0.0, due - (clock() - start))
            for fd, _ in self._open.poll(math.ceil(1000.0 * (min(wait, _PIECE) if self._under_way else wait))):
                now = clock() - start
                self._keep_up(now)
                self._receive(fd, now)
        return Timing(now, (time.process_time() - began) / max(now, 1e-9), self._latest, self._dropped)

    def _keep_up(self, now: float) -> None:
        self._latest = max(self._latest, now - self._twin.next_tick)
        if self._latest > self._reported_delay:
            self._reported_delay = 2.0 * self._latest
            self._report(
                f"Warning: the twin was {1000 * self._latest:.0f} ms late, as this computer is too busy; programs may "
                "find its devices silent"
            )
        for number, device, said in self._twin.advance(now):
            self._send(self._fds.get((number, device)), said, now)

    def _settings(self, number: int, port: int) -> Settings:
        """The settings of a robot for programs, with a free UDP port."""
        model = self._twin.arena.robot_model
        limits = Limits(speed=model.drive.maximum_speed, dark=dark_limit(model))
        if len(self._twin.robots) == 1:  # a lidar sees only others
            limits = replace(limits, lidar_blind=None)
        angles = model.proximity.reported or model.proximity.angles if model.proximity else ()
        return Settings(
            name=f"twin-{number}",
            ports=PortNames(**{device: str(self._link(number, device)) for device in DEVICES}),
            limits=limits,
            swarm=SwarmSettings(port=port),  # robots are all on one machine
            proximity_angles=angles,
            reference_model=model.reference_model,
        )

    def _look(self, now: float) -> None:
        """Find which ports are plugged in, and which have been opened."""
        for number, robot in enumerate(self._twin.robots):
            for device in DEVICES:
                is_there = (number, device) in self._fds
                if robot.is_plugged_in(device) and not is_there:
                    self._plug_in(number, device)
                elif is_there and not robot.is_plugged_in(device):
                    self._note(self._fds[number, device], now, is_open=False)
                    self._unplug(number, device)
        hung_up = {fd for fd, events in self._closed.poll(0) if not events & select.POLLIN}
        for fd in self._ports.keys() - self._is_open - hung_up:
            self._note(fd, now, is_open=True)

    def _receive(self, fd: int, now: float) -> None:
        number, device = self._ports[fd]
        try:
            data = os.read(fd, _CHUNK)
        except BlockingIOError:  # closed when polled, and opened again since
            return
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            self._note(fd, now, is_open=False)
            self._renew(fd)
        else:
            self._send(fd, self._twin.robots[number].receive(device, data, now), now)

    def _renew(self, fd: int) -> None:
        """Reset a port that its client has closed: the next client finds default settings, no old bytes and no lock.

        If a client opens the port at the same time, it keeps it.

        Raises:
            RobotError: if the link was replaced or removed.
        """
        number, device = self._ports[fd]
        link = self._link(number, device)
        if not self._is_mine(link):
            raise _lost(link)
        try:
            slave = os.open(self._links[link], os.O_RDWR | os.O_NOCTTY)
        except OSError as error:
            if error.errno != errno.EBUSY:
                raise
            if self._is_hung_up(fd):  # a client that was killed has left its lock, so no client can open it
                self._plug_in(number, device)
                self._close(fd)
        else:
            tty.setraw(slave)  # also discards unread bytes
            fcntl.ioctl(slave, termios.TIOCNXCL)
            os.close(slave)

    @staticmethod
    def _is_hung_up(fd: int) -> bool:
        """Whether no client has a port open."""
        state = select.poll()
        state.register(fd, select.POLLIN)
        return any(events & select.POLLHUP for _, events in state.poll(0))

    def _send(self, fd: int | None, data: bytes, now: float) -> None:
        """Send bytes to the client of a port, at the speed of the line."""
        if fd is None or fd not in self._is_open or not data:
            return
        rate = RATES.get(self._ports[fd][1])
        if rate is None:
            self._write(fd, data)
            return
        line = self._under_way.setdefault(fd, Wire(rate, now))
        fits = data[: _CHUNK - len(line.data)]
        self._dropped += len(data) - len(fits)
        line.data += fits

    def _carry(self, now: float) -> None:
        """Deliver the bytes that have arrived."""
        for fd, line in list(self._under_way.items()):
            if data := line.carried(now):
                self._write(fd, data)
            if not line.data:
                del self._under_way[fd]

    def _write(self, fd: int, data: bytes) -> None:
        """Write to a port; bytes that do not fit are lost, as on a wire."""
        try:
            sent = os.write(fd, data)
        except OSError as error:
            if error.errno not in {errno.EAGAIN, errno.EIO}:  # full, or just closed
                raise
            sent = 0
        self._dropped += len(data) - sent

    def _note(self, fd: int, now: float, *, is_open: bool) -> None:
        """Note that a client has opened a port, or that the last one has closed it."""
        if is_open == (fd in self._is_open):
            return
        before, after = (self._closed, self._open) if is_open else (self._open, self._closed)
        before.unregister(fd)
        after.register(fd, select.POLLIN)
        self._is_open ^= {fd}
        self._under_way.pop(fd, None)
        number, device = self._ports[fd]
        self._twin.robots[number].note_port(device, is_open=is_open, now=now)

    def _plug_in(self, number: int, device: DeviceName) -> None:
        """Make a port, and let the link lead to it, atomically.

        Raises:
            RobotError: if the link was replaced, or the folder removed.
        """
        link = self._link(number, device)
        if os.path.lexists(link) and not self._is_mine(link):
            raise _lost(link)
        fd, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(fd, False)
        name = os.ttyname(slave)
        os.close(slave)
        self._fds[number, device] = fd
        self._ports[fd] = number, device
        self._closed.register(fd, select.POLLIN)
        fresh = link.with_name(device + FRESH)
        try:
            fresh.symlink_to(name)
            fresh.replace(link)
        except OSError as error:
            raise RobotError(f"{error.strerror}: {fresh}; a twin needs its folder for itself until it ends") from None
        self._links[link] = name

    def _unplug(self, number: int, device: DeviceName) -> None:
        link = self._link(number, device)
        if self._is_mine(link):
            link.unlink()
        self._links.pop(link, None)
        self._close(self._fds.pop((number, device)))

    def _is_mine(self, path: Path) -> bool:
        """Whether this twin has made a file; others may have appended to its robot.yaml."""
        try:
            if path.name == ROBOT:
                return path.read_bytes().startswith(self._head)
            return str(path.readlink()) == self._links.get(path)
        except OSError:
            return False

    def _close(self, fd: int) -> None:
        del self._ports[fd]
        (self._open if fd in self._is_open else self._closed).unregister(fd)
        self._is_open.discard(fd)
        self._under_way.pop(fd, None)
        os.close(fd)

    def _link(self, number: int, device: DeviceName) -> Path:
        return self._folder / str(number) / device


def _lost(link: Path) -> RobotError:
    return RobotError(f"{link} was removed or replaced; a twin needs its folder for itself until it ends")


def _free_ports(count: int) -> list[int]:
    """Different free UDP ports."""
    with contextlib.ExitStack() as stack:
        unused = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for one in unused:
            one.bind(("", 0))
        return [one.getsockname()[1] for one in unused]
