"""mdesign runs: shows, compares and analyses the run folders of races."""

import json
from pathlib import Path
from typing import Final

import click

from mercator_design.api import fresh_instances
from mercator_design.cli.evaluate import measured
from mercator_design.cli.options import CSV, FOLDER, JOBS, JSON, PLUGIN, PROGRESS, plot_of, seed_of
from mercator_design.cli.terminal import Interrupt, command_line, terminal_width
from mercator_design.command import LazyGroup, LazyVerb, print_message, print_note, print_result, warn
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis.ablation import race_ablation
from mercator_design.results.analysis.importance import race_importance
from mercator_design.results.analysis.winners import winners
from mercator_design.results.files import restored
from mercator_design.results.tables import configurations_table, experiments_table, tests_table
from mercator_design.results.verification import verify as verify_run
from mercator_design.show.text.analysis import (
    ABLATION,
    ablation_csv,
    ablation_page,
    importance_csv,
    importance_page,
    save_ablation,
)
from mercator_design.show.text.columns import with_notes_wrapped
from mercator_design.show.text.evaluations import Comparison, comparison_data, comparison_text
from mercator_design.show.text.progress import AblationDisplay, Mode
from mercator_design.show.text.runs import (
    races_json,
    run_summary,
    runs_json,
    runs_table,
    save_races,
    side_by_side,
    what_races_show,
)
from mercator_design.system.files import write_text, writing

VERBS: Final = {
    "map": LazyVerb("mercator_design.cli.races.maps", "Map what the elites of a race see, and tell which maps best."),
}
_TABLES = {"experiments": experiments_table, "configurations": configurations_table, "tests": tests_table}


