"""mdesign runs map: maps of what a race's elites see."""

import json
from collections import deque
from functools import partial
from itertools import product
from pathlib import Path

import click

from mercator_design.api import fresh_instances
from mercator_design.cli.options import FOLDER, JOBS, JSON, PLUGIN, PROGRESS, seed_of
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import print_note, print_result
from mercator_design.errors import MercatorError
from mercator_design.mapping.trial import MapTrial, map_trial
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software
from mercator_design.race.executors.executor import Failed, available_jobs
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.results.analysis.winners import elites as elites_of
from mercator_design.show.maps.elites import MappedElites
from mercator_design.show.text.progress import Display, Mode
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.simulate import Simulator


@click.command()
@click.argument("directory", type=FOLDER)
@click.option(
    "--elites",
    "most",
    type=click.IntRange(1, 1000),
    default=5,
    show_default=True,
    help="Number of elites of the last iteration, the winner first.",
)
@click.option(
    "-n", "--runs", type=click.IntRange(1, 10**4), default=5, show_default=True, help="Number of fresh instances."
)
@click.option("--robot-model", metavar="NAME|FILE", help="Robots to map with.  [default: those of the race]")
@click.option("--known-starts", is_flag=True, help="Tell the mapper where the robots begin.")
@seed_of("Seed of the fresh instances.")
@JOBS
@JSON
@PLUGIN
@PROGRESS
def map(  # noqa: A001 - the verb's name
    directory: Path,
    most: int,
    runs: int,
    robot_model: str | None,
    known_starts: bool,
    seed: int,
    jobs: int | None,
    as_json: bool,
    progress: Mode,
) -> None:
    """Simulate the elites of the race of DIRECTORY on fresh instances, map each one's logs, and compare the maps.

    The objective of a race is fast, and need not see what makes a map good. Here each experiment has the lidars' turns
    and the odometry with its drift (--robot-model mercator-drifting), and is mapped as by `mdesign map`. The table has
    the objective's mean score, the mean F1 of occupied cells with its standard deviation, the share of the walls in
    the map, the error of the robots' places and headings, how many maps a run gave, and the p-value of the paired
    t-test of F1 with the best, with Holm's correction.
    """
    software, simulator = elites_of(directory, most)
    if robot_model is not None:
        simulator = Simulator(simulator.mission, load_robot_model(robot_model))
    rehearsal = simulator.rehearse(announce=print_note)
    if not len(rehearsal.scene.lidar.outlines):
        raise MercatorError(
            f"{simulator.mission.name}: expected walls that are higher than the robots' lidars, or boxes, found none; "
            "there is nothing to map"
        )
    seeds = fresh_instances(seed, runs)
    trials = _trials(simulator, software, seeds, jobs, progress, known_starts=known_starts)
    found = MappedElites(software, trials, seeds, simulator.mission, simulator.robot_model)
    print_result(json.dumps(found.data(seed=seed), allow_nan=False) if as_json else found.table(seed=seed))


def _trials(
    simulator: Simulator,
    software: dict[int, Software],
    seeds: list[int],
    jobs: int | None,
    progress: Mode,
    *,
    known_starts: bool,
) -> dict[int, list[MapTrial]]:
    """The trials of each elite, in the order of the seeds.

    Raises:
        MercatorError: An experiment failed.
    """
    items = list(product(software, seeds))
    one = partial(_trial, simulator.mission, simulator.robot_model, software, known_starts)
    found: dict[int, MapTrial] = {}
    with (
        Interrupt() as interrupt,
        ProcessExecutor(min(jobs or available_jobs(), len(items))) as executor,
        Display(f"{simulator.mission.name}: mapping", len(items), progress) as display,
    ):
        for position, result in executor.run(one, items):
            if isinstance(result, Failed):
                number, at = items[position]
                raise MercatorError(f"elite {number}, seed {at}: {result.reason}")
            found[position] = result
            display.show(len(found))
            interrupt.check(f"{len(found)} of {len(items)} experiments were mapped")
    ordered = deque(found[position] for position in range(len(items)))
    return {number: [ordered.popleft() for _ in seeds] for number in software}


def _trial(
    mission: Mission, robot_model: RobotModel, software: dict[int, Software], known_starts: bool, item: tuple[int, int]
) -> MapTrial:
    """The trial of an elite on an instance; in a worker."""
    number, seed = item
    return map_trial(Simulator(mission, robot_model), software[number], seed, known_starts=known_starts)
