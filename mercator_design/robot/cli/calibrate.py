"""mercator-robot calibrate: measure a robot's sensors with the help of the user."""

from functools import partial
from pathlib import Path

import click

from mercator_design.command import NumberRange, Spelled, SpelledGroup, print_message, print_result
from mercator_design.config.colours import COLOURS, ColourName
from mercator_design.config.writing import dump
from mercator_design.robot.cli.options import ROBOT_FILE, settings_of
from mercator_design.robot.devices.settings_file import change, check_changeable
from mercator_design.robot.run.safety import Signals
from mercator_design.robot.setup import ground_calibration, proximity_calibration
from mercator_design.robot.setup.ground_calibration import ground_sensor
from mercator_design.robot.setup.prompt import ask
from mercator_design.robot.setup.proximity_calibration import hub
from mercator_design.system.files import writing

_USUAL: tuple[ColourName, ...] = ("black", "gray", "white")
_SECONDS = click.option(
    "--seconds", type=NumberRange(0.2, 60.0), default=3.0, show_default=True, help="Duration of each measurement."
)


@click.group(cls=SpelledGroup)
def calibrate() -> None:
    """Calibrate this robot's sensors, for its robot.yaml.

    Prints what to do, and waits for Enter. The values are printed and written into ROBOT.yaml, where all else stays.
    The wheels do not turn.
    """


@calibrate.command(short_help="Measure what the ground sensor reads on colours.")
@click.argument("colours", nargs=-1, type=Spelled(list(COLOURS)), metavar="[COLOUR]...")
@ROBOT_FILE
@_SECONDS
def color(colours: tuple[ColourName, ...], robot: Path | None, seconds: float) -> None:
    """Measure what the ground sensor reads on the COLOURs of the floor: the `labels`.

    Without COLOURs, measures those with labels in ROBOT.yaml, or else black, gray and white. Labels of other colours
    stay.
    """
    settings = settings_of(robot)
    kept = settings.labels_of({}) if settings.labels else {}
    names = dict.fromkeys(colours or settings.labels or _USUAL)
    if robot is not None:
        check_changeable(robot, labels=dict.fromkeys(names, (0, 0, 0)))
    with Signals().caught(), ground_sensor(settings) as sensor:
        labels = ground_calibration.calibrate(
            sensor, names, kept, seconds, partial(ask, meanwhile=sensor.attend), print_message
        )
    known = {**kept, **labels}
    if not settings.labels or len(known) < 2:
        print_message(
            f"Note: the robot knows only {', '.join(known)} now; measure all other colours of its floors, too"
        )
    _write(robot, labels=labels)


@calibrate.command(short_help="Find the angles of the hub's sensors.")
@ROBOT_FILE
@click.option(
    "--distance",
    type=NumberRange(0.1, 1.0),
    metavar="METRES",
    help="Distance of the object from each sensor; measures `proximity_offsets`, too.",
)
@_SECONDS
def proximity(robot: Path | None, distance: float | None, seconds: float) -> None:
    """Find the angles of the hub's sensors, the `proximity_angles`, and which sensors are dead or unplugged.

    The user holds a hand, or a box, before each sensor in turn.
    """
    settings = settings_of(robot)
    if robot is not None:
        offsets = {} if distance is None else {"proximity_offsets": settings.proximity_offsets}
        check_changeable(robot, proximity_angles=settings.proximity_angles, **offsets)
    with Signals().caught(), hub(settings.ports) as link:
        found = proximity_calibration.calibrate(
            link, settings.proximity_angles, distance, seconds, partial(ask, meanwhile=link.discard), print_message
        )
    offsets = {} if found.offsets is None else {"proximity_offsets": found.offsets}
    _write(robot, proximity_angles=tuple(round(angle, 4) for angle in found.angles), **offsets)


def _write(robot: Path | None, **values: object) -> None:
    """Print settings, and write them into a robot.yaml."""
    print_result(dump(values), nl=False)
    if robot is not None:
        with writing(robot):
            change(robot, **values)
        print_message(f"Written to {robot}")
