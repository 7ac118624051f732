"""mdesign bundle: the program for the robot as one file."""

from pathlib import Path

import click

from mercator_design.command import OUTPUT_FILE, print_message
from mercator_design.errors import RobotError
from mercator_design.fleet.bundle import bundle as make
from mercator_design.fleet.bundle import is_bundle
from mercator_design.system.files import write_bytes, writing


@click.command()
@click.option(
    "-o", "--output", type=OUTPUT_FILE, default="mercator-robot.pyz", show_default=True, metavar="FILE",
    help="File to write.",
)  # fmt: skip
def bundle(output: Path) -> None:
    """Write mercator-robot as one file, which needs only Python 3.11 or later on a robot's Pi.

    The file contains click, PyYAML and pyserial in the versions installed here. An existing file is replaced.
    """
    with writing(output):
        if output.is_file() and not is_bundle(output):
            raise RobotError(f"{output} exists and is not a zip application; give another name, or remove it")
    data = make()
    with writing(output):
        write_bytes(output, data)
        if output.is_file():
            output.chmod(0o755)
    print_message(f"{output} is written; on the robot: python3 {output.name} --help")
