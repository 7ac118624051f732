"""mdesign study compare: a study of races that exist."""

from pathlib import Path

import click

from mercator_design.cli.options import FOLDER, JSON
from mercator_design.cli.terminal import command_line, terminal_width, wrapped
from mercator_design.command import print_result
from mercator_design.errors import StudyError
from mercator_design.results.files import JOURNAL
from mercator_design.show.study.folder import PAGE, write_study
from mercator_design.show.study.tables import study_json
from mercator_design.show.study.verdicts import all_sentences
from mercator_design.studies.analysis import analysed
from mercator_design.studies.folder import FACTS
from mercator_design.studies.race_folders import run_folders, table_of_races
from mercator_design.studies.table import COMPARED


@click.command()
@click.argument("directories", type=FOLDER, nargs=-1, required=True, metavar="DIRECTORY...")
@click.option("--by", type=click.Choice(COMPARED), default="method", show_default=True, help="What is compared.")
@click.option("--name", help="Name of the comparison, on its page.  [default: comparison by FACTOR]")
@click.option("-o", "--output", type=FOLDER, help="Write page, tables and figures to this folder.")
@JSON
def compare(directories: tuple[Path, ...], by: str, name: str | None, output: Path | None, as_json: bool) -> None:
    """Compare methods, flavours, budgets or robot models by the winners of races that exist.

    Each DIRECTORY is a run folder, or a folder of run folders, or the folder of a study. The winner of a race, with its
    scores on fresh instances, is one design; races that differ only in their seeds are repetitions. Designs are
    compared where all else is equal: at least two of each are needed, and ten or twenty are usual. Races by several
    objectives are compared by each, and by the hypervolume of their fronts.
    """
    if output is not None and any((output / file).exists() for file in (FACTS, JOURNAL)):
        raise StudyError(f"{output}: expected another folder than that of a study or a race, found one")
    table = table_of_races(name or f"comparison by {by.replace('_', ' ')}", run_folders(directories), by)
    results = analysed(table) if output is None else write_study(output, table, command_line())
    if as_json:
        print_result(study_json(results))
        return
    for sentence in all_sentences(results):
        print_result(wrapped(sentence, terminal_width()))
    if output is not None:
        print_result(f"Report     {output / PAGE}")
