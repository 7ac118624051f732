"""A robot's three devices as a test has them in hand: the twin's, on its pseudo-terminals, amid what the test sets."""

import contextlib
import functools
import math
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np

from mercator_design.robot.devices.ports import DEVICES, PortNames
from mercator_design.robot.protocols.rvr import Unknown
from mercator_design.robot.protocols.ydlidar import Packet, encode_command
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.twin.devices.lidar import FINE, SPINS_UP, TwinLidar
from mercator_design.twin.faults import Flip, PortLoss, Script, Silence, WrongBaud
from mercator_design.twin.terminals import Terminals
from mercator_design.twin.twin import Twin
from tests.processes import wait_until

CLEAR = (math.inf,) * 8
"""What a hub measures that has nothing around."""


class Surroundings:
    """In the place of an `Arena`: one robot, which measures what a test sets, wherever its treads take it.

    measured: What its devices measure: at first on black, in the dark, facing +x.
    heads: Angles [rad] and distances [m] of heads of other robots' lidars.
    wall: Distance [m] of a wall behind them, all around; 0: there is none.
    """

    robots, period, cycle, samples = 1, 0.01, 10, 719
    poses = np.zeros((1, 3))
    robot_model = load_robot_model("mercator")

    def __init__(self):
        self.ticks, self.heads, self.wall = 0, [], 0.0
        self.measured = dict.fromkeys(("accelerometer", "gyroscope", "imu"), (0.0, 0.0, 0.0))
        self.measured["ground_sensors"] = (7.0, 8.0, 6.0)
        self.measured |= dict.fromkeys(("locator", "velocity", "treads"), (0.0, 0.0))
        self.measured |= {"ambient_light": (0.0,), "quaternion": (1.0, 0.0, 0.0, 0.0), "proximity": CLEAR}

    def step(self, _):
        self.ticks += 1

    def measure(self, _, device):
        return self.measured[device]

    def scan(self, _robot, _time):
        ranges = np.full(FINE * self.samples, self.wall)
        for angle, distance in self.heads:
            half = math.asin(self.robot_model.lidar.head_radius / distance)
            edges = [round((angle + side) / math.tau * len(ranges)) for side in (-half, half)]
            ranges[np.arange(*edges) % len(ranges)] = distance
        return ranges, 0.0


