"""The command `mdesign`; each verb has its file.

Results go to stdout or named files; progress and messages go to stderr, progress only to a terminal. Exit codes:
0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM, 75 terminated (a race can be resumed), 130 interrupted, 141
the output was not read to its end. A verb is loaded when it is used, so
that `--help` is quick.
"""

import importlib
from collections.abc import Mapping
from typing import Final

import click

from mercator_design import __version__
from mercator_design.cli.terminal import terminable
from mercator_design.command import run
from mercator_design.system import address_space

VERBS: Final[Mapping[str, tuple[str, str]]] = {
    "bundle": ("robots.bundle", "Write mercator-robot as one file."),
    "calibrate": ("robots.calibrate", "Fit the noise of a robot's sensors to recordings."),
    "deploy": ("robots.deploy", "Copy an fsm.txt to robots, start and stop them."),
    "draw": ("draw", "Print the diagram of an fsm.txt as Graphviz text."),
    "evaluate": ("evaluate", "Measure a controller on fresh instances of a mission."),
    "export": ("export", "Write a mission, a race or a robot's log for other programs."),
    "missions": ("missions", "List, show and draw missions, and make random ones."),
    "race": ("races.race", "Design control software for a mission."),
    "record": ("record", "Run one experiment and write what happened."),
    "robots": ("robots.models", "List and show the shipped robot models."),
    "runs": ("races.runs", "List, show, verify and analyse races that were run."),
    "schema": ("schema", "Print a JSON Schema, for editors."),
    "tune": ("races.tune", "Find parameters of a program, by irace's scenario."),
    "validate": ("validate", "Check missions, robot models and FSM files."),
}
"""The module of each verb, in which it has its own name, and its line on the page of all verbs."""


def main() -> None:
    """Run the command line."""
    with terminable():
        run(cli, "mdesign")


class _Verbs(click.Group):
    """Loads a verb when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in VERBS:
            return None
        if cmd_name not in {"bundle", "deploy"}:  # which compute nothing
            address_space.prepare_for_libraries()
        module = importlib.import_module(f"{__name__}.{VERBS[cmd_name][0]}")
        verb: click.Command = getattr(module, cmd_name)
        return verb

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in VERBS.items()])


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdesign")
def cli() -> None:
    """Design control software for swarms of Mercator robots.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM,
    75 terminated (resume the race), 130 interrupted, 141 the output was
    not read to its end.
    """  # noqa: D301 - click reads the control character
