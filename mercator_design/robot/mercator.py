"""The robot as one object: what its sensors tell and how old that is, the wheels, the lamps; start-up and shut-down.

Axes and units are converted here, where bytes become measurements: x forwards, y to the left, z up; metres, radians,
seconds. What measurements mean to a behaviour is said in fsm/, for simulation and robot alike.
"""

import contextlib
import math
import select
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple, Self, TypeAlias, TypeVar

from mercator_design.colours import COLOURS, STATE_COLOURS, ColourName
from mercator_design.errors import RobotError, Stopped
from mercator_design.fsm.clustering import lidar_neighbours
from mercator_design.fsm.perception import perceive, proximity_weight
from mercator_design.fsm.reference import Readings, Wheels
from mercator_design.robot import multiflex, rvr, ydlidar
from mercator_design.robot.multiflex import Acknowledgement, Distances
from mercator_design.robot.ports import Line, Ports
from mercator_design.robot.rvr import Flags, Notification, Response
from mercator_design.robot.rvr_messages import LIGHTS, Error, Processor, Value, lights
from mercator_design.robot.rvr_streaming import StreamData, streaming
from mercator_design.robot.safety import Brake
from mercator_design.robot.settings import Settings, nearest
from mercator_design.robot.sweep import BINS, STEP, Sweep
from mercator_design.robot.ydlidar import DeviceInfo, Health, Packet, ScanStarted

COMMANDS_END = 0.3
"""[s] after which the RVR stops by itself if it hears no command: a program that is dead drives no longer."""
PERIOD = 0.05
"""[s] of the RVR's streaming."""
STREAMED = (
    "accelerometer", "color_detection", "gyroscope", "imu", "ambient_light", "locator", "quaternion", "velocity",
)  # fmt: skip

_WAKING = 2.0  # [s] that the RVR may take to wake up
_ANSWER = 0.3  # [s] that a device may take to answer, ...
_TRIES = 5  # ... and how often it is asked
_BEGIN = 5.0  # [s] until every sensor has told something; a lidar's motor takes a few
_POLL = 10.0  # [s] between questions after the battery
_SHOW = 1.0  # [s] after which the lamps are set again, as a frame may have been lost
_LOOK = 0.01  # [s]
_REMEMBERED = 100  # answers and notifications
_CRITICAL = 3  # state of the battery
_TANK, _BRAKING = 2, 0  # controllers of the drive
_G = 9.80665
_REMEDIES = {
    "rvr": "is it switched on, its UART wired, and no login shell on it (raspi-config)?",
    "lidar": "has it power (5 V, 1 A)?",
    "proximity": "is this the hub's port, and are all sensors plugged in?",
}

Said: TypeAlias = Response | Notification | Health | DeviceInfo | ScanStarted | Acknowledgement
S = TypeVar("S", bound=Said)


class Sample(NamedTuple):
    """What a sensor told, and when it came [s]."""

    time: float
    values: tuple[float, ...]


def _turned(values: Mapping[str, float], scale: float = 1.0) -> tuple[float, ...]:
    """A vector of the RVR, whose x is to the right and y forwards; z if it has one."""
    return (scale * values["y"], -scale * values["x"], *(scale * values[axis] for axis in "z" if axis in values))


_CONVERT: Mapping[str, tuple[str, Callable[[Mapping[str, float]], tuple[float, ...]]]] = {
    "accelerometer": ("acceleration", lambda v: _turned(v, _G)),
    "gyroscope": ("turning", lambda v: _turned(v, math.pi / 180.0)),
    "imu": ("attitude", lambda v: (math.radians(v["roll"]), -math.radians(v["pitch"]), math.radians(v["yaw"]))),
    "quaternion": ("orientation", lambda v: (v["w"], *_turned(v))),
    "locator": ("position", _turned),
    "velocity": ("velocity", _turned),
    "color_detection": ("ground", lambda v: (v["r"], v["g"], v["b"])),
    "ambient_light": ("ambient_light", lambda v: (v["light"],)),
}
"""Of what the RVR streams: the name of the sample, and how its values are made.

acceleration [m/s2], turning [rad/s], attitude (roll, pitch, yaw) [rad], orientation (w, x, y, z), position [m] and
velocity [m/s] along the axes at the start, ground (red, green, blue), ambient_light [lux].
"""


