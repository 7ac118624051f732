"""The files of a study: its page, tables and figures in a folder."""

from pathlib import Path

from mercator_design.show.study.figures import save_figures
from mercator_design.show.study.origin import what_was_run
from mercator_design.show.study.page import study_page
from mercator_design.show.study.tables import comparisons_csv, comparisons_latex, scores_latex, study_json
from mercator_design.studies.analysis import StudyResults, analysed
from mercator_design.studies.folder import FACTS
from mercator_design.studies.table import RUN_COLUMNS, StudyTable
from mercator_design.system.files import write_text, writing

PAGE, TABLES, FIGURES = "report.html", "tables", "figures"


def write_study(folder: Path, table: StudyTable, command: str, unfinished: str = "") -> StudyResults:
    """Analyse a study and write its page, tables and figures to a folder, which is made.

    Args:
        folder: The folder of the study; or another one, whose page then has no plan.
        table: Its results.
        command: The command that makes the files, for the page.
        unfinished: The sentence on a study that is not done, for the page; empty if it is done.

    Raises:
        MercatorError: The study's plan is damaged, or a file cannot be written.
    """
    results = analysed(table)
    runs = table.runs if len(table.runs) else table.runs.reindex(columns=[*RUN_COLUMNS])
    texts = {
        f"{TABLES}/runs.csv": runs.to_csv(index=False, lineterminator="\n"),
        f"{TABLES}/designs.csv": table.designs.to_csv(index=False, lineterminator="\n"),
        f"{TABLES}/comparisons.csv": comparisons_csv(results),
        f"{TABLES}/study.json": study_json(results),
        f"{TABLES}/scores.tex": scores_latex(table),
        f"{TABLES}/comparisons.tex": comparisons_latex(results),
        PAGE: study_page(results, command, what_was_run(folder) if (folder / FACTS).exists() else "", unfinished),
    }
    if len(table.fronts):
        texts[f"{TABLES}/fronts.csv"] = table.fronts.to_csv(index=False, lineterminator="\n")
    with writing(folder):
        for name in (TABLES, FIGURES):
            (folder / name).mkdir(parents=True, exist_ok=True)
        save_figures(folder / FIGURES, results)
        for name, text in texts.items():
            write_text(folder / name, text)
    return results
