"""The robots of an arena, with their devices and faults. No input or output; the time is an argument."""

import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias, get_args

from mercator_design.errors import SettingsError
from mercator_design.robot.devices.health import SIDES
from mercator_design.robot.devices.ports import DEVICES, DeviceName
from mercator_design.twin.arena import TwinArena
from mercator_design.twin.devices.hub import TwinHub
from mercator_design.twin.devices.lidar import LidarState, TwinLidar
from mercator_design.twin.devices.rvr import Refused, TwinRvr
from mercator_design.twin.faults import (
    Battery,
    Damage,
    Direction,
    Fault,
    Heat,
    InvalidStream,
    LampOff,
    LidarFault,
    LineFault,
    LockedSlots,
    NoStream,
    OldHub,
    PortLoss,
    RefusedCommand,
    RvrFault,
    Script,
    SlowStream,
    Stall,
)

Log: TypeAlias = Callable[[Mapping[str, Any]], None]
"""Called with each event."""


class TwinRobot:
    """A robot of an arena, switched on at the time 0."""

    def __init__(self, arena: TwinArena, number: int, script: Script, log: Log) -> None:
        """Switch on the robot with this number; the script has the faults of all robots."""
        measure = functools.partial(arena.measure, number)
        self.rvr = TwinRvr(measure, tread_distance=arena.robot_model.drive.tread_distance, number=number)
        self.lidar = TwinLidar(functools.partial(arena.scan, number), samples=arena.samples, number=number)
        self.hub = TwinHub(functools.partial(measure, "proximity"))
        self._number, self._log = number, log
        self._faults = [fault for fault in script.faults if fault.robot == number]
        self._on: list[Fault] = []
        self._seen: dict[str, Any] = {}
        self._devices: dict[DeviceName, TwinRvr | TwinLidar | TwinHub] = {
            "rvr": self.rvr,
            "lidar": self.lidar,
            "proximity": self.hub,
        }
        on_lines = [fault for fault in self._faults if isinstance(fault, LineFault)]
        self._damage: dict[tuple[DeviceName, Direction], Damage] = {
            (device, way): Damage(
                (fault for fault in on_lines if fault.device == device), way, f"{script.seed} {number} {device} {way}"
            )
            for device, way in itertools.product(DEVICES, get_args(Direction))
        }
        self._note(0.0)

    def receive(self, device: DeviceName, data: bytes, now: float) -> bytes:
        """The answer of a device to bytes."""
        said = self._devices[device].receive(self._damage[device, "to_robot"](data, now), now)
        self._note(now)
        return self._damage[device, "from_robot"](said, now)

    def advance(self, now: float) -> Iterator[tuple[DeviceName, bytes]]:
        """The bytes that the devices send unasked up to now."""
        self._begin_and_end_faults(now)
        for name, device in self._devices.items():
            if said := self._damage[name, "from_robot"](device.advance(now), now):
                yield name, said
        self._note(now)

    def is_plugged_in(self, device: DeviceName) -> bool:
        """Whether no fault has removed the port of a device."""
        return not any(isinstance(fault, PortLoss) and fault.device == device for fault in self._on)

    def note_port(self, device: DeviceName, *, is_open: bool, now: float) -> None:
        """Note that a client has opened or closed the port of a device."""
        if device == "lidar":
            self.lidar.set_motor(on=is_open, now=now)
        self._report(now, "port", device=device, open=is_open)
        if device == "rvr" and not is_open:
            self.rvr.hang_up(now)
            self._note(now)

    def _begin_and_end_faults(self, now: float) -> None:
        on = [fault for fault in self._faults if fault.is_on(now)]
        begun, ended = ([f for f in these if f not in those] for these, those in ((on, self._on), (self._on, on)))
        self._on = on
        for fault in begun + ended:
            device = getattr(fault, "device", "rvr")
            self._report(now, "fault", kind=fault.kind, device=device, begins=fault in begun)
        if any(isinstance(fault, Battery) for fault in begun + ended):
            self.rvr.level = min((fault.level for fault in on if isinstance(fault, Battery)), default=100.0)
        if any(isinstance(fault, LidarFault) for fault in begun + ended):
            state = LidarState()
            for fault in on:
                if isinstance(fault, LidarFault):
                    state = fault.changed(state)
            self.lidar.change(state, now)
        if any(isinstance(fault, OldHub) for fault in begun + ended):
            self.hub.is_old = any(isinstance(fault, OldHub) for fault in on)
        self.rvr.drive.stall(SIDES.index(fault.motor) for fault in on if isinstance(fault, Stall))
        if any(isinstance(fault, Heat) for fault in begun + ended):
            hot = [(SIDES.index(fault.motor), fault.temperature) for fault in on if isinstance(fault, Heat)]
            self.rvr.heat(dict(sorted(hot)))  # if there are several, the hottest counts
        if any(isinstance(fault, RvrFault) for fault in begun + ended):
            self._set_rvr(on)

    def _set_rvr(self, on: Sequence[Fault]) -> None:
        """Let the faults that are present have their effect on what the RVR streams and obeys."""
        senses = self.rvr.senses
        senses.silent = frozenset(fault.service for fault in on if isinstance(fault, NoStream))
        senses.invalid = frozenset(fault.service for fault in on if isinstance(fault, InvalidStream))
        slow = sorted((fault.period, fault.service) for fault in on if isinstance(fault, SlowStream))
        senses.slow = {service: period for period, service in slow}  # if there are several, the slowest counts
        senses.lamp_fails = any(isinstance(fault, LampOff) for fault in on)
        self.rvr.locks_slots = any(isinstance(fault, LockedSlots) for fault in on)
        self.rvr.refused = tuple(Refused(f.command, f.service, f.error) for f in on if isinstance(f, RefusedCommand))

    def _note(self, now: float) -> None:
        left, right = (round(speed, 4) + 0.0 for speed in self.rvr.drive.target)
        self._note_one(now, "wheels", (left, right), left=left, right=right, by=self.rvr.drive.cause)
        self._note_one(now, "power", self.rvr.is_awake, awake=self.rvr.is_awake)
        self._note_one(now, "leds", bytes(self.rvr.leds), leds=list(self.rvr.leds))

    def _note_one(self, now: float, event: str, value: object, **details: Any) -> None:  # noqa: ANN401 - of events
        if self._seen.get(event) != value:
            self._seen[event] = value
            self._report(now, event, **details)

    def _report(self, now: float, event: str, **details: Any) -> None:  # noqa: ANN401 - of events
        self._log({"time": round(now, 6), "event": event, "robot": self._number, **details})


