"""All that a study finds: its table, the comparison in the design model, and the gap to other realities."""

from dataclasses import dataclass

from mercator_design.studies.statistics.comparison import Findings, compared
from mercator_design.studies.statistics.reality_gap import RealityGap, reality_gap
from mercator_design.studies.table import StudyTable


@dataclass(frozen=True, kw_only=True)
class StudyResults:
    """A table with its findings: in the design model, or in the first reality if that is not in the table."""

    table: StudyTable
    findings: Findings
    gap: RealityGap


def analysed(table: StudyTable) -> StudyResults:
    """The findings of a table."""
    findings = compared(table, table.realities[0])
    return StudyResults(table=table, findings=findings, gap=reality_gap(table, findings))