class Devices(Surroundings):
    """A context manager; `names` are the ports, `rvr`, `lidar` and `hub` the twin's devices.

    silent: Names of lines, and of services, that tell nothing.
    deaf: Names of lines that take nothing.
    joined: Names of lines on which there is no device, but what is sent comes back.
    unplugged: Names of lines that have no port.
    damaged: Names of lines on which one byte of a thousand that a device tells has a wrong bit.
    torn: The same, of one byte of a hundred.
    noisy: Names of lines on which twice as much comes between frames, and makes no sense.
    wrong_baud: Names of lines on which nothing that a device tells makes sense.
    misheard: Names of lines on which three bytes of a hundred that a device hears have a wrong bit.
    instead: By name of a command, what answers it in place of the RVR, which does not obey it: values, or an `error`.
    once: The same, of the next command of that name only.
    is_stuck: Whether the lidar's motor does not turn.
    suspended: A lock; while a test has it, no device does anything.
    commands: That the RVR heard: time [s], name, values.
    lidar_commands: Their names.
    log: The twin's.
    """

    def __init__(self):
        super().__init__()
        self.silent, self.deaf, self.joined, self.unplugged, self.damaged, self.wrong_baud = (set() for _ in range(6))
        self.torn, self.noisy, self.misheard, self.once = set(), set(), set(), {}
        self.instead, self.is_stuck, self.suspended = {}, False, threading.Lock()
        self.commands, self.lidar_commands, self.log = [], [], []
        self._told, self._is_over, self._stack = deque(), False, contextlib.ExitStack()
        self._terminals, self._turns = None, 0
        self._twin = Twin(self, Script(faults=list(self._faults())), self.log.append)
        (robot,) = self._twin.robots
        self.rvr, self.lidar, self.hub = robot.rvr, robot.lidar, robot.hub
        self.rvr.level = 87.0
        robot.receive = functools.partial(self._receive, robot.receive)
        for line, device in zip(DEVICES, (self.rvr, self.lidar, self.hub), strict=True):
            device.advance = functools.partial(self._advance, device.advance, line)
        self.rvr.obey = functools.partial(self._obey, self.rvr.obey)
        self.rvr.senses._stream = functools.partial(self._stream, self.rvr.senses._stream)
        self.lidar.obey = functools.partial(self._obey_lidar, self.lidar.obey)
        self.lidar._packet = functools.partial(self._packet, self.lidar._packet)
        self.lidar.set_motor(on=True, now=-SPINS_UP)

    def _faults(self):
        for line in DEVICES:
            yield by_hand(lambda line=line: line in self.silent, Silence, device=line, direction="from_robot")
            yield by_hand(lambda line=line: line in self.deaf, Silence, device=line, direction="to_robot")
            yield by_hand(lambda line=line: line in self.unplugged, PortLoss, device=line)
            yield by_hand(lambda line=line: line in self.damaged, Flip, device=line, direction="from_robot", rate=1e-3)
            yield by_hand(lambda line=line: line in self.torn, Flip, device=line, direction="from_robot", rate=1e-2)
            yield by_hand(lambda line=line: line in self.misheard, Flip, device=line, direction="to_robot", rate=0.03)
            yield by_hand(lambda line=line: line in self.wrong_baud, WrongBaud, device=line, direction="from_robot")

    def __enter__(self):
        compile_scan()
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        terminals = self._terminals = self._stack.enter_context(Terminals(self._twin, folder))
        self.names = PortNames(**{line: str(folder / "0" / line) for line in DEVICES})
        loop = threading.Thread(target=terminals.run, args=[self._turn], daemon=True)
        loop.start()
        self._stack.callback(loop.join)
        return self

    def __exit__(self, *_):
        self._is_over = True
        self._stack.close()

    def tell(self, name, **values):
        """A notification of the RVR."""
        self._told.append(self.rvr._line.notify(name, **values))

    when = staticmethod(wait_until)

    def settle(self):
        """Wait until what was told before is on its way, and all that follows is as the test has set it."""
        ticks = self.ticks
        self.when(lambda: self.ticks >= ticks + 2)
        turns = self._turns
        self.when(lambda: self._turns >= turns + 2)  # so all that was told until then is on the lines

    def is_silent(self):
        """Whether nothing is on its way now along a slow line of a pseudo-terminal."""
        return self._terminals is None or not self._terminals._under_way

    def is_let_go(self):
        """Whether nobody has a port any more that somebody had."""
        opened = [event["open"] for event in self.log if event["event"] == "port"]
        return any(opened) and 2 * sum(opened) == len(opened)

    @property
    def wheels(self):
        """What the treads were told [m/s] each time that it was something else: time [s], left, right."""
        (start,) = [event["start"] for event in self.log if event["event"] == "clock"]
        told = [event for event in self.log if event["event"] == "wheels"]
        return [(start + event["time"], event["left"], event["right"]) for event in told]

    def drives(self):
        """Whether the wheels have been turned."""
        return any(left or right for _, left, right in self.wheels)

    def driven(self):
        """How often they were told to."""
        return sum(name == "drive_tank_si_units" and any(values.values()) for _, name, values in self.commands)

    def come_to_rest(self):
        """Wait until the wheels are told to rest."""
        self.when(lambda: not any(self.wheels[-1][1:]))

    def rests_since(self):
        """When the wheels came to rest for good [s]."""
        assert self.drives(), "the wheels never turned"
        when, *told = self.wheels[-1]
        assert told == [0.0, 0.0], "the wheels still turn"
        return when

    def told_to_rest(self, began):
        """How long after a time the wheels were told to rest for good [s]; infinite if they did so by themselves."""
        return self.rests_since() - began if self.stopped_by() != "timeout" else math.inf

    def stopped_by(self):
        """What told the wheels something last."""
        return [event["by"] for event in self.log if event["event"] == "wheels"][-1]

    def _turn(self, _):
        """In each turn of the twin's loop; whether it is over."""
        self._turns += 1
        while self._told:
            self.rvr._said.append(self._told.popleft())
        with self.suspended:
            return self._is_over

    def _receive(self, usual, line, data, now):
        return data if line in self.joined else usual(line, data, now)

    def _advance(self, usual, line, now):
        said = usual(now)
        return said + bytes(2 * len(said)) if line in self.noisy else said

    def _obey(self, usual, command):
        if isinstance(command, Unknown):  # damaged on its way, but its checksum is right
            return usual(command)
        self.commands.append((time.monotonic(), command.name, command.values))
        instead = self.once.pop(command.name, None) or self.instead.get(command.name)
        if instead is not None:
            return self.rvr._line.answer(command.frame, **instead)
        if command.name == "wake" and self.rvr.is_awake:  # so that nobody waits for it
            self.tell("did_wake")
        return usual(command)

    def _stream(self, usual, processor, slot):
        return b"" if self.silent.intersection(self.rvr._line.slots.of(processor)[slot]) else usual(processor, slot)

    def _obey_lidar(self, usual, command, now):
        self.lidar_commands.append(command)
        return usual(command, now)

    def _packet(self, usual, *of):
        return Packet(64, 64, (0,)).encode() if self.is_stuck else usual(*of)


def by_hand(is_on, kind, **values):
    """A fault that is there as long as a test has it so."""
    return type(kind.__name__, (kind,), {"is_on": lambda _, now: is_on()})(at=0.0, robot=0, **values)


@functools.cache
def compile_scan():
    """Before time counts."""
    lidar = TwinLidar(functools.partial(Surroundings().scan, 0), samples=Surroundings.samples)
    lidar.set_motor(on=True, now=-SPINS_UP)
    lidar.receive(encode_command("scan"), 0.0)
    lidar.advance(1.0)
