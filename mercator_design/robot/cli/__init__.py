"""The command `mercator-robot`; each verb has its file. Its help lists the exit codes."""

import click

from mercator_design import __version__, command
from mercator_design.robot.cli import calibrate, check, install, record, replay, ros, run, stop, teleop

_ELSEWHERE = {"twin": command.LazyVerb("mercator_design.twin.cli", "Run simulated robots in real time.")}
"""Commands that need the designer's packages."""


def main() -> None:
    """Run the command line."""
    command.run(cli, "mercator-robot")


@click.group(cls=command.LazyGroup, lazy=_ELSEWHERE, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mercator-robot")
def cli() -> None:
    """Run control software on a Mercator robot.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid FSM or robot.yaml,
    4 something stopped the robot: a sensor, the battery, the swarm, ...;
    128 + N signal N stopped it: 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP;
    141 the output was not read to its end.
    """  # noqa: D301 - click reads the control character


for _verb in (
    calibrate.calibrate,
    check.check,
    install.install,
    record.record,
    replay.replay,
    ros.ros,
    run.run,
    stop.heartbeat,
    stop.stop,
    teleop.teleop,
):
    cli.add_command(_verb)
