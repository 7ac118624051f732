"""mdesign fsm show: a PFSM as a picture, or in another form."""

from collections.abc import Callable, Mapping
from pathlib import Path

import click

from mercator_design.command import FILE, FLAVOUR, LENIENT, OUTPUT_FILE, print_result, read_controller
from mercator_design.fsm.files import FsmFile, fsm_file_text, fsm_yaml_text
from mercator_design.system.files import write_text, writing
from mercator_design.view.diagram import diagram_svg
from mercator_design.view.notations import to_dot, to_mermaid, to_tikz

FORMATS: Mapping[str, Callable[[FsmFile], str]] = {
    "svg": lambda file: diagram_svg(file.pfsm),
    "dot": lambda file: to_dot(file.pfsm),
    "mermaid": lambda file: to_mermaid(file.pfsm, file.names),
    "tikz": lambda file: to_tikz(file.pfsm, file.names),
    "yaml": fsm_yaml_text,
    "text": lambda file: fsm_file_text(file.pfsm, file.header, file.names),
}
_SUFFIXES = {
    ".svg": "svg", ".dot": "dot", ".gv": "dot", ".mmd": "mermaid", ".tex": "tikz", ".yaml": "yaml", ".yml": "yaml",
    ".txt": "text",
}  # fmt: skip


@click.command(short_help="Draw a PFSM, or write it in another form.")
@click.argument("fsm", type=FILE)
@click.option(
    "--format", "form", type=click.Choice(list(FORMATS)), help="The form.  [default: by the suffix of FILE, else svg]"
)
@click.option("-o", "--output", type=OUTPUT_FILE, help="File to write.  [default: stdout]")
@FLAVOUR
@LENIENT
def show(fsm: Path, form: str | None, output: Path | None, flavour: str | None, lenient: bool) -> None:
    """Draw a PFSM as SVG, or write it as Graphviz text, Mermaid, TikZ, fsm.yaml or fsm.txt.

    fsm.yaml and fsm.txt hold the same: `mdesign fsm show fsm.txt -o fsm.yaml` makes one of the other, without loss.
    """
    file = read_controller(fsm, flavour, lenient=lenient)
    if form is None:
        form = "svg" if output is None else _SUFFIXES.get(output.suffix.lower())
    if form is None:
        raise click.UsageError(f"expected --format, or a file that ends in {', '.join(_SUFFIXES)}; found {output}")
    text = FORMATS[form](file)
    if output is None:
        print_result(text, nl=False, exact=True)
    else:
        with writing(output):
            write_text(output, text)
