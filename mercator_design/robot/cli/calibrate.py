"""mercator-robot calibrate: what is particular to a robot's sensors, measured with the help of the user."""

from functools import partial
from pathlib import Path

import click

from mercator_design.command import NumberRange, Spelled, SpelledGroup, naming, print_message, print_result
from mercator_design.config.colours import COLOURS, ColourName
from mercator_design.config.writing import dump
from mercator_design.robot.cli.options import ROBOT_FILE, settings_of
from mercator_design.robot.devices.settings_file import change, check_changeable
from mercator_design.robot.run.safety import Signals
from mercator_design.robot.setup import ground_calibration, proximity_calibration
from mercator_design.robot.setup.ground_calibration import ground_sensor
from mercator_design.robot.setup.prompt import ask
from mercator_design.robot.setup.proximity_calibration import hub

_USUAL: tuple[ColourName, ...] = ("black", "gray", "white")
_SECONDS = click.option(
    "--seconds", type=NumberRange(0.2, 60.0), default=3.0, show_default=True, help="Of each measurement."
)


@click.group(cls=SpelledGroup, short_help="Measure what is particular to this robot's sensors.")
def calibrate() -> None:
    """Measure what is particular to this robot's sensors, for its robot.yaml.

    Says what to do, and waits for Enter. The values are printed, and put into ROBOT.yaml, where all else stays.
    The wheels do not turn.
    """


@calibrate.command(short_help="Measure what the ground sensor reads on colours.")
@click.argument("colours", nargs=-1, type=Spelled(list(COLOURS)), metavar="[COLOUR]...")
@ROBOT_FILE
@_SECONDS
def color(colours: tuple[ColourName, ...], robot: Path | None, seconds: float) -> None:
    """Measure what the ground sensor reads on the COLOURs of the floor: the `labels`.

    Without COLOURs these are the ones that ROBOT.yaml has labels of, or else black, gray and white. Labels of other
    colours stay.
    """
    settings = settings_of(robot)
    kept = settings.labels_of({}) if settings.labels else {}
    names = dict.fromkeys(colours or settings.labels or _USUAL)
    if robot is not None:
        check_changeable(robot, labels=dict.fromkeys(names, (0, 0, 0)))
    with Signals().caught(), ground_sensor(settings.ports) as sensor:
        labels = ground_calibration.calibrate(
            sensor, names, kept, seconds, partial(ask, meanwhile=sensor.attend), print_message
        )
    known = {**kept, **labels}
    if not settings.labels or len(known) < 2:
        print_message(
            f"Note: it knows no colours but {', '.join(known)} now; measure all others that its floors have, too"
        )
    _give(robot, labels=labels)


@calibrate.command(short_help="Find which sensor of the hub looks where.")
@ROBOT_FILE
@click.option(
    "--distance",
    type=NumberRange(0.1, 1.0),
    metavar="METRES",
    help="From each sensor to what is held before it: measures `proximity_offsets` too.",
)
@_SECONDS
def proximity(robot: Path | None, distance: float | None, seconds: float) -> None:
    """Find which sensor of the hub looks where, the `proximity_angles`, and which are dead or unplugged.

    Somebody holds a hand, or a box, before the robot, in each direction in turn.
    """
    settings = settings_of(robot)
    if robot is not None:
        offsets = {} if distance is None else {"proximity_offsets": settings.proximity_offsets}
        check_changeable(robot, proximity_angles=settings.proximity_angles, **offsets)
    with Signals().caught(), hub(settings.ports) as sensors:
        found = proximity_calibration.calibrate(
            sensors, settings.proximity_angles, distance, seconds, partial(ask, meanwhile=sensors.attend), print_message
        )
    offsets = {} if found.offsets is None else {"proximity_offsets": found.offsets}
    _give(robot, proximity_angles=tuple(round(angle, 4) for angle in found.angles), **offsets)


def _give(robot: Path | None, **values: object) -> None:
    """Print settings, and put them into a robot.yaml."""
    print_result(dump(values), nl=False)
    if robot is not None:
        with naming(robot):
            change(robot, **values)
        print_message(f"{robot} has it now")
