"""The command `mercator-robot`; each verb has its file. Exit codes stand in its help."""

import importlib

import click

from mercator_design import __version__, command
from mercator_design.errors import RobotError
from mercator_design.robot.cli import calibrate, check, install, record, replay, ros, run, stop, teleop

_ELSEWHERE = {"twin": "mercator_design.twin.cli"}
"""Verbs of the designer's part, which a robot need not have: the module of each."""
_PARTS = {module.rpartition(".")[0] for module in _ELSEWHERE.values()}


def main() -> None:
    """Run the command line."""
    command.run(cli, "mercator-robot")


class _Verbs(click.Group):
    """The verbs here, and those elsewhere that are there."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted([*super().list_commands(ctx), *_ELSEWHERE])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _ELSEWHERE:
            return super().get_command(ctx, cmd_name)
        try:
            found: click.Command = getattr(importlib.import_module(_ELSEWHERE[cmd_name]), cmd_name)
        except ModuleNotFoundError as error:
            if error.name not in _PARTS:
                raise
            return None
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] in _ELSEWHERE and self.get_command(ctx, args[0]) is None:
            raise RobotError(f"{args[0]} is not in this file, as it needs the designer: in a checkout, pip install .")
        return super().resolve_command(ctx, args)


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
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
