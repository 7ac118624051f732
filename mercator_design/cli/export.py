"""mdesign export: missions, races and logs of robots, for other programs."""

import io
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

import click

from mercator_design.cli.inputs import check_apart, warn_of_mission
from mercator_design.cli.options import FOLDER, JOBS, PLUGIN, SET, design_flavour, seed_of
from mercator_design.command import FILE, OUTPUT_FILE, print_message, print_result, warn
from mercator_design.designer import Designer
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.executor import available_jobs
from mercator_design.results.files import read_journal, task_of
from mercator_design.show.files.irace_log import write_irace_log
from mercator_design.show.files.irace_scenario import write_irace_scenario
from mercator_design.show.files.robot_log_table import write_csv
from mercator_design.show.files.robot_logs import write_mcap
from mercator_design.sim.simulate import Simulator
from mercator_design.system.files import replacing, writing


@click.group()
def export() -> None:
    """Write a mission, a race or the log of a robot in the formats of other programs."""


@export.command(short_help="Write a mission as a scenario of irace.")
@click.argument("mission")
@click.option("-o", "--output", type=FOLDER, required=True, help="Folder to write to, new or empty.")
@click.option("--budget", type=click.IntRange(1, 10**9), default=5000, show_default=True, help="Experiments to run.")
@seed_of("Master seed of all randomness, at most R's largest integer.", 2**31 - 1)
@JOBS
@design_flavour
@SET
@PLUGIN
def irace(
    mission: str, output: Path, budget: int, seed: int, jobs: int | None, flavour: str, overrides: tuple[str, ...]
) -> None:
    """Write MISSION as a scenario of irace, for R's irace and `mdesign tune`.

    Prints the command that runs it.
    """
    simulator = Simulator(load_mission(mission, overrides))
    warn_of_mission(simulator, refuse=True)
    designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour, method="irace")
    designer.prepare(print_message)
    write_irace_scenario(output, designer, jobs=jobs or available_jobs())
    for note in designer.optimizer.notes:
        warn(f"R's irace refuses this scenario: {note}")
    print_result(f"cd {shlex.quote(str(output))} && irace --scenario scenario.txt")


@export.command("irace-log", short_help="Write a race as a log of irace, for R.")
@click.argument("directory", type=FOLDER)
@click.option("-o", "--output", type=OUTPUT_FILE, help="File to write.  [default: irace.Rdata in DIRECTORY]")
def irace_log(directory: Path, output: Path | None) -> None:
    """Write the race of DIRECTORY as a log of irace, for irace's functions and iraceplot in R.

    The race may be running. It may be of a mission or of a program. In R: irace::read_logfile("irace.Rdata").
    """
    file = output or directory / "irace.Rdata"
    record = read_journal(directory).record
    write_irace_log(file, task_of(directory), record)
    print_message(f"{file}: {len(record.configurations)} configurations, {len(record.experiments)} experiments")


@export.command(short_help="Write logs of robots as a table.")
@click.argument("logs", type=FILE, nargs=-1, required=True, metavar="LOG...")
@click.option("-o", "--output", type=FILE, required=True, help="File to write; - for stdout.")
def csv(logs: tuple[Path, ...], output: Path) -> None:
    """Write LOGs, of runs or of recordings of mercator-robot, as one table for pandas, R and spreadsheets.

    docs/reference/robot-logs.md describes the columns. Rows of several robots are in the order of a common clock if
    `mdesign deploy --start` started them. A log may still be growing: it is exported up to its last line.
    """
    write = partial(write_csv, logs, warn=warn)
    if output != Path("-"):
        _write(logs, output, write)
    elif sys.stdout.isatty():
        table = io.BytesIO()
        _write(logs, output, write, stdout=table)
        print_result(table.getvalue().decode(), nl=False)
    else:
        _write(logs, output, write, stdout=sys.stdout.buffer)


@export.command(short_help="Write the log of a robot for Foxglove.")
@click.argument("log", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="File to write.")
def mcap(log: Path, output: Path) -> None:
    """Write LOG, of a run or a recording of mercator-robot, as MCAP, which Foxglove shows and plots.

    docs/reference/robot-logs.md describes the channels. A log may still be growing: it is exported up to its last line.
    """
    if output == Path("-"):
        raise click.BadParameter("expected a file, as MCAP has its index at the end", param_hint="-o")
    _write([log], output, lambda file: [write_mcap(log, file)])


def _write(
    logs: Sequence[Path],
    output: Path,
    write: Callable[[BinaryIO], list[str]],
    stdout: BinaryIO | None = None,
) -> None:
    check_apart(output, logs)
    if stdout is not None:
        summaries = write(stdout)
    else:
        with writing(output), replacing(output) as file:
            summaries = write(file)
    for log, summary in zip(logs, summaries, strict=True):
        print_message(f"{output}: {f'{log}: ' if len(logs) > 1 else ''}{summary}")