@click.group(cls=LazyGroup, lazy=VERBS, invoke_without_command=True)
@click.pass_context
def runs(context: click.Context) -> None:
    """List, show, compare, verify and analyse races.

    Without a command, list the races in the folder runs.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_runs, folder=Path("runs"))


@runs.command("list")
@click.argument("folder", type=FOLDER, default="runs")
@JSON
def list_runs(folder: Path, *, as_json: bool = False) -> None:
    """List the races in the folders within FOLDER, by default runs."""
    if as_json:
        print_result(runs_json(folder))
        return
    table, notes = runs_table(folder, terminal_width())
    print_result(table)
    warn(*notes)


@runs.command(short_help="Show a race and its results.")
@click.argument("directory", type=FOLDER)
@click.option("--csv", "what", type=click.Choice([*_TABLES]), help="Print a table as CSV.")
@PLUGIN
def show(directory: Path, what: str | None) -> None:
    """Show the race of DIRECTORY; it may be running, interrupted or finished."""
    if what is None:
        print_result(with_notes_wrapped(run_summary(directory), terminal_width()))
    else:
        print_result(_TABLES[what](directory).to_csv(index=what == "configurations"), nl=False)


@runs.command(short_help="Compare races, and their winners on the same instances.")
@click.argument("directories", type=FOLDER, nargs=-1, required=True, metavar="DIRECTORY...")
@click.option(
    "-n", "--runs", type=click.IntRange(0, 10**6), default=0, help="Run the winners on N fresh instances.", metavar="N"
)
@seed_of("Seed of the fresh instances.")
@JOBS
@JSON
@plot_of("Draw the best score over the budget of each race.")
@PROGRESS
def compare(
    directories: tuple[Path, ...],
    runs: int,
    seed: int,
    jobs: int | None,
    as_json: bool,
    plot: Path | None,
    progress: Mode,
) -> None:
    """Show the races of several DIRECTORIES side by side: request, budget, winner, scores.

    With --runs, the winners of races for the same mission run on the same fresh instances: a table with paired tests
    shows which is best, as that of `mdesign evaluate`. Each race gives one design, so this does not show which method
    is best: `mdesign study compare` does.
    """
    table, races = side_by_side(directories), races_json(directories)
    found = None
    if runs:
        pfsms, simulator = winners(directories)
        simulator.rehearse(announce=print_note)
        evaluated = measured(pfsms, simulator, fresh_instances(seed, runs), jobs=jobs, progress=progress)
        found = Comparison(evaluated, simulator.mission, simulator.robot_model)
    note = what_races_show(directories)
    if as_json:
        data = comparison_data(found, seed=seed) if found else None
        print_result(json.dumps({"races": races, "evaluation": data, "note": note or None}, allow_nan=False))
    else:
        print_result(table)
        if found:
            print_result(f"\n{comparison_text(found, seed=seed)}")
        if note:
            print_result(with_notes_wrapped(f"Note       {note}", terminal_width()))
    if plot is not None:
        with writing(plot):
            save_races(plot, directories, command=command_line())


@runs.command(short_help="Check the journal of a race, and run a sample of it again.")
@click.argument("directory", type=FOLDER)
@click.option(
    "-n",
    "--number",
    type=click.IntRange(0, 10**9),
    default=20,
    show_default=True,
    help="Number of experiments to run again, spread over the race.",
)
@JOBS
@PLUGIN
def verify(directory: Path, number: int, jobs: int | None) -> None:
    """Check the journal of DIRECTORY, and run a sample of its experiments again.

    The exit code is 1 if a result differs.
    """
    task = restored(directory)
    with Interrupt(then=task.stop) as interrupt, ThreadExecutor(jobs) as executor:
        for line in verify_run(directory, task, number, executor, announce=print_message, stopped=interrupt.came):
            print_result(line)


@runs.command(short_help="Show which modules or parameters explain the scores.")
@click.argument("directory", type=FOLDER)
@click.option(
    "--of",
    "what",
    type=click.Choice(["modules", "parameters"]),
    help="Explain scores by the number of each module in a PFSM, or by the parameters of the grammar.  "
    "[default: modules, if there are any]",
)
@seed_of("Seed of the analysis.")
@CSV
@PLUGIN
def importance(directory: Path, what: str | None, seed: int, as_csv: bool) -> None:
    """Show which modules or parameters explain the scores in the race of DIRECTORY."""
    print_note("Finding what explains the scores ...")
    task, explanation = race_importance(directory, modules=None if what is None else what == "modules", seed=seed)
    print_result(importance_csv(explanation) if as_csv else importance_page(task, explanation), nl=False)


@runs.command(short_help="Find which parts the winner of a race needs.")
@click.argument("directory", type=FOLDER)
@click.option(
    "--from", "start", type=click.IntRange(0), metavar="CONFIGURATION", help="Go from this configuration to the winner."
)
@click.option(
    "--from-first", "first", is_flag=True, help="Go from the best configuration of the first iteration to the winner."
)
@click.option(
    "-n",
    "--runs",
    type=click.IntRange(2, 10**6),
    default=30,
    show_default=True,
    help="Number of fresh instances to choose changes on, and of other instances to measure the path on.",
)
@JOBS
@CSV
@plot_of("Draw the path, too.")
@PLUGIN
def ablation(
    directory: Path, start: int | None, first: bool, runs: int, jobs: int | None, as_csv: bool, plot: Path | None
) -> None:
    """Find which parts the winner of DIRECTORY needs: each step removes the least important part.

    States and transitions are removed until only the initial state is left. With --from or --from-first, another
    configuration is changed into the winner instead: each step changes the parameter with the largest gain. The path
    of removals is kept in DIRECTORY, for `mdesign report`.
    """
    if start is not None and first:
        raise click.UsageError("--from and --from-first exclude each other")
    task = restored(directory)
    pool = ThreadExecutor(jobs)
    with Interrupt(then=task.stop) as interrupt, pool as executor, AblationDisplay() as display:
        result = race_ablation(
            directory,
            task,
            executor,
            start=start,
            first=first,
            runs=runs,
            announce=print_message,
            watch=display.update,
            stopped=interrupt.came,
        )
    print_result(ablation_csv(result) if as_csv else ablation_page(result, terminal_width()), nl=False)
    if result.simplifies:
        with writing(directory / ABLATION):
            write_text(directory / ABLATION, ablation_csv(result))
    if plot is not None:
        with writing(plot):
            save_ablation(plot, result, caption=command_line())
