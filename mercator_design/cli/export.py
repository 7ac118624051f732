"""mdesign export: a mission for other programs that design."""

import shlex
from pathlib import Path

import click

from mercator_design.cli.options import JOBS, PLUGIN, SET
from mercator_design.command import tell
from mercator_design.fsm.pfsm import FLAVOURS


@click.group()
def export() -> None:
    """Write a mission as other programs read it."""


@export.command()
@click.argument("mission")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder to write to, new or empty.",
)
@click.option("--budget", type=click.IntRange(1, 10**9), default=5000, show_default=True, help="Experiments to run.")
@click.option(
    "--seed",
    type=click.IntRange(0, 2**31 - 1),
    default=1,
    show_default=True,
    help="Of all randomness; R has no larger.",
)
@JOBS
@click.option(
    "--flavour", type=click.Choice(FLAVOURS), default="watermelon", show_default=True, help="Modules to design with."
)
@SET
@PLUGIN
def irace(
    mission: str, output: Path, budget: int, seed: int, jobs: int | None, flavour: str, overrides: tuple[str, ...]
) -> None:
    """Write MISSION as a scenario of irace's, which R's irace and `mdesign tune` run.

    The command that runs it is printed.
    """
    from mercator_design.design import Designer
    from mercator_design.irace_export import irace_files, write_irace_scenario
    from mercator_design.missions.mission import load_mission
    from mercator_design.race.executors import available_jobs
    from mercator_design.sim.simulate import Simulator

    simulator = Simulator(load_mission(mission, overrides))
    designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour, method="irace")
    designer.prepare(tell)
    write_irace_scenario(output, irace_files(designer, jobs=jobs or available_jobs()))
    for note in designer.race.notes:
        tell(f"Warning: R's irace refuses this: {note}")
    click.echo(f"cd {shlex.quote(str(output))} && irace --scenario scenario.txt")
