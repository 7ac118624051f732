"""Findings as people see them."""

from collections.abc import Iterable

import click

from mercator_design.errors import RobotError, printable
from mercator_design.robot.findings import Finding


def show(findings: Iterable[Finding]) -> None:
    """Print a row for each, as soon as it is there.

    Raises:
        RobotError: in the end, if something is wrong.
    """
    wrong = 0
    for finding in findings:
        wrong += not finding.is_fine
        click.echo(printable(f"{'ok   ' if finding.is_fine else 'WRONG'}  {finding.what:<26} {finding.words}"))
    if wrong:
        raise RobotError(f"{wrong} wrong")
