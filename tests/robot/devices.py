"""The three devices of a robot on pseudo-terminals: they answer, stream what a test sets, and note what they hear."""

import contextlib
import math
import os
import random
import select
import threading
import time

from mercator_design.robot import multiflex, rvr, ydlidar
from mercator_design.robot.multiflex import Acknowledgement, Distances
from mercator_design.robot.ports import PortNames
from mercator_design.robot.rvr import Command
from mercator_design.robot.rvr_messages import COMMANDS, Processor
from mercator_design.robot.rvr_streaming import SERVICES, StreamData
from mercator_design.robot.ydlidar import DeviceInfo, Health, Packet, ScanStarted

LINES = ("rvr", "lidar", "proximity")
QUIET = {name: dict.fromkeys(service.attributes, 0.0) for name, service in SERVICES.items()}
"""What every service streams of a robot that stands on black, in the dark."""


class Devices(threading.Thread):
    """A context manager; `names` are the ports.

    sensed: What each service streams.
    millimetres: What the hub tells.
    robots: Angles [rad] and distances [m] of heads of other robots' lidars.
    battery, percentage: State, of which 3 is critical, and charge.
    firmware: Of the RVR.
    mask: Of the hub's sensors in use.
    measuring: Time [s] from one measurement of the hub to the next.
    stuck: Whether the lidar's motor does not turn.
    health: Of the lidar; 2 is an error.
    silent: Names of lines, and of services, that tell nothing.
    deaf: Names of lines that take nothing.
    refused: By name of a command, the error that answers it.
    joined: Names of lines on which there is no device, but what is sent comes back.
    noise: What the RVR says in place of anything else.
    damage: Chance that a byte has a wrong bit.
    forgets: Whether commands run out.
    commands: Of the RVR: time [s], name, values.
    wheels: Speeds of the treads [m/s] from a time on: those commanded, or zero when a command had run out.
    """

    def __init__(self):
        super().__init__(daemon=True)
        self._pairs = {name: os.openpty() for name in LINES}
        self._ends = {name: device for name, (device, _) in self._pairs.items()}
        self.names = PortNames(**{name: os.ttyname(port) for name, (_, port) in self._pairs.items()})
        self.sensed = {name: dict(values) for name, values in QUIET.items()}
        self.millimetres = [multiflex.NOTHING] * 8
        self.robots = []
        self.battery, self.measuring = 1, 0.1
        self.silent, self.deaf, self.joined = set(), set(), set()
        self.firmware, self.percentage, self.mask = (9, 1, 462), 87, 0xFF
        self.stuck, self.damage, self._draw = False, 0.0, random.Random(1)
        self.refused, self.health, self.noise, self.forgets = {}, 0, b"", True
        self.commands, self.wheels, self.lidar_commands = [], [], []
        self._rvr = rvr.Device()
        self._heard = {"lidar": ydlidar.command_decoder(), "proximity": multiflex.command_decoder()}
        self._period = None
        self._timeout, self._runs_out, self._controller = 2.0, math.inf, 0
        self._scans = False
        self._angle = 0
        self._over = threading.Event()
        self._rounds = 0

    def __enter__(self):
        for _, port in self._pairs.values():
            os.close(port)  # the robot's program opens it by name
        for device in self._ends.values():
            os.set_blocking(device, False)  # what nobody reads is lost
        self.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self.join()
        for device in list(self._ends):
            self.unplug(device)

    def unplug(self, line):
        """Whoever has the port loses it."""
        end = self._ends.pop(line)
        self.settle()
        os.close(end)

    def tell(self, name, **values):
        """A notification of the RVR."""
        self._send("rvr", self._rvr.notify(name, **values))

    def when(self, done, seconds=20.0):
        """Wait until something is so."""
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.005)

    def settle(self):
        """Wait until what was told before is on its way, and all that follows is as the test has set it."""
        rounds = self._rounds
        self.when(lambda: self._rounds >= rounds + 2 or not self.is_alive())

    def drives(self):
        """Whether the wheels have been turned."""
        return self.driven() > 0

    def driven(self):
        """How often they have."""
        return sum(bool(left or right) for _, left, right in self.wheels)

    def rests_since(self):
        """When the wheels came to rest for good [s]."""
        last = max(k for k, (_, left, right) in enumerate(self.wheels) if left or right)
        assert last + 1 < len(self.wheels), "the wheels still turn"
        return self.wheels[last + 1][0]

    def run(self):
        streamed = turned = measured = time.monotonic()
        while not self._over.is_set():
            self._rounds += 1
            self._hear()
            now = time.monotonic()
            if now > self._runs_out and self.forgets:
                self._runs_out, self._controller = math.inf, 0
                self.wheels.append((now, 0.0, 0.0))
            if self._period is not None and now - streamed >= self._period:
                streamed = now
                self._stream()
            if self._scans and now - turned >= 0.01:
                self._scan((now - turned) * 7 * 360)
                turned = now
            elif not self._scans:
                turned = now
            if now - measured >= self.measuring:
                measured = now
                self._send("proximity", Distances(tuple(self.millimetres), self.mask).encode())

    def _hear(self):
        ends = {end: line for line, end in self._ends.items() if line not in self.deaf}
        ready, _, _ = select.select(list(ends), [], [], 0.005)
        for end in ready:
            try:
                data = os.read(end, 4096)
            except OSError:  # nobody has the port open
                time.sleep(0.001)
                continue
            if ends[end] in self.joined:
                os.write(end, data)
            elif ends[end] == "rvr":
                for command in self._rvr.receive(data):
                    self._obey(command)
            else:
                for command in self._heard[ends[end]].receive(data):
                    self._answer(command)

    def _send(self, line, data):
        if line in self._ends and line not in self.silent:
            data = self.noise if self.noise and line == "rvr" else data
            if self.damage:
                data = bytes(
                    b ^ (1 << self._draw.randrange(8) if self._draw.random() < self.damage else 0) for b in data
                )
            with contextlib.suppress(OSError):
                os.write(self._ends[line], data)

    def _obey(self, command):
        now = time.monotonic()
        assert isinstance(command, Command), command
        self.commands.append((now, command.name, command.values))
        answer = {}
        match command.name:
            case "get_main_application_version":
                answer = dict(zip(("major", "minor", "revision"), self.firmware, strict=True))
            case "get_battery_percentage":
                answer = {"percentage": self.percentage}
            case "wake":
                self.tell("did_wake")
            case "get_battery_voltage_state":
                answer = {"state": self.battery}
            case "get_active_control_system_id":
                answer = {"controller_id": self._controller}
            case "set_custom_control_system_timeout":
                self._timeout = command.values["command_timeout"] / 1000
            case "restore_default_control_system_timeout":
                self._timeout = 2.0
            case "drive_tank_si_units":
                self.wheels.append((now, command.values["left_velocity"], command.values["right_velocity"]))
                self._runs_out, self._controller = now + self._timeout, 2
            case "drive_stop":
                self.wheels.append((now, 0.0, 0.0))
                self._runs_out, self._controller = math.inf, 0
            case "start_streaming_service":
                self._period = command.values["period"] / 1000
            case "clear_streaming_service":
                self._period = None
        assert answer or not COMMANDS[command.name].returns
        if error := self.refused.get(command.name, 0):
            answer = {}
        else:
            assert self._rvr.follow(command), command
        self._send("rvr", self._rvr.answer(command.frame, error, **answer))

    def _stream(self):
        for processor in Processor:
            for slot, services in self._rvr.slots.of(processor).items():
                if not self.silent.intersection(services):
                    values = {name: self.sensed[name] for name in services}
                    self._send("rvr", self._rvr.stream(StreamData(processor, slot, is_valid=True, values=values)))

    def _answer(self, command):
        if isinstance(command, multiflex.Command):
            self._send("proximity", Acknowledgement(command.code, ok=True).encode())
            return
        self.lidar_commands.append(command)
        match command:
            case "health":
                self._send("lidar", Health(self.health).encode())
            case "device_info":
                self._send("lidar", DeviceInfo(6, (1, 5), 1, "8312230285877766").encode())
            case "scan":
                self._send("lidar", ScanStarted().encode())
                self._scans = True
            case "stop" | "force_stop":
                self._scans = False

    def _scan(self, degrees):
        """Go on by some degrees, half a degree a sample, at most to the end of the turn."""
        if self.stuck:
            self._send("lidar", Packet(64, 64, (0,)).encode())
            return
        if self._angle == 0:
            self._send("lidar", Packet(0, 0, (0,), is_ring_start=True).encode())
        n = max(1, min(80, round(2 * degrees), 720 - self._angle))
        first, last = 32 * self._angle, 32 * (self._angle + n - 1)
        samples = tuple(self._sample(math.radians(0.5 * (self._angle + k))) for k in range(n))
        self._send("lidar", Packet(first, last, samples).encode())
        self._angle = (self._angle + n) % 720

    def _sample(self, clockwise):
        for angle, distance in self.robots:
            corrected = ydlidar.correction(distance) - clockwise
            if abs((corrected - angle + math.pi) % math.tau - math.pi) < math.asin(0.035 / distance):
                return round(4000 * distance)
        return 0
