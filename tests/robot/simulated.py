"""A robot's devices in simulated time: the program under test runs in this process, and its clock is the twin's.

Time stands still while the program computes, and passes while it waits: for a device, or for the next control cycle.
So a busy machine makes nothing late, and seconds of a run take a fraction of one. Ports are buffers in memory; threads
other than the program's own, as its watchdog, do not wait for simulated time.
"""

import errno
import os
import select
import threading
import time
from unittest.mock import patch

import serial

from mercator_design.robot.devices import ports
from mercator_design.robot.devices.ports import BAUD, DEVICES, PortNames
from mercator_design.twin.terminals import RATES, Wire
from tests.robot.devices import Devices, compile_scan
from tests.robot.ways import ARGUMENTS, GO, write_files

START = 1000.0
"""[s] when the twin is switched on."""
END = 120.0
"""[s] after which a test has gone wrong."""


class SimulatedPort:
    """The robot's end of a line, in the place of `ExclusivePort`."""

    dtr = False

    def __init__(self, devices, path, baud):
        self._devices, self.name = devices, path
        self.line = next(line for line in DEVICES if getattr(devices.names, line) == path)
        assert baud == BAUD[self.line]
        if not devices.is_plugged_in(self.line):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        if self.line in devices.ports:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), path)
        self.received, self.is_lost = bytearray(), False
        rate = RATES.get(self.line)
        self.wire = None if rate is None else Wire(rate, devices.now)
        devices.ports[self.line] = self
        devices.note_port(self.line, is_open=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        if self._devices.ports.get(self.line) is self:
            del self._devices.ports[self.line]
            self._devices.note_port(self.line, is_open=False)

    def fileno(self):
        return 1_000_000 + DEVICES.index(self.line)

    @property
    def in_waiting(self):
        self._check()
        return len(self.received)

    def read(self, size):
        self._check()
        data = bytes(self.received[:size])
        del self.received[:size]
        return data

    def write(self, data):
        self._check()
        self.hear(self._devices.receive(self.line, data))

    def hear(self, data):
        """Take what the device says; a slow line carries it for a while."""
        if self.wire is None:
            self.received += data
        elif data:
            if not self.wire.data:
                self.wire = Wire(RATES[self.line], self._devices.now)
            self.wire.data += data

    def carry(self, now):
        if self.wire is not None and self.wire.data:
            self.received += self.wire.carried(now)

    def _check(self):
        if self.is_lost:
            raise serial.SerialException("device disconnected")


class SimulatedDevices(Devices):
    """`Devices` whose time passes only while the program, or a test, waits.

    now: The time of the twin [s].
    ports: Those that are open, by line.
    each_tick: What is done in each tick of the twin.
    """

    def __enter__(self):
        compile_scan()
        self.names = PortNames(**{line: f"/simulated/{line}" for line in DEVICES})
        self.now, self.ports, self.each_tick, self._later = 0.0, {}, [], []
        self._real_select, self._real_sleep, self._real_port = select.select, time.sleep, ports.ExclusivePort
        self._thread = threading.current_thread()
        (self._robot,) = self._twin.robots
        self._twin.note("clock", start=START, at="")
        for target, name, value in (
            (time, "monotonic", lambda: START + self.now),
            (time, "sleep", self._sleep),
            (select, "select", self._select),
            (ports, "ExclusivePort", self._open_port),
        ):
            self._stack.enter_context(patch.object(target, name, value))
        return self

    def _open_port(self, path, baud, **options):
        """A port of these devices, or of this computer."""
        simulated = {getattr(self.names, line) for line in DEVICES}
        return SimulatedPort(self, path, baud) if path in simulated else self._real_port(path, baud, **options)

    def then(self, condition, act):
        """Act once a condition holds, while the program runs; after what was to be done before."""
        self._later.append((condition, act))

    def when(self, done, seconds=20.0):
        end = self.now + seconds
        while not done():
            assert self.now < end, "waited in vain"
            self._pass(self._twin.next_tick)

    def is_plugged_in(self, line):
        return line not in self.unplugged

    def note_port(self, line, *, is_open):
        self._robot.note_port(line, is_open=is_open, now=self.now)

    def receive(self, line, data):
        return self._robot.receive(line, data, self.now)

    def _sleep(self, seconds):
        if threading.current_thread() is self._thread:
            self._pass(self.now + seconds)
        else:
            self._real_sleep(min(seconds, 0.005))

    def _select(self, reading, writing, failing, timeout=None):
        """Of the program's thread: let time pass until something can be read."""
        if writing or threading.current_thread() is not self._thread:
            return self._real_select(reading, writing, failing, 0.005 if timeout is None else min(timeout, 0.005))
        end = END if timeout is None else self.now + timeout
        while not (ready := self._ready(reading)) and self.now < end:
            self._pass(min(end, self._next()))
        return ready, [], []

    def _ready(self, files):
        """Those from which something can be read."""
        numbers = {port.fileno(): port for port in self.ports.values()}
        ready, others = [], []
        for file in files:
            port = None if isinstance(file, int) else numbers.get(file.fileno())
            if port is None:
                others.append(file)
            elif port.received or port.is_lost:
                ready.append(file)
        return ready + (self._real_select(others, [], [], 0.0)[0] if others else [])

    def _next(self):
        """When something may come."""
        is_carried = any(port.wire is not None and port.wire.data for port in self.ports.values())
        return min(self._twin.next_tick, self.now + 0.001) if is_carried else self._twin.next_tick

    def _pass(self, until):
        """Let time pass until then."""
        while True:
            self.now = min(until, self._next())
            if self.now >= self._twin.next_tick:
                self._tick()
            for port in self.ports.values():
                port.carry(self.now)
            if self.now >= until:
                return

    def _tick(self):
        assert self.now < END, "the program does not end"
        self._turn(self.now)
        for _, line, said in self._twin.advance(self.now):
            if line in self.ports:
                self.ports[line].hear(said)
        for line, port in self.ports.items():
            port.is_lost = port.is_lost or not self.is_plugged_in(line)
        for each in self.each_tick:
            each()
        if self._later and self._later[0][0]():
            self._later.pop(0)[1]()


class SimulatedRun:
    """`mercator-robot run` in this process, on simulated devices.

    began: When what `act` did was done [s].
    """

    def __init__(self, devices, run_command, folder):
        self.devices, self.folder, self.began = devices, folder, None
        self._run, self._ended = run_command, None

    def act(self, fault, when=None):
        """Let something happen once the robot has driven for some cycles, or when something is so."""

        def acts():
            self.began = time.monotonic()
            fault(self)

        self.devices.then(when or self.drives, acts)

    def drives(self):
        return self.devices.driven() > 2

    def run(self, fsm=GO, *options, settings=""):
        """Run until the end; the folder is the current one."""
        write_files(self.folder, self.devices.names, fsm, f"null{settings}")
        code, _, error = self._run("run", *ARGUMENTS, *options)
        self._ended = code, error

    def ended(self):
        """The exit code, and what was said."""
        return self._ended

    def late(self):
        """How long after the fault the wheels were told to rest [s]."""
        return self.devices.told_to_rest(self.began)
