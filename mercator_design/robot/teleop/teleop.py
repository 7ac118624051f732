"""Drive the robot with the keys of a terminal."""

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from mercator_design.robot.devices.samples import SERVICE_OF
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.logs.log import Log
from mercator_design.robot.run.control import Control, in_control
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.teleop.keyboard import Key, Keyboard, keyboard
from mercator_design.robot.teleop.recording import Recorder

HELD = 0.7
"""[s] that the first press of a key drives; terminals repeat a held key after 0.25 to 0.66 s."""
REPEATED = 0.3
"""[s] that a repeated key drives; terminals repeat 10 to 40 times a second."""

_PERIOD = 0.05  # [s]
_STATUS_EVERY = 4  # periods
_WAYS: dict[str, tuple[float, float]] = {
    "forward": (1.0, 1.0),
    "back": (-1.0, -1.0),
    "left": (-0.5, 0.5),
    "right": (0.5, -0.5),
}
"""Speeds of the treads, as fractions of the speed of the drive."""
_AHEAD = 0.5  # cosine of 60 degrees, within which something is ahead


class Stick:
    """The direction of the drive by the pressed keys; it ends at most `HELD` after the last key."""

    def __init__(self) -> None:
        self._way: Key = "stop"
        self._pressed = self._until = -math.inf

    def press(self, key: Key, now: float) -> None:
        """Take a key that was pressed at a time [s]; a key without a direction stops."""
        repeats = key == self._way and now - self._pressed < HELD
        self._way, self._pressed = key, now
        self._until = now + (REPEATED if repeats else HELD)

    def way(self, now: float) -> Key | None:
        """The direction at a time [s]; None: at rest."""
        return self._way if self._way in _WAYS and now < self._until else None


def nearest_ahead(direction: float, distances: Sequence[float], angles: Sequence[float]) -> float:
    """The smallest distance [m] within 60 degrees of forwards (1) or backwards (-1); infinite if there is none."""
    ahead = [d for d, angle in zip(distances, angles, strict=True) if direction * math.cos(angle) > _AHEAD]
    return min(ahead, default=math.inf)


def teleop(
    settings: Settings, speed: float, guard: float | None, path: Path | None, report: Callable[[str], None]
) -> None:
    """Drive until a key ends it.

    Args:
        settings: The robot's settings.
        speed: Speed of the treads [m/s].
        guard: Distance [m] to things ahead below which the robot does not drive; None: no guard.
        path: The recording, a new file; None: nothing is recorded.
        report: Called with messages for people.

    Raises:
        RobotError, RobotStopped, Signalled: as `in_control`, and if the terminal is lost.
    """
    reads = ["proximity"] if guard is not None else []
    log = None if path is None else Log(path, ending="A key ended the drive")
    shown = ["ground"] if log is None else SERVICE_OF
    with in_control(settings, reads, settings.labels_of({}), log, extra=shown) as control:
        recorder = None if log is None else Recorder(log, control.robot, settings)
        control.robot.introduce(report)
        report("Arrows or WASD drive as long as they are held, any other key stops, Q ends.")
        note = (lambda _: None) if log is None else log.remark
        with keyboard() as keys:
            try:
                control.robot.notes.send_to(note, keys.write_line)
                control.arm()
                _drive(control, keys, settings, speed, guard, recorder)
            finally:
                control.robot.brake.stop("the drive has ended")  # before anything waits for the terminal
                control.robot.notes.send_to(note, report)
                if recorder is not None:
                    recorder.note_heard(control.heard)
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
        action: str = stick.way(now) or "stopped"
        left, right = _WAYS.get(action, (0.0, 0.0))
        if guard is not None and left == right != 0.0:
            distance = nearest_ahead(left, robot.senses.samples["proximity"].values, settings.proximity_angles)
            if distance < guard:
                action, left, right = "BLOCKED", 0.0, 0.0
        left, right = speed * left, speed * right
        robot.brake.drive(left, right)
        robot.query()
        if recorder is not None:
            recorder.note_wheels(now, left, right)
        if period % _STATUS_EVERY == 0:
            keys.show(f"{action:<8} {_status(robot, settings, now)}")


def _status(robot: Mercator, settings: Settings, now: float) -> str:
    """Battery, label of the ground, distances [cm] counter-clockwise from the front, and the oldest sample."""
    limits, senses = settings.limits, robot.senses
    samples = {"rvr": "attitude", "hub": "proximity", "lidar": "lidar"}
    ages = {name: senses.age(sample, now) for name, sample in samples.items()}
    ground = senses.label() if senses.age("ground", now) <= limits.rvr and not senses.is_dark else "?"
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
