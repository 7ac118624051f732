"""The command `mercator-robot`; each verb has its file. Its help lists the exit codes.

A verb is loaded when it is used: a run starts sooner, and the designer's part, which a robot need not have, is for
`twin` only.
"""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design import __version__
from mercator_design.command import LazyGroup, LazyVerb
from mercator_design.command import run as run_command
from mercator_design.robot.cli.messages import queue_messages

VERBS: Final[Mapping[str, LazyVerb]] = {
    "calibrate": LazyVerb("mercator_design.robot.cli.calibrate", "Calibrate this robot's sensors.", is_light=True),
    "check": LazyVerb("mercator_design.robot.cli.check", "Find faults of this robot.", is_light=True),
    "heartbeat": LazyVerb(
        "mercator_design.robot.cli.stop", "Let robots run as long as this command runs.", is_light=True
    ),
    "install": LazyVerb(
        "mercator_design.robot.cli.install", "Give ports their names, and systemd its services.", is_light=True
    ),
    "record": LazyVerb("mercator_design.robot.cli.record", "Record the sensors of the robot at rest.", is_light=True),
    "replay": LazyVerb(
        "mercator_design.robot.cli.replay", "Show and check the decisions of a run, from its log.", is_light=True
    ),
    "ros": LazyVerb("mercator_design.robot.cli.ros", "Run a node of ROS 1.", is_light=True),
    "run": LazyVerb("mercator_design.robot.cli.run", "Run the PFSM of an fsm.txt.", is_light=True),
    "stop": LazyVerb("mercator_design.robot.cli.stop", "Stop this robot, or others.", is_light=True),
    "teleop": LazyVerb("mercator_design.robot.cli.teleop", "Drive with the keys of this terminal.", is_light=True),
    "twin": LazyVerb("mercator_design.twin.cli", "Run simulated robots in real time."),
}


def main() -> None:
    queue_messages()
    run_command(cli, "mercator-robot")


@click.group(cls=LazyGroup, lazy=VERBS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mercator-robot")
def cli() -> None:
    """Run control software on a Mercator robot.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid FSM or robot.yaml,
    4 something stopped the robot: a sensor, the battery, the swarm, ...;
    128 + N signal N stopped it: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP;
    141 the output was not read to its end.
    """  # noqa: D301 - click reads the control character
