"""Findings as rows of a table."""

from collections.abc import Iterable

from mercator_design.command import print_result
from mercator_design.errors import RobotError, printable
from mercator_design.robot.devices.findings import Finding


def show(findings: Iterable[Finding]) -> None:
    """Print a row for each finding as it comes; go on if a row cannot be written.

    Raises:
        OSError: in the end, if a row was not written.
        RobotError: in the end, if there is a fault.
    """
    wrong, unwritten = 0, None
    for finding in findings:
        wrong += not finding.is_fine
        mark = ("look " if finding.is_unclear else "ok   ") if finding.is_fine else "WRONG"
        row = f"{mark}  {finding.what:<26} {finding.words}"
        try:
            print_result(printable(row))
        except OSError as error:
            unwritten = error
    if unwritten is not None:
        raise unwritten
    if wrong:
        raise RobotError(f"{wrong} wrong")
