"""The command `mercator-robot`; each verb has its file. Exit codes stand in its help."""

import click

from mercator_design import __version__, command
from mercator_design.robot.cli import check, replay, run, stop


def main() -> None:
    """Run the command line."""
    command.run(cli, "mercator-robot")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mercator-robot")
def cli() -> None:
    """Run control software on a Mercator robot.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid FSM or robot.yaml,
    4 something stopped the robot: a sensor, the battery, the swarm, ...;
    128 + N signal N stopped it: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP.
    """  # noqa: D301 - click reads the control character


for _verb in (check.check, run.run, stop.stop, stop.heartbeat, replay.replay):
    cli.add_command(_verb)
