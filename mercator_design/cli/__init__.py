"""The command `mdesign`; each verb has its file.

Results go to stdout or named files; progress and messages go to stderr, progress only to a terminal. Exit codes:
0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM, 75 terminated (a race can be resumed), 130 interrupted, 141
the output was not read to its end. Heavy modules are imported by the verb that needs them, so that `--help` is quick.
"""

import click

from mercator_design import __version__
from mercator_design.cli import draw, evaluate, export, missions, record, schema, validate
from mercator_design.cli.races import race, runs, tune
from mercator_design.cli.robots import bundle, calibrate, deploy, models
from mercator_design.cli.terminal import terminable
from mercator_design.command import run
from mercator_design.system import address_space


def main() -> None:
    """Run the command line."""
    with terminable():
        run(cli, "mdesign")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdesign")
@click.pass_context
def cli(context: click.Context) -> None:
    """Design control software for swarms of Mercator robots.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM,
    75 terminated (resume the race), 130 interrupted, 141 the output was
    not read to its end.
    """  # noqa: D301 - click reads the control character
    if context.invoked_subcommand not in {"bundle", "deploy"}:  # which compute nothing
        address_space.prepare_for_libraries()


for _verb in (
    race.race,
    tune.tune,
    runs.runs,
    evaluate.evaluate,
    export.export,
    record.record,
    calibrate.calibrate,
    validate.validate,
    draw.draw,
    missions.missions,
    models.robots,
    schema.schema,
    bundle.bundle,
    deploy.deploy,
):
    cli.add_command(_verb)