class Twin:
    """All robots of an arena; the time there begins with 0.

    arena: The arena.
    robots: The robots by number.
    """

    def __init__(self, arena: TwinArena, script: Script | None = None, log: Log = lambda _: None) -> None:
        """Switch the robots on.

        Raises:
            SettingsError: if a fault is of a robot that does not exist.
        """
        script = script or Script()
        for number, fault in enumerate(script.faults):
            if fault.robot >= arena.robots:
                expected = f"expected a robot's number, 0 to {arena.robots - 1}"
                place = script.where(f"faults[{number}].robot")
                raise SettingsError(f"{place}: {expected}, found {fault.robot}")
        self.arena, self._log = arena, log
        self.robots = [TwinRobot(arena, number, script, log) for number in range(arena.robots)]
        self._note_poses()

    @property
    def next_tick(self) -> float:
        """The time of the next step [s]."""
        return round((self.arena.ticks + 1) * self.arena.period, 9)

    def advance(self, now: float) -> Iterator[tuple[int, DeviceName, bytes]]:
        """The bytes that the devices send unasked up to now: robot, device, bytes."""
        while (time := self.next_tick) <= now:
            self.arena.step([robot.rvr.drive.treads for robot in self.robots])
            for number, robot in enumerate(self.robots):
                for device, said in robot.advance(time):
                    yield number, device, said
            if self.arena.ticks % self.arena.cycle == 0:
                self._note_poses()

    def note(self, event: str, **details: Any) -> None:  # noqa: ANN401 - of events
        """Log an event of all robots."""
        self._log({"time": round(self.arena.ticks * self.arena.period, 6), "event": event, **details})

    def _note_poses(self) -> None:
        treads = [robot.rvr.drive.treads for robot in self.robots]
        self.note("poses", poses=self.arena.poses.round(6).tolist(), treads=treads)
