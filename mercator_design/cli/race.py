"""mdesign race: a mission becomes a controller."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mercator_design.cli.options import JOBS, PLUGIN, SEED, SET
from mercator_design.cli.terminal import Interrupt, tell, warn_of_doubts
from mercator_design.fsm.pfsm import FLAVOURS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mercator_design.design import Finished


@click.command()
@click.argument("mission")
@click.option(
    "--budget", type=click.IntRange(1, 10**9), required=True, help="Experiments that may be run; at least 30."
)
@SEED
@JOBS
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results, new or empty.  [default: the next free runs/MISSION-N]",
)
@click.option(
    "--flavour",
    type=click.Choice(FLAVOURS),
    default="watermelon",
    show_default=True,
    help="Modules to design with.",
)
@SET
@PLUGIN
def race(
    mission: str,
    budget: int,
    seed: int,
    jobs: int | None,
    output: Path | None,
    flavour: str,
    overrides: tuple[str, ...],
) -> None:
    """Design control software for MISSION by iterated F-race.

    MISSION is a YAML file or the name of a shipped mission (see `mdesign missions`). The winner is written to
    fsm.txt in the results' folder, and a summary to stdout.
    """
    from mercator_design.design import Designer
    from mercator_design.fsm.conditions import CONDITIONS
    from mercator_design.fsm.modules import numbered
    from mercator_design.missions.mission import load_mission
    from mercator_design.race.executors import available_jobs
    from mercator_design.report.progress import RaceDisplay
    from mercator_design.report.summary import race_summary
    from mercator_design.run_folder import RunFolder
    from mercator_design.sim.simulate import Simulator

    simulator = Simulator(load_mission(mission, overrides))
    designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour)
    warn_of_doubts(simulator, flavour, ((flavour, module) for module in numbered(CONDITIONS, flavour).values()))
    simulator.rehearse(announce=tell)
    jobs = jobs or available_jobs()
    path = output or _free_folder(simulator.mission.name)
    request = {"mission": mission, "set": list(overrides), "flavour": flavour, "jobs": jobs}
    with RunFolder(path, designer, request=request) as folder:
        with Interrupt() as interrupt, RaceDisplay(designer) as display:

            def watch(finished: "Sequence[Finished]") -> None:
                folder.note(finished)
                display.update(finished[-1].experiment + 1)
                interrupt.check(f"{path}: the experiments so far are in journal.jsonl")

            result = designer.run(jobs=jobs, watch=watch)
        summary = race_summary(result, designer, seconds=display.seconds, jobs=jobs, folder=path)
        try:
            folder.finish(result, seconds=round(display.seconds, 3))
        finally:
            click.echo(summary, nl=False)


def _free_folder(mission: str) -> Path:
    """The first of runs/MISSION-1, -2, ... that did not exist; it does now."""
    number = 1
    while True:
        folder = Path("runs") / f"{mission}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        else:
            return folder
