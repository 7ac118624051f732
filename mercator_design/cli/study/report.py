"""mdesign study report: the page, the tables and the figures of a study."""

import shlex
from pathlib import Path

import click

from mercator_design.cli.options import FOLDER
from mercator_design.cli.terminal import terminal_width, wrapped
from mercator_design.command import print_note, print_result
from mercator_design.show.study.folder import FIGURES, PAGE, TABLES, write_study
from mercator_design.show.study.verdicts import headlines, score_sentences, unfinished_sentence
from mercator_design.studies.reading import read_status, study_table


@click.command()
@click.argument("directory", type=FOLDER)
def report(directory: Path) -> None:
    """Write the page, the tables and the figures of the study in DIRECTORY again.

    They are of all designs that are assessed in all realities so far.
    """
    write_results(directory)


def write_results(folder: Path) -> None:
    """Write what comes out of a study into its folder, and print the answer.

    Raises:
        StudyError: No design is assessed.
        MercatorError: A file cannot be written.
    """
    table, status = study_table(folder), read_status(folder)
    print_note("Report: comparing designs, and drawing the figures ...")
    unfinished = unfinished_sentence(status)
    results = write_study(folder, table, shlex.join(["mdesign", "study", "report", str(folder)]), unfinished)
    if unfinished:
        print_result(unfinished)
    scores = score_sentences(table) if len(table.levels) > 1 else ()
    for sentence in (*headlines(results), *scores):
        print_result(wrapped(sentence, terminal_width()))
    for name, path in (("Report", PAGE), ("Tables", TABLES), ("Figures", FIGURES)):
        print_result(f"{name:<10} {folder / path}")
