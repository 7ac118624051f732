"""mdesign deploy: control software on many robots."""

from collections.abc import Iterable
from pathlib import Path

import click

from mercator_design.command import (
    FILE,
    FLAVOUR,
    LENIENT,
    NumberRange,
    naming_header,
    print_message,
    print_result,
    read_controller,
)
from mercator_design.errors import RobotError, printable
from mercator_design.fleet import deploy as do
from mercator_design.fleet.check import check, table, unclear, wrong
from mercator_design.fleet.deploy import Fleet, RobotOutcome
from mercator_design.fleet.start import start
from mercator_design.fsm import ReferenceModel
from mercator_design.modules.flavour import flavour_of
from mercator_design.robot.cli.options import WITHOUT
from mercator_design.robot.devices.settings import CONTROL_PERIOD, control_period_of, reference_model_of
from mercator_design.robot.run.senses import why_device_is_needed
from mercator_design.software.files import FsmFile
from mercator_design.software.needed import FLAVOUR_FILE, PLUGINS, module_plugins, needed_files


@click.command()
@click.argument("fsm", type=FILE, required=False)
@click.option("--robots", type=FILE, required=True, metavar="ROBOTS.yaml", help="Addresses of the robots.")
@click.option("--check", is_flag=True, help="Check the robots: batteries, lines, clocks; also before a start.")
@click.option(
    "--start", is_flag=True, help="Run FSM on all robots together, if all earlier steps succeeded on all robots."
)
@click.option("--duration", type=NumberRange(0.1, 1e6), metavar="SECONDS", help="Duration of the run.")
@click.option("--dry-run", is_flag=True, help="Run without turning the wheels.")
@WITHOUT
@FLAVOUR
@LENIENT
@click.option("--stop", is_flag=True, help="Stop the runs on the robots instead of copying FSM.")
@click.option(
    "--collect",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Copy the logs of each robot to a folder of its name in DIR; instead of copying FSM, or after that.",
)
@click.option(
    "--timeout",
    type=NumberRange(1.0, 3600.0),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="Time limit of each connection, and for robots to be ready.",
)
def deploy(
    fsm: Path | None,
    robots: Path,
    check: bool,
    start: bool,
    duration: float | None,
    dry_run: bool,
    without: tuple[str, ...],
    flavour: str | None,
    lenient: bool,
    stop: bool,
    collect: Path | None,
    timeout: float,
) -> None:
    """Copy FSM, and the file that `mdesign bundle` makes, to robots over ssh; check, start and stop them, collect logs.

    All robots start within one control cycle. If one cannot start, the others do not, or are stopped within a second.
    Prints a row for each robot.

    Exit codes: 1, something failed on a robot; 3, FSM or ROBOTS.yaml is invalid.
    """
    ends = stop or collect is not None
    if (fsm is not None or check) == ends:
        raise click.UsageError("expected FSM or --check, or --stop or --collect")
    if (start and fsm is None) or ((duration is not None or dry_run) and not start):
        raise click.UsageError("--start needs FSM; --duration and --dry-run need --start")
    if fsm is None and (flavour is not None or lenient):
        raise click.UsageError("--flavour and --lenient need FSM")
    if without and not (start or check):
        raise click.UsageError("--without needs --start or --check")

    fleet = do.read_fleet(robots)
    results = []
    cycle, needed = CONTROL_PERIOD, dict[str, bytes]()
    if fsm is not None:
        file = read_controller(fsm, flavour, lenient=lenient)
        with naming_header(fsm):
            cycle = control_period_of(file.header)
            _refuse_what_is_needed(without, file)
        needed = needed_files(flavour_of(file.software.flavour))
    if not ends:
        files = {} if fsm is None else {do.FSM: fsm.read_bytes(), **needed}
        results += _shown(do.copy(fleet, files, timeout))
    left_out = [f"--without={device}" for device in without]
    if check and all(each.is_done for each in results):
        _check(fleet, timeout, left_out)
    if start and all(each.is_done for each in results):
        own = FLAVOUR_FILE if FLAVOUR_FILE in needed else flavour
        given = {"duration": duration, "flavour": own if flavour is not None else None}
        options = [f"--{name}={value}" for name, value in given.items() if value is not None]
        options += ["--dry-run"] * dry_run + ["--lenient"] * lenient + left_out
        options += [f"--plugin={PLUGINS}/{plugin.name}" for plugin in module_plugins(flavour_of(file.software.flavour))]
        _start(fleet, options, timeout, cycle)
    if stop:
        results += _shown(do.stop(fleet, timeout))
    if collect is not None:
        results += _shown(do.collect(fleet, collect, timeout))
    failed = {each.robot.name for each in results if not each.is_done}
    if failed:
        raise RobotError(f"{len(failed)} of {len(fleet.robots)} robots failed")


def _refuse_what_is_needed(without: Iterable[str], file: FsmFile) -> None:
    """Refuse to leave out devices that the PFSM needs; a robot whose own settings need one refuses itself."""
    model = reference_model_of(file.header, ReferenceModel())
    for device in without:
        if why := why_device_is_needed(device, file.software.reads, model):
            raise click.UsageError(f"--without {device}: {why}")


def _check(fleet: Fleet, timeout: float, options: list[str]) -> None:
    checked = check(fleet, timeout, options)
    for row in table(checked):
        print_result(printable(row))
    for row in wrong(checked):
        print_result(f"WRONG  {printable(row)}")
    for row in unclear(checked):
        print_result(f"look   {printable(row)}")
    if names := {each.robot.name for each in checked if [*wrong([each])]}:
        raise RobotError(f"{len(names)} of {len(checked)} robots failed the check")


def _start(fleet: Fleet, options: list[str], timeout: float, cycle: float) -> None:
    started = start(fleet, options, timeout, cycle)
    _shown(started.results)
    if started.why:
        raise RobotError(f"no robot runs: {started.why}")
    if len(started.results) > 1:
        spread, uncertainty = 1000.0 * started.spread, 1000.0 * started.uncertainty
        print_message(f"All {len(started.results)} began within {spread:.1f} ms, give or take {uncertainty:.1f} ms")


def _shown(results: list[RobotOutcome]) -> list[RobotOutcome]:
    for each in results:
        row = f"{'ok    ' if each.is_done else 'FAILED'}  {each.robot.name:<16} {each.words}"
        print_result(printable(row))
    return results
