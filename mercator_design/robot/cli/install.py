"""mercator-robot install: the robot's files in the system."""

import os
from pathlib import Path

import click

from mercator_design.command import print_message, print_result
from mercator_design.errors import RobotError
from mercator_design.robot.cli.options import DURATION, ROBOT_FILE, SEED, settings_of, show
from mercator_design.robot.devices.ports import user_name
from mercator_design.robot.setup import install as installation


@click.command()
@ROBOT_FILE
@click.option("--user", help="User who runs the robot.  [default: the user who ran sudo]")
@click.option(
    "--root",
    type=click.Path(path_type=Path, file_okay=False, exists=True, resolve_path=True),
    default="/",
    show_default=True,
    help="Write the files below this folder instead of /, and run no command. Their contents are for this system.",
)
@click.option(
    "--duration",
    type=DURATION,
    metavar="SECONDS",
    help="Duration of the service's run.  [default: until it is stopped]",
)
@click.option("--seed", type=SEED, help="Seed of the service's run.  [default: a new one each time]")
@click.option("--dry-run", is_flag=True, help="Print the files and commands, and do nothing.")
@click.option("--uninstall", is_flag=True, help="Remove what was installed.")
def install(
    robot: Path | None,
    user: str | None,
    root: Path,
    duration: float | None,
    seed: int | None,
    dry_run: bool,
    uninstall: bool,
) -> None:
    """Write udev rules for the lidar and the hub, as they are connected now, and systemd's services.

    The ports become /dev/mercator-lidar and /dev/mercator-proximity. mercator-idle.service stops the robot when the Pi
    starts. mercator-robot.service, which only a user starts, runs fsm.txt in the folder of ROBOT.yaml, or else in this
    folder, for --duration and with --seed; install again to change these.
    """
    if uninstall:
        if user or dry_run or duration is not None or seed is not None:
            raise click.UsageError("--uninstall takes neither --user, --duration, --seed nor --dry-run")
        show(installation.uninstall(root))
        return
    ports, findings = installation.connected(settings_of(robot))
    runs_it = user or os.environ.get("SUDO_USER") or user_name()
    if runs_it is None:
        raise RobotError(f"user {os.getuid()} has no name; give the robot's user with --user")
    if runs_it == "root" and user is None:
        print_message("Warning: the services will run as root; give another user with --user")
    setup = installation.Setup(
        user=runs_it,
        folder=(robot.parent if robot else Path()).resolve(),
        robot=robot and robot.resolve(),
        duration=duration,
        seed=seed,
    )
    files = installation.texts(ports, setup, root)
    if dry_run:
        for path, text in files.items():
            print_result(f"==> {path}\n{text}")
        if root == Path("/"):
            print_result("\n".join(f"$ {command}" for command in installation.AFTERWARDS))
        show(findings)
    else:
        show([*findings, *installation.install(files, root)])
