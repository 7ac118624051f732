"""mercator-robot run: run a PFSM on the robot."""

import secrets
from pathlib import Path

import click

from mercator_design.command import FILE, FLAVOUR, LENIENT, OutputFile, naming_header, print_message, read_controller
from mercator_design.robot.cli.options import DURATION, ROBOT, SEED, WITHOUT, naming_in_the_end, new_file
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.run.joint import AwaitedStart, ImmediateStart
from mercator_design.robot.run.runner import Run
from mercator_design.robot.run.runner import run as drive
from mercator_design.robot.run.senses import why_device_is_needed
from mercator_design.software.files import read_header
from mercator_design.software.needed import load_beside


@click.command()
@click.argument("fsm", type=FILE)
@ROBOT
@click.option(
    "--duration", type=DURATION, metavar="SECONDS", help="Duration of the run.  [default: until it is stopped]"
)
@click.option(
    "--seed",
    type=SEED,
    help="Seed of the random draws; robots of a swarm need different ones.  [default: a new one; the log has it]",
)
@click.option("--dry-run", is_flag=True, help="Do not turn the wheels.")
@click.option(
    "-o", "--log", type=OutputFile(), help="A new file, or a folder for it.  [default: run-NAME-DATE-TIME.jsonl]"
)
@WITHOUT
@click.option(
    "--await-start",
    is_flag=True,
    help="Wait for the start time, which is read from stdin, to begin together with other robots; for "
    "`mdesign deploy --start`.",
)
@FLAVOUR
@LENIENT
def run(
    fsm: Path,
    settings: Settings,
    duration: float | None,
    seed: int | None,
    dry_run: bool,
    log: str | None,
    without: tuple[DeviceName, ...],
    await_start: bool,
    flavour: str | None,
    lenient: bool,
) -> None:
    """Run the PFSM of an fsm.txt. Its flavour (flavour.yaml) and plugins (plugins/) may lie beside it.

    The robot stops when the duration is over, on Ctrl-C or another signal, and when something is wrong, for example: a
    sensor that the PFSM reads is silent, a port is lost, the battery is critical, a stop comes from the swarm.
    """
    load_beside(fsm, read_header(fsm))
    file = read_controller(fsm, flavour, lenient=lenient)
    seed = secrets.randbits(32) if seed is None else seed
    path = new_file(log, "run", settings.name)
    with naming_header(fsm):
        model = settings.as_raced(file.header).reference_model
    for device in without:
        if why := why_device_is_needed(device, file.software.reads, model):
            raise click.UsageError(f"--without {device}: {why}")
    what = Run(file=file, seed=seed, duration=duration, is_dry=dry_run, without=without)
    if dry_run:
        print_message("Dry run: the wheels do not turn.")
    for device in without:
        print_message(f"Without {device}: it is not used, and its readings are neutral.")
    with naming_in_the_end(path, "log", print_message), naming_header(fsm):
        drive(settings, what, path, print_message, AwaitedStart() if await_start else ImmediateStart())
        print_message("The duration is over.")
