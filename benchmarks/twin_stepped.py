"""Robots on a twin at the twin's own time, in this process: what they perceive and do is never late.

Between the devices' bytes and the wheels is the robot's own code, decoders, senses and controller; left out is what
keeps real time and what stops a robot. The RVR's bytes take as long as at 115200 baud.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.fsm import Actions, Pfsm, Readings
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.devices.settings import Limits, RvrSettings, Settings, control_period_of
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.run.senses import Senses, why_device_is_needed
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software import Controller
from mercator_design.twin.arena import TwinArena, dark_limit
from mercator_design.twin.twin import Twin

Floats: TypeAlias = NDArray[np.float64]

READY = 2.0
"""[s] until all devices have told something, and the lidar turns."""
_RATE = 11_520.0  # [bytes/s] of the RVR's line


def settings_of(model: RobotModel) -> Settings:
    """What is particular to a twin's robot."""
    angles = model.proximity.reported or model.proximity.angles if model.proximity else ()
    limits = Limits(dark=dark_limit(model))
    return Settings(limits=limits, proximity_angles=angles, reference_model=model.reference_model)


class SteppedRobot:
    """A robot's senses, and its end of the lines to a twin's devices.

    senses: What it perceives.
    """

    def __init__(self, twin: Twin, number: int, senses: Senses, *, scans: bool = True) -> None:
        """Start its devices up, as the robot's program does; the lidar if it is to scan."""
        self.senses = senses
        self._robot = twin.robots[number]
        self._host = rvr.Host()
        self._ends: dict[DeviceName, Callable[[bytes], Sequence[Any]]] = {
            "rvr": self._host.receive,
            "lidar": ydlidar.decoder().receive,
            "proximity": multiflex.decoder().receive,
        }
        self._line: list[tuple[float, bytes]] = []  # of the RVR: when bytes have come, and which
        self._robot.note_port("lidar", is_open=True, now=0.0)
        for name in ("reset_yaw", "reset_locator_x_and_y"):
            self.tell(0.0, name)
        self.tell(0.0, "enable_color_detection", is_enabled=True)
        for name, processor, values in streaming(STREAMED, round(1000 * RvrSettings().period)):
            self.tell(0.0, name, processor, **values)
        if scans:
            self.hear("lidar", self._robot.receive("lidar", ydlidar.encode_command("scan"), 0.0), 0.0)

    def tell(self, now: float, name: str, target: Any = None, /, **values: Any) -> None:
        """Send a command to the RVR."""
        self.hear("rvr", self._robot.receive("rvr", self._host.send(name, target=target, **values), now), now)

    def hear(self, device: DeviceName, data: bytes, now: float) -> None:
        """Take what a device says; what the RVR says is on its way for a while."""
        if device == "rvr":
            begins = max(now, self._line[-1][0] if self._line else now)
            self._line.append((begins + len(data) / _RATE, data))
        else:
            self._take(device, data, now)

    def attend(self, now: float) -> None:
        """Take what has come by now."""
        while self._line and self._line[0][0] <= now:
            came, data = self._line.pop(0)
            self._take("rvr", data, came)

    def drive(self, wheels: Actions, speed: float, now: float) -> None:
        """Turn the treads, at fractions of a speed [m/s]."""
        self.tell(now, "drive_tank_si_units", left_velocity=speed * wheels.left, right_velocity=speed * wheels.right)

    def _take(self, device: DeviceName, data: bytes, now: float) -> None:
        for event in self._ends[device](data):
            self.senses.take(event, now)


class Stepped:
    """Robots on a twin.

    twin: The twin.
    robots: What robots there are, by number.
    now: The time [s].
    """

    def __init__(self, arena: TwinArena, senses: Callable[[], Senses], *, scans: bool = True) -> None:
        """Switch the twin's robots on, and start them up.

        Args:
            arena: Where they are.
            senses: Makes the senses of a robot.
            scans: Whether their lidars scan.
        """
        self.twin, self.now = Twin(arena), 0.0
        self.robots = [SteppedRobot(self.twin, number, senses(), scans=scans) for number in range(arena.robots)]
        self.until(READY)

    def until(self, time: float) -> None:
        """Go on until a time [s]."""
        while self.now < time:
            tick = self.twin.next_tick
            self.now = min(time, tick)
            if self.now == tick:
                for number, device, said in self.twin.advance(tick):
                    self.robots[number].hear(device, said, tick)
            for robot in self.robots:
                robot.attend(self.now)

    def readings(self, number: int) -> Readings:
        """What a robot perceives now."""
        return self.robots[number].senses.readings(self.now)


class SteppedRun(NamedTuple):
    """What robots on a twin did.

    poses: (cycles + 1, robots, 3) where they were. Row 1 is where they begin their first control cycles, row 0 the
        same, as in the simulator.
    states: (cycles, robots) of their PFSMs, after each control cycle.
    ground: (cycles, robots, 3) what they perceived of the floor's colour.
    raw: The same, as their sensors measured it.
    """

    poses: Floats
    states: NDArray[np.int64]
    ground: Floats
    raw: Floats


def stepped_run(
    arena: TwinArena, pfsm: Pfsm, header: dict[str, str], *, cycles: int, seed: int, phases: bool = True
) -> SteppedRun:
    """Robots run a PFSM.

    Args:
        arena: With the robots.
        pfsm: That all of them run.
        header: Of its fsm.txt.
        cycles: How many they run it for.
        seed: Of draws, and of when in the first period each begins its cycles.
        phases: Whether they begin at different times, as robots do.
    """
    settings = settings_of(arena.robot_model).as_raced(header)
    labels, period, speed = settings.labels_of(header), control_period_of(header), settings.limits.speed
    random = [Random(1000 * seed + number) for number in range(arena.robots)]
    scans = bool(why_device_is_needed("lidar", pfsm.reads, settings.reference_model))  # it takes most of the time
    world = Stepped(arena, lambda: Senses(settings, pfsm.reads, labels), scans=scans)
    controllers = [Controller(pfsm, settings.reference_model) for _ in world.robots]
    begins = world.now
    order = sorted((one.random() * period if phases else 0.0, number) for number, one in enumerate(random))
    poses = [arena.poses.copy()]
    states = np.zeros((cycles, arena.robots), dtype=np.int64)
    ground, raw = (np.zeros((cycles, arena.robots, 3)) for _ in range(2))
    for cycle in range(cycles):
        world.until(begins + cycle * period)
        poses.append(arena.poses.copy())
        for after, number in order:
            world.until(begins + cycle * period + after)
            draws = [random[number].random() for _ in range(pfsm.draws)]
            readings, robot = world.readings(number), world.robots[number]
            robot.drive(controllers[number].step(readings, draws), speed, world.now)
            states[cycle, number] = controllers[number].state
            ground[cycle, number] = readings.ground_red, readings.ground_green, readings.ground_blue
            raw[cycle, number] = robot.senses.samples["ground"].values
    return SteppedRun(np.array(poses), states, ground, raw)
