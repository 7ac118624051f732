"""mdesign runs: what races have left behind."""

from pathlib import Path

import click

from mercator_design.cli.options import JOBS, PLUGIN
from mercator_design.cli.terminal import tell

_FOLDER = click.Path(path_type=Path, file_okay=False)


@click.group(invoke_without_command=True)
@click.pass_context
def runs(context: click.Context) -> None:
    """List, show and verify races that were run.

    Without a command it lists those in the folder runs.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_runs, folder=Path("runs"))


@runs.command("list")
@click.argument("folder", type=_FOLDER, default="runs")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_runs(folder: Path, *, as_json: bool = False) -> None:
    """List the races in the folders within FOLDER, by default runs."""
    from mercator_design.report.runs import runs_json, runs_table

    click.echo(runs_json(folder) if as_json else runs_table(folder))


@runs.command()
@click.argument("directory", type=_FOLDER)
@click.option(
    "--csv", "what", type=click.Choice(["experiments", "configurations", "tests"]), help="Print a table as CSV."
)
def show(directory: Path, what: str | None) -> None:
    """Show the race of DIRECTORY, whether it runs, was stopped or has finished."""
    from mercator_design.report.runs import run_summary
    from mercator_design.run_folder import configurations_table, experiments_table, tests_table

    if what is None:
        click.echo(run_summary(directory))
    elif what == "experiments":
        click.echo(experiments_table(directory).to_csv(index=False), nl=False)
    elif what == "tests":
        click.echo(tests_table(directory).to_csv(index=False), nl=False)
    else:
        click.echo(configurations_table(directory).to_csv(), nl=False)


@runs.command()
@click.argument("directory", type=_FOLDER)
@click.option(
    "-n",
    "--number",
    type=click.IntRange(0, 10**9),
    default=20,
    show_default=True,
    help="Experiments to run again, spread over the race.",
)
@JOBS
@PLUGIN
def verify(directory: Path, number: int, jobs: int | None) -> None:
    """Check the journal of DIRECTORY, and run a sample of its experiments again.

    Exit code 1 if something is not as it was.
    """
    from mercator_design.race.executors import ThreadExecutor, available_jobs
    from mercator_design.run_folder import verify as verify_run

    with ThreadExecutor(jobs or available_jobs()) as executor:
        for line in verify_run(directory, number, executor, announce=tell):
            click.echo(line)
