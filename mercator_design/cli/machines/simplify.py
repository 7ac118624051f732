"""mdesign fsm simplify: removes what does not matter from a PFSM."""

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import click

from mercator_design.cli.inputs import Given, simulator_of, warn_of_mission
from mercator_design.cli.options import FLAVOUR, JOBS, MISSION, ROBOT_MODEL, SEED, SET
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import (
    FILE,
    OUTPUT_FILE,
    NumberRange,
    print_message,
    print_result,
    read_controller,
)
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.words.names import state_names
from mercator_design.race.executors.executor import in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis.simplification import SHARE
from mercator_design.results.analysis.simplification import simplify as simplified
from mercator_design.seeds import instance_seed
from mercator_design.show.text.progress import Display
from mercator_design.show.text.simplification import evidence, simplification_page
from mercator_design.sim.checks.no_effect import dead_transitions
from mercator_design.software.files import FsmFile, fsm_file_text, fsm_yaml_text
from mercator_design.system.files import write_text, writing

_OF_THE_ORIGINAL = {"score", "spread", "score in the race", "configuration"}
"""Entries of a header that are not true of a simpler PFSM."""


@click.command()
@click.argument("fsm", type=FILE)
@click.option("-o", "--output", type=OUTPUT_FILE, required=True, help="File to write: fsm.yaml if it ends in .yaml.")
@MISSION
@click.option(
    "-n",
    "--runs",
    type=click.IntRange(2, 10**5),
    default=100,
    show_default=True,
    help="Instances to choose removals on, and as many others to test them on.",
)
@click.option(
    "--margin",
    type=NumberRange(min=0.0),
    metavar="SCORE",
    help=f"By how much the mean score may be worse.  [default: {SHARE:.0%} of the mean]",
)
@SEED
@JOBS
@ROBOT_MODEL
@FLAVOUR
@SET
def simplify(
    fsm: Path,
    output: Path,
    runs: int,
    margin: float | None,
    seed: int,
    jobs: int | None,
    flavour: str | None,
    **given: Unpack[Given],
) -> None:
    """Remove states and transitions of a PFSM that are shown not to matter on a mission.

    What never fires and what cannot be reached goes without a test. Then, in each step, the state or transition goes
    whose removal is least likely to make the score worse by the margin, on some instances. On others, the simpler PFSMs
    are compared with FSM, in the order of the steps: the first that may be worse by the margin or more ends the removal
    (paired t-tests of non-inferiority; the probability of a wrong removal is 0.05 at most).

    The header of the written file has the evidence. With the same seed, the result is the same.
    """
    file = read_controller(fsm, flavour, lenient=False)
    simulator = simulator_of(fsm, file, given)
    warn_of_mission(simulator, refuse=False)
    simulator.check(file.pfsm)
    simulator.rehearse(announce=print_message)
    loaded = simulator.mission

    def score_of(item: tuple[Pfsm, int]) -> float:
        pfsm, instance = item
        return simulator.run(pfsm, instance_seed(seed, "simplification", instance)).score

    with Interrupt() as interrupt, ThreadExecutor(jobs) as executor:

        def measure(pfsms: Sequence[Pfsm], instances: range, what: str) -> list[list[float]]:
            items = [(pfsm, instance) for pfsm in pfsms for instance in instances]
            print_message(f"{loaded.name}: {what}: {len(items)} experiments")
            with Display(f"{loaded.name}: {what}", len(items)) as display:

                def watch(done: int) -> None:
                    display.show(done)
                    interrupt.check("nothing was written")

                costs = [loaded.cost(score) for score in in_order(executor, score_of, items, watch)]
            return [costs[k : k + len(instances)] for k in range(0, len(costs), len(instances))]

        dead = frozenset(dead_transitions(loaded, simulator.robot_model, file.pfsm))
        found = simplified(file.pfsm, measure, runs=runs, dead=dead, margin=margin)
    header = {key: value for key, value in file.header.items() if key not in _OF_THE_ORIGINAL}
    header |= evidence(found, loaded.score, mission=loaded.name, seed=seed)
    usual = file.names == state_names(file.pfsm)
    names = () if usual else tuple(file.names[i] for i in found.kept_states)
    simpler = FsmFile(software=found.simpler, header=header, names=names)
    is_yaml = output.suffix.lower() in {".yaml", ".yml"}
    text = fsm_yaml_text(simpler) if is_yaml else fsm_file_text(simpler.pfsm, simpler.header, simpler.names)
    with writing(output):
        write_text(output, text)
    print_result(simplification_page(found, loaded.score), nl=False)
