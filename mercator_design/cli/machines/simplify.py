"""mdesign fsm simplify: removes what does not matter from a PFSM, and what has no effect from a behaviour tree."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Unpack

import click

from mercator_design.cli.inputs import Given, simulator_of, warn_of_mission
from mercator_design.cli.options import FLAVOUR, JOBS, MISSION, ROBOT_MODEL, SEED, SET
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import (
    FSM,
    OUTPUT_FILE,
    NumberRange,
    print_message,
    print_result,
    read_controller,
)
from mercator_design.errors import FsmError, MissionError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.words.names import state_names
from mercator_design.race.executors.executor import in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis.simplification import SHARE
from mercator_design.results.analysis.simplification import simplify as simplified
from mercator_design.seeds import instance_seed
from mercator_design.show.text.progress import Display
from mercator_design.show.text.simplification import evidence, simplification_page
from mercator_design.sim.checks.no_effect import can_fire, dead_transitions
from mercator_design.software.architectures import architecture_of, text_of
from mercator_design.software.files import FsmFile, fsm_file_text, fsm_yaml_text
from mercator_design.system.files import write_text, writing
from mercator_design.tree.space.grammar import shape_of
from mercator_design.tree.space.structure import canonical
from mercator_design.tree.tree import Tree
from mercator_design.tree.words.difference import difference

_YAML = {".yaml", ".yml"}
_OF_THE_ORIGINAL = {"score", "spread", "score in the race", "configuration"}
"""Entries of a header that are not true of a simpler PFSM."""


@click.command()
@click.argument("fsm", type=FSM)
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

    A behaviour tree of the shape that races design is only brought into its canonical form: without conditions that
    cannot succeed, on its mission if one is known, and without branches that are never reached. Nothing is run. Other
    trees, and networks, are refused.

    The header of the written file has the evidence. With the same seed, the result is the same.
    """
    file = read_controller(fsm, flavour, lenient=False)
    if isinstance(file.software, Tree):
        _simplify_tree(fsm, file, file.software, output, given)
        return
    if not isinstance(file.software, Pfsm):
        noun = architecture_of(file.software.flavour).noun
        raise FsmError(f"{fsm}: expected a PFSM or a behaviour tree, found a {noun}, which has no states to remove")
    simulator = simulator_of(fsm, file, given)
    warn_of_mission(simulator, refuse=False)
    simulator.check(file.pfsm)
    simulator.rehearse(announce=print_message)
    loaded = simulator.mission
    if loaded.is_ranked_by_all:
        raise MissionError(f"{loaded.name}: a simpler PFSM is tested by one score: give the objectives weights")

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
    is_yaml = output.suffix.lower() in _YAML
    text = fsm_yaml_text(simpler) if is_yaml else fsm_file_text(simpler.pfsm, simpler.header, simpler.names)
    with writing(output):
        write_text(output, text)
    print_result(simplification_page(found, loaded.score), nl=False)


def _simplify_tree(fsm: Path, file: FsmFile, tree: Tree, output: Path, given: Given) -> None:
    """Write the canonical form of a tree, and print how it differs."""
    if output.suffix.lower() in _YAML:
        raise click.UsageError("fsm.yaml is a form of PFSMs: give a name that ends in .txt")
    if shape_of(tree) is None:
        expected = "expected a sequence* of branches, each a selector of conditions and an action with p = 0"
        raise FsmError(f"{fsm}: {expected}; other behaviour trees have no canonical form")
    if given["mission"] is None and "mission" not in file.header:
        found = canonical(tree)
    else:
        simulator = simulator_of(fsm, file, given)
        model = simulator.robot_model.with_flavour(tree.flavour)
        found = canonical(tree, partial(can_fire, simulator.mission, model))
    header = {key: value for key, value in file.header.items() if key not in _OF_THE_ORIGINAL}
    header |= {"simplified from": text_of(tree), "simplified": "to its canonical form"}
    with writing(output):
        write_text(output, fsm_file_text(found, header))
    changes = difference(tree, found).changes
    print_result("\n".join([*(changes or ["it is in its canonical form"]), text_of(found)]))
