"""A person drives the robot with the keys of a terminal."""

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.logs.log import Log
from mercator_design.robot.run.control import Control, in_control
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.teleop.keyboard import Key, Keyboard, keyboard
from mercator_design.robot.teleop.recording import Recorder

HELD = 0.7
"""[s] that a key drives when it is pressed; terminals repeat one that is held from 0.25 to 0.66 s on, ..."""
REPEATED = 0.3
"""[s] ... and then 10 to 40 times a second, so the wheels stop sooner after the last of them."""

_PERIOD = 0.05  # [s]
_STATUS = 4  # periods
_WAYS: dict[str, tuple[float, float]] = {
    "forward": (1.0, 1.0),
    "back": (-1.0, -1.0),
    "left": (-0.5, 0.5),
    "right": (0.5, -0.5),
}
"""Treads, as fractions of the speed."""
_AHEAD = 0.5  # cosine of 60 degrees, within which something is ahead


class Stick:
    """Which way the keys say, and until when: nothing drives for longer than `HELD` after the last key."""

    def __init__(self) -> None:
        self._way: Key = "stop"
        self._pressed = self._until = -math.inf

    def press(self, key: Key, now: float) -> None:
        """A key, at a time [s]; one that drives nowhere stops."""
        repeats = key == self._way and now - self._pressed < HELD
        self._way, self._pressed = key, now
        self._until = now + (REPEATED if repeats else HELD)

    def way(self, now: float) -> Key | None:
        """Where to drive; None: nowhere."""
        return self._way if self._way in _WAYS and now < self._until else None


def nearest_ahead(direction: float, distances: Sequence[float], angles: Sequence[float]) -> float:
    """How far something is [m] within 60 degrees of forwards (1) or backwards (-1); infinite if nothing is."""
    ahead = [d for d, angle in zip(distances, angles, strict=True) if direction * math.cos(angle) > _AHEAD]
    return min(ahead, default=math.inf)


def teleop(
    settings: Settings, speed: float, guard: float | None, path: Path | None, report: Callable[[str], None]
) -> None:
    """Drive until a key ends it.

    Args:
        settings: The robot.
        speed: Of the treads [m/s].
        guard: The robot does not drive towards what is nearer than this [m]; None: wherever it is told.
        path: Of a recording, a new file; None: nothing is recorded.
        report: Called with messages for people.

    Raises:
        Stopped: if something stopped the wheels, with what it was; the loss of the terminal, for one.
        RobotError: if a device cannot be used, or the recording cannot be written.
        Signalled: if a signal came.
    """
    reads = ["proximity"] if guard is not None else []
    log = None if path is None else Log(path, ending="A key ended the drive")
    with in_control(settings, reads, settings.labels_of({}), log) as control:
        recorder = None if log is None else Recorder(log, control.robot, settings)
        control.robot.introduce(report)
        report("Arrows or WASD drive as long as they are held, any other key stops, Q ends.")
        note = (lambda _: None) if log is None else log.remark
        with keyboard() as keys:
            try:
                control.robot.notes.send_to(note, keys.say)
                control.arm()
                _drive(control, keys, settings, speed, guard, recorder)
            finally:
                control.robot.brake.stop("the drive has ended")  # before anything waits for the terminal
                control.robot.notes.send_to(note, report)
                if recorder is not None:
                    recorder.note_wheels(time.monotonic(), 0.0, 0.0)


def _drive(
    control: Control,
    keys: Keyboard,
    settings: Settings,
    speed: float,
    guard: float | None,
    recorder: Recorder | None,
) -> None:
    robot, stick = control.robot, Stick()
    for period, now in enumerate(control.cycles(_PERIOD)):
        if recorder is not None:
            recorder.note_heard(control.heard)
        pressed = keys.pressed()
        if "quit" in pressed:
            return
        for key in pressed:
            stick.press(key, now)
        robot.check_ages()
        doing: str = stick.way(now) or "stopped"
        left, right = _WAYS.get(doing, (0.0, 0.0))
        if guard is not None and left == right != 0.0:
            distance = nearest_ahead(left, robot.senses.samples["proximity"].values, settings.proximity_angles)
            if distance < guard:
                doing, left, right = "BLOCKED", 0.0, 0.0
        left, right = speed * left, speed * right
        robot.brake.drive(left, right)
        robot.query()
        if recorder is not None:
            recorder.note_wheels(now, left, right)
        if period % _STATUS == 0:
            keys.show(f"{doing:<8} {_status(robot, settings, now)}")


def _status(robot: Mercator, settings: Settings, now: float) -> str:
    """Battery, label of the ground, distances [cm] from the front counter-clockwise, and what is heard least of."""
    limits, senses = settings.limits, robot.senses
    ages = {
        "rvr": senses.age("attitude", now),
        "hub": senses.age("proximity", now),
        "lidar": senses.age("lidar", now),
    }
    ground = senses.label() if senses.age("ground", now) <= limits.rvr else "?"
    around = [math.nan] * len(settings.proximity_angles)
    if ages["hub"] <= limits.proximity:
        pairs = zip(settings.proximity_angles, senses.samples["proximity"].values, strict=True)
        around = [distance for _, distance in sorted(pairs, key=lambda pair: pair[0] % math.tau)]
    name, age = max(ages.items(), key=lambda pair: pair[1])
    oldest = f"oldest: {name} {age:.2f} s ago" if math.isfinite(age) else f"{name} not heard yet"
    return f"{robot.monitor.battery:>5}  {ground:<7} {' '.join(map(_centimetres, around))} cm  {oldest}"


def _centimetres(distance: float) -> str:
    if math.isnan(distance):
        return "  ?"
    return "  -" if distance == math.inf else f"{100.0 * max(0.0, distance):3.0f}"
