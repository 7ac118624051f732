"""mdesign study report: the page and the tables of a study."""

from pathlib import Path

import click

from mercator_design.cli.options import FOLDER
from mercator_design.command import print_result
from mercator_design.errors import StudyError
from mercator_design.study.reading import study_table
from mercator_design.system.files import write_text, writing


@click.command()
@click.argument("directory", type=FOLDER)
def report(directory: Path) -> None:
    """Write the page and the tables of the study in DIRECTORY again, of all designs that are assessed so far."""
    write_results(directory)


def write_results(folder: Path) -> None:
    """Write what comes out of a study into its folder.

    Raises:
        StudyError: No design is assessed, or a file cannot be written.
    """
    table = study_table(folder)
    tables = folder / "tables"
    with writing(tables, StudyError):
        tables.mkdir(exist_ok=True)
        for name, rows in (("runs", table.runs), ("designs", table.designs)):
            write_text(tables / f"{name}.csv", rows.to_csv(index=False))
    print_result(f"Tables     {tables}")