class Mercator:
    """A Mercator robot; a context manager that starts it up, and stops and shuts it down on every way out.

    samples: The latest of each sensor, by name: those of `_CONVERT`, `proximity` [m] in the order of the hub, and
        `lidar`, without values: when a turn has ended.
    neighbours: Distances [m] and bearings [rad] of the robots that the latest readings have.
    facts: Versions and the like, for people.
    notes: What devices told that is neither a measurement nor an answer; whoever reads them empties the list.
    """

    def __init__(
        self, settings: Settings, ports: Ports, reads: Iterable[str] = (), *, mission: str | None = None
    ) -> None:
        """Make the robot; nothing is sent yet.

        Args:
            settings: What is particular to it.
            ports: Its open ports.
            reads: The senses that are needed, of modules.SENSES; the robot stops if one of them is stale.
            mission: Whose floor it is on.

        Raises:
            RobotError: if it lacks a sense.
        """
        self._lines = [Line(device, port) for device, port in zip(Ports._fields, ports, strict=True)]
        self._rvr, self._lidar, self._hub = self._lines
        limits = settings.limits
        sources = {
            "proximity": ("proximity", limits.proximity, self._hub),
            "neighbours": ("lidar", limits.lidar, self._lidar),
            "ground": ("ground", limits.rvr, self._rvr),
        }
        if lacking := sorted(set(reads) - set(sources)):
            raise RobotError(f"expected a PFSM that reads {', '.join(sources)}, found one that reads {lacking[0]}")
        self._needed = [("attitude", limits.rvr, self._rvr), *(sources[sense] for sense in sorted(reads))]
        self._host, self._turns, self._distances = rvr.Host(), ydlidar.decoder(), multiflex.decoder()
        self._settings, self._model = settings, settings.reference_model
        self._labels = settings.labels_of(mission)
        self._sweep = Sweep(settings.lidar_angle)
        self._looks_x = [math.cos(angle) for angle in settings.proximity_angles]
        self._looks_y = [math.sin(angle) for angle in settings.proximity_angles]
        self._found = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
        self._said: deque[Said] = deque(maxlen=_REMEMBERED)
        self._stopping = False
        self._polled = -math.inf
        self._shown: tuple[float, int] | None = None
        self.samples: dict[str, Sample] = {}
        self.neighbours: list[tuple[float, float]] = []
        self.facts: dict[str, Any] = {}
        self.notes: list[str] = []
        zero = self._host.send("drive_tank_si_units", left_velocity=0.0, right_velocity=0.0)
        zero += self._host.send("drive_stop")
        self.brake = Brake(self._rvr.write, self._drive_command, zero, limits.speed)

    def __enter__(self) -> Self:
        try:
            self._start()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def attend(self, until: float) -> None:
        """Hear the devices until a time [s, of time.monotonic]; what has come already, at least.

        Raises:
            Stopped: if a device says that the robot must not drive.
            RobotError: if a port is lost.
        """
        while True:
            left = until - time.monotonic()
            ready, _, _ = select.select(self._lines, [], [], max(0.0, left))
            for line in ready:
                self._hear(line)
            if left <= 0.0:
                return

    def readings(self) -> Readings:
        """What the robot perceives now; what no sensor tells any more is neutral.

        Raises:
            Stopped: if a sense that is needed is stale.
        """
        now = time.monotonic()
        if stale := self._stale(now):
            raise Stopped(stale)
        limits, model = self._settings.limits, self._model
        distances, bearings_x, bearings_y = self._found
        proximity: tuple[float, ...] = (math.inf,) * len(self._looks_x)
        n, ground = 0, COLOURS["white"]
        if self.age("proximity", now) <= limits.proximity:
            proximity = self.samples["proximity"].values
        if self.age("lidar", now) <= limits.lidar:
            n = lidar_neighbours(model, self._sweep.ranges(), 0.0, STEP, distances, bearings_x, bearings_y)
        if self.age("ground", now) <= limits.rvr:
            ground = COLOURS[self._label()]
        self.neighbours = [(distances[k], math.atan2(bearings_y[k], bearings_x[k])) for k in range(n)]
        weights = [proximity_weight(model, distance) for distance in proximity]
        return perceive(
            model,
            weights,
            self._looks_x,
            self._looks_y,
            distances,
            bearings_x,
            bearings_y,
            n,
            float(n),
            ground,
            (0.0, 0.0),
        )

    def age(self, name: str, now: float) -> float:
        """Of a sample [s]; infinite if there is none."""
        return now - self.samples[name].time if name in self.samples else math.inf

    def drive(self, wheels: Wheels) -> None:
        """Turn the treads, at fractions of the limit of their speed; ask after the battery now and then.

        Raises:
            Stopped: if something has stopped the wheels, or a fraction is out of range or not a number.
            RobotError: if the port is lost.
        """
        speed = self._settings.limits.speed
        self.brake.drive(speed * wheels.left, speed * wheels.right)
        if time.monotonic() - self._polled > _POLL:
            self._polled = time.monotonic()
            self._tell("get_battery_voltage_state")
            self._tell("get_battery_percentage")

    def show(self, state: int) -> None:
        """Let the lamps show a state of the PFSM."""
        now = time.monotonic()
        if self._shown is None or self._shown[1] != state or now - self._shown[0] > _SHOW:
            self._shown = now, state
            self._tell("set_all_leds", **lights(dict.fromkeys(LIGHTS, STATE_COLOURS[state])))

    def close(self) -> None:
        """Stop the wheels, then all else; nothing is raised."""
        self.brake.stop("the run has ended")
        self._stopping = True
        with contextlib.suppress(RobotError):
            self._lidar.write(b"".join(map(ydlidar.encode_command, ("force_stop", "stop"))))
            self._lidar.set_dtr(high=False)
        with contextlib.suppress(RobotError):
            for processor in Processor:
                self._tell("clear_streaming_service", processor)
            self._tell("enable_color_detection", is_enabled=False)
            self._tell("release_led_requests")
            self._ask("drive_stop")  # what follows makes commands last longer, so be sure of this one
            self._tell("restore_default_control_system_timeout")

    def _start(self) -> None:
        self._rvr.write(self._host.send("disable_notifications_and_active_commands"))
        for processor in Processor:
            self._tell("clear_streaming_service", processor)
        self._tell("wake")
        self._until(lambda: any(_is_notification(said, "did_wake") for said in self._said), _WAKING)
        self._start_rvr()
        self._start_lidar()
        self._start_hub()
        self._until(lambda: not self._stale(time.monotonic()), _BEGIN)
        if stale := self._stale(time.monotonic()):
            raise RobotError(stale)

    def _start_rvr(self) -> None:
        for processor in Processor:
            version = self._ask("get_main_application_version", processor)
            self.facts[f"firmware_{processor.name.lower()}"] = "{major}.{minor}.{revision}".format_map(version)
        self.facts |= self._ask("get_battery_percentage")
        self._polled = time.monotonic()
        self._ask("get_battery_voltage_state")
        self._ask("set_custom_control_system_timeout", command_timeout=round(1000 * COMMANDS_END))
        self._watch_commands_end()
        self._tell("enable_battery_voltage_state_change_notify", is_enabled=True)
        self._tell("enable_motor_fault_notify", is_enabled=True)
        self._tell("reset_yaw")
        self._tell("reset_locator_x_and_y")
        self._tell("enable_color_detection", is_enabled=True)
        for name, processor, values in streaming(STREAMED, round(1000 * PERIOD)):
            self._ask(name, processor, **values)

    def _watch_commands_end(self) -> None:
        """See whether a command to drive, at speed zero, ends by itself as it was told to.

        The maker's documents do not say what a robot that was stopped so answers, so this is not held against it.
        """
        self.brake.drive(0.0, 0.0)
        first = self._ask("get_active_control_system_id")["controller_id"]
        self.attend(time.monotonic() + COMMANDS_END + 0.1)
        then = self._ask("get_active_control_system_id")["controller_id"]
        self.facts["commands_end"] = (
            f"seen after {COMMANDS_END:g} s" if (first, then) == (_TANK, _BRAKING) else "not seen"
        )

    def _start_lidar(self) -> None:
        line = self._lidar
        line.write(b"".join(map(ydlidar.encode_command, ("force_stop", "stop"))))
        line.set_dtr(high=True)
        health = self._exchange(line, lambda: ydlidar.encode_command("health"), Health, lambda _: True)
        if health.status == 2:
            raise RobotError(f"lidar: it reports an error, {health.error_code:#x}; take its power away for a moment")
        info = self._exchange(line, lambda: ydlidar.encode_command("device_info"), DeviceInfo, lambda _: True)
        self.facts["lidar"] = (
            f"model {info.model}, firmware {info.firmware[0]}.{info.firmware[1]}, serial {info.serial}"
        )
        self._exchange(line, lambda: ydlidar.encode_command("scan"), ScanStarted, lambda _: True)

    def _start_hub(self) -> None:
        for command in (multiflex.BINARY_MODE, multiflex.use_sensors(0xFF)):
            said = self._exchange(self._hub, command.encode, Acknowledgement, partial(_acknowledges, command))
            if not said.ok:
                raise RobotError(f"proximity: command {command.code:#x} was refused")

    def _stale(self, now: float) -> str:
        """What is wrong with the age of a sample that is needed; empty if nothing is."""
        for name, limit, line in self._needed:
            if (age := self.age(name, now)) > limit:
                found = f"nothing for {age:.2f} s; the limit is {limit:g} s" if math.isfinite(age) else "nothing yet"
                return f"{name}: {found}; {_REMEDIES[line.device]}{self._noise(line)}"
        return ""

    def _label(self) -> ColourName:
        red, green, blue = self.samples["ground"].values
        return nearest(self._labels, (red, green, blue))

    def _drive_command(self, left: float, right: float) -> bytes:
        reply = Flags.ANSWER | Flags.ONLY_ERRORS
        return self._host.send("drive_tank_si_units", reply=reply, left_velocity=left, right_velocity=right)

    def _tell(self, name: str, target: Processor | None = None, /, **values: Value) -> None:
        """Tell the RVR something; it answers if it refuses, or if it was asked something."""
        self._rvr.write(self._host.send(name, target=target, reply=Flags.ANSWER | Flags.ONLY_ERRORS, **values))

    def _ask(self, name: str, target: Processor | None = None, /, **values: Value) -> Mapping[str, Any]:
        """What the RVR answers to a command."""

        def command() -> bytes:
            return self._host.send(name, target=target, reply=Flags.ANSWER, **values)

        def answers(response: Response) -> bool:
            return response.name == name and response.processor == (target or response.processor)

        response = self._exchange(self._rvr, command, Response, answers)
        if response.error:
            raise RobotError(f"rvr: {name} was refused: {_words(response.error)}")
        return response.values

    def _exchange(self, line: Line, command: Callable[[], bytes], kind: type[S], answers: Callable[[S], bool]) -> S:
        """What a device answers to a command, which is repeated until it does."""

        def found() -> S | None:
            return next((said for said in self._said if isinstance(said, kind) and answers(said)), None)

        for _ in range(_TRIES):
            self._said.clear()
            line.write(command())
            if self._until(lambda: found() is not None, _ANSWER) and (answer := found()) is not None:
                return answer
        raise RobotError(f"{line.device}: no answer; {_REMEDIES[line.device]}{self._noise(line)}")

    def _noise(self, line: Line) -> str:
        """What to add to a complaint if much of what came makes no sense."""
        lost = {"rvr": self._host.lost, "lidar": self._turns.lost, "proximity": self._distances.lost}[line.device]
        return f" ({lost} bytes from it make no sense: another device, or another baud rate)" if lost > 1000 else ""

    def _until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Hear the devices until something is so, or for so long; whether it is."""
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() >= end:
                return False
            self.attend(time.monotonic() + _LOOK)
        return True

    def _hear(self, line: Line) -> None:
        try:
            data = line.read()
        except RobotError:
            self._lines.remove(line)
            if self._stopping:
                return
            raise
        now = time.monotonic()
        if line is self._rvr:
            for told in self._host.receive(data):
                self._take_from_rvr(told, now)
        elif line is self._lidar:
            for event in self._turns.receive(data):
                self._take_from_lidar(event, now)
        else:
            for heard in self._distances.receive(data):
                if isinstance(heard, Acknowledgement):
                    self._said.append(heard)
                else:
                    self._take_distances(heard, now)

    def _take_from_rvr(self, told: object, now: float) -> None:
        match told:
            case StreamData(is_valid=True):
                for service, values in told.values.items():
                    name, convert = _CONVERT[service]
                    self.samples[name] = Sample(now, convert(values))
            case Response():
                self._said.append(told)
                self._heed(told.name, told.values)
                if told.name == "drive_tank_si_units" and told.error and not self._stopping:
                    raise Stopped(f"rvr: it does not drive: {_words(told.error)}")
            case Notification():
                self._said.append(told)
                self.notes.append(" ".join([told.name, *(f"{name} {value}" for name, value in told.values.items())]))
                self._heed(told.name, told.values)

    def _heed(self, name: str, values: Mapping[str, Any]) -> None:
        """Stop if the RVR says that it must not drive."""
        if self._stopping:
            return
        match name:
            case "get_battery_percentage":
                self.notes.append("battery {percentage} %".format_map(values))
            case "battery_voltage_state_change" | "get_battery_voltage_state" if values.get("state") == _CRITICAL:
                raise Stopped("rvr: the battery is critical; charge it")
            case "did_sleep":
                raise Stopped("rvr: it fell asleep")
            case "motor_fault" if values["is_fault"]:
                raise Stopped("rvr: a motor has a fault")

    def _take_from_lidar(self, event: ydlidar.Event, now: float) -> None:
        if not isinstance(event, Packet):
            self._said.append(event)
            return
        self._sweep.add(event)
        if event.is_ring_start and self._sweep.is_whole:
            self.samples["lidar"] = Sample(now, ())

    def _take_distances(self, distances: Distances, now: float) -> None:
        metres = distances.metres()
        if not any(map(math.isnan, metres)):  # a sensor that is off makes the robot blind on that side
            self.samples["proximity"] = Sample(now, tuple(metres))


def _acknowledges(command: multiflex.Command, said: Acknowledgement) -> bool:
    return said.code == command.code


def _is_notification(said: Said, name: str) -> bool:
    return isinstance(said, Notification) and said.name == name


def _words(error: int) -> str:
    return Error(error).name.lower().replace("_", " ") if error in list(Error) else f"error {error:#04x}"
