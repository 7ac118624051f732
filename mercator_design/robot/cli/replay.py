"""mercator-robot replay: show and check the decisions of a run, from its log."""

import math
from pathlib import Path

import click

from mercator_design.command import FILE, FLAVOUR, print_message, print_result
from mercator_design.errors import RobotError
from mercator_design.modules.architecture import Software
from mercator_design.modules.conditions import ground_level
from mercator_design.robot.logs.log import Decision
from mercator_design.robot.logs.log import replay as decisions
from mercator_design.software.architectures import part_names


@click.command()
@click.argument("log", type=FILE)
@FLAVOUR
def replay(log: Path, flavour: str | None) -> None:  # noqa: ARG001 - it is loaded by now
    """Show the decision of every cycle of a run, from its log, which may still be written.

    The controller runs again on the readings and draws in the log; exit code 1 if a decision differs. Prints a
    warning if the log has no end. Plugins, and a flavour that is not shipped, are given as for the run.
    """
    found = [*map(_show, decisions(log, lambda warning: print_message(f"{log}: {warning}")))]
    if differing := [*filter(None, found)]:
        raise RobotError(f"{log}: {differing[0]}; {len(differing)} of {len(found)} cycles differ")
    print_message(f"{len(found)} cycles, all decided the same")


def _show(decided: tuple[Software, Decision]) -> str:
    """Print a decision; return how it differs from the log, if it does."""
    software, decision = decided
    readings, part = decision.readings, part_names(software)[decision.state]
    moved = f"  -> {decision.next_state} ({decision.condition})" if decision.next_state != decision.state else ""
    obstacle = math.hypot(readings.proximity_x, readings.proximity_y)
    print_result(
        f"{decision.cycle:6d} {decision.time:9.3f} s  state {decision.state} {part:<14} "
        f"obstacle {obstacle:4.2f}  neighbours {readings.neighbours:2.0f}  ground {ground_level(readings):5.1f}  "
        f"wheels {decision.actions.left:5.2f} {decision.actions.right:5.2f}{moved}"
    )
    return f"cycle {decision.cycle}: {decision.differs}" if decision.differs else ""
