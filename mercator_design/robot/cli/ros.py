"""mercator-robot ros: a node of ROS."""

import contextlib

import click

from mercator_design.command import NumberRange, print_message
from mercator_design.robot.cli.options import ROBOT
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.ros.node import RosNode, serve


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME:=NAME]...")
@ROBOT
@click.option(
    "--rate",
    type=NumberRange(0.1, 20.0),
    default=5.0,
    show_default=True,
    metavar="HZ",
    help="Rate of colours, light, imu and odom; a scan comes each turn, ranges as they are measured.",
)
@click.option(
    "--silence",
    type=NumberRange(0.1, 2.0),
    default=0.3,
    show_default=True,
    metavar="SECONDS",
    help="Time without a message on rvr/wheels_speed after which the wheels are at rest.",
)
def ros(names: tuple[str, ...], settings: Settings, rate: float, silence: float) -> None:
    """Run a node of ROS 1, with the topics of the original driver, labeller, lidar and Multiflex.

    Publishes rvr/ground_color, rvr/fixed_color, rvr/ambient_light, rvr/imu, rvr/odom, scan and ranges; obeys
    rvr/wheels_speed and rvr/rgb_leds. NAME:=NAME are remappings as for any node, such as __ns:=robot1. The node ends
    when something stops the wheels, as in a run, when roscore ends, and on a message that cannot be obeyed.
    """
    if wrong := [name for name in names if ":=" not in name]:
        raise click.UsageError(f"expected a remapping, NAME:=NAME, found '{wrong[0]}'")
    with contextlib.closing(RosNode()) as node:
        serve(settings, node, rate, silence, print_message)
