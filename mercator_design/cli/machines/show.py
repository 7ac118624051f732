"""mdesign fsm show: a PFSM as a picture, or in another form."""

import shlex
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import click

from mercator_design.cli.machines.swarm import swarm_of
from mercator_design.command import (
    FLAVOUR,
    FSM,
    LENIENT,
    OUTPUT_FILE,
    lack_of_designer,
    print_result,
    read_controller,
)
from mercator_design.modules.words import robots_words
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.machines.picture import NOTATIONS, notation_text, software_svg
from mercator_design.software.files import FsmFile, fsm_file_text, fsm_yaml_text
from mercator_design.system.files import write_text, writing

_RUNS, _SEED = 10, 1


def _in_notation(notation: str, file: FsmFile) -> str:
    return notation_text(notation, file.software, file.names)


_FORMATS: Mapping[str, Callable[[FsmFile], str]] = {
    **{one: partial(_in_notation, one) for known in NOTATIONS.values() for one in known},
    "yaml": fsm_yaml_text,
    "text": lambda file: fsm_file_text(file.software, file.header, file.names),
}
_SUFFIXES = {
    ".svg": "svg", ".dot": "dot", ".gv": "dot", ".mmd": "mermaid", ".tex": "tikz", ".yaml": "yaml", ".yml": "yaml",
    ".txt": "text", ".genome": "genome",
}  # fmt: skip


@click.command()
@click.argument("fsm", type=FSM)
@click.option(
    "--format",
    "form",
    type=click.Choice(["svg", *_FORMATS]),
    help="The form.  [default: by the suffix of FILE, else svg]",
)
@click.option("-o", "--output", type=OUTPUT_FILE, help="File to write.  [default: stdout]")
@click.option("--mission", help="Mission on which to measure what robots do in each state. YAML file or shipped name.")
@click.option("-n", "--runs", type=click.IntRange(1, 10**6), help=f"Experiments to measure.  [default: {_RUNS}]")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), help=f"Seed of these experiments.  [default: {_SEED}]")
@FLAVOUR
@LENIENT
def show(
    fsm: Path,
    form: str | None,
    output: Path | None,
    mission: str | None,
    runs: int | None,
    seed: int | None,
    flavour: str | None,
    lenient: bool,
) -> None:
    """Draw a PFSM as SVG, or write it as Graphviz text, Mermaid, TikZ, fsm.yaml or fsm.txt.

    fsm.yaml and fsm.txt hold the same: `mdesign fsm show fsm.txt -o fsm.yaml` makes one of the other, without loss.
    A behaviour tree has the same forms but fsm.yaml. A network is drawn, or written as fsm.txt or a genome (NEAT's
    file).

    With --mission, the picture of a PFSM has the share of time that robots are in each state, and how often each of
    them changes from one state to another, in experiments on fresh instances.
    """
    file = read_controller(fsm, flavour, lenient=lenient)
    if form is None:
        form = "svg" if output is None else _SUFFIXES.get(output.suffix.lower())
    if form is None:
        raise click.UsageError(f"expected --format, or a file that ends in {', '.join(_SUFFIXES)}; found {output}")
    if mission is not None and form != "svg":
        raise click.UsageError("--mission needs --format svg")
    if mission is None and (runs is not None or seed is not None):
        raise click.UsageError("--runs and --seed need --mission")
    if form != "svg":
        text = _FORMATS[form](file)
    elif mission is None:
        robots = swarm_of(fsm, file).robots if "neighbours" in file.software.reads else None
        about = [] if robots is None else [robots_words(robots)]
        text = software_svg(file.software, file.names, caption=[*about, f"mdesign fsm show {shlex.quote(str(fsm))}"])
    else:
        text = _measured(fsm, file, mission, runs or _RUNS, _SEED if seed is None else seed)
    if output is None:
        print_result(text, nl=False, exact=True)
    else:
        with writing(output):
            write_text(output, text)


def _measured(fsm: Path, file: FsmFile, mission: str, runs: int, seed: int) -> str:
    """The picture with the occupancy measured on a mission."""
    try:
        from mercator_design.cli.machines.measure import measured
    except ModuleNotFoundError as error:
        raise lack_of_designer("--mission", error) from None
    found, experiments = measured(fsm, file, mission, runs, seed)
    words = ["mdesign", "fsm", "show", str(fsm), "--mission", mission, "--runs", str(runs), "--seed", str(seed)]
    meaning = "% of time: of all robots; per s: how often a robot changes to the next state"
    return diagram_svg(file.pfsm, file.names, measured=found, caption=[experiments, meaning, shlex.join(words)])
