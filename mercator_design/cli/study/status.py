"""mdesign study status: how far a study is."""

import json
from pathlib import Path

import click

from mercator_design.cli.options import FOLDER, JSON
from mercator_design.cli.study.texts import status_data, status_text
from mercator_design.command import print_result
from mercator_design.studies.folder import read_facts
from mercator_design.studies.reading import read_status


@click.command()
@click.argument("directory", type=FOLDER)
@JSON
def status(directory: Path, as_json: bool) -> None:
    """Show how far the study in DIRECTORY is, whatever processes run it.

    \b
    With --json: name, cells, counts (by state: done, to assess, running,
    interrupted, to run), experiments, done, designs (mission, method,
    budget, repetition, state, done, total).
    """  # noqa: D301 - click reads the control character
    found = read_status(directory)
    print_result(json.dumps(status_data(found)) if as_json else status_text(found, read_facts(directory).layout))
