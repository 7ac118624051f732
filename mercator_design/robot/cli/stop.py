"""mercator-robot stop, heartbeat: this robot at rest; what is told to all robots of a swarm."""

import signal
import time
from dataclasses import replace

import click

from mercator_design.command import tell
from mercator_design.errors import RobotError, Signalled, printable
from mercator_design.robot.cli.options import ROBOT
from mercator_design.robot.cli.rows import show
from mercator_design.robot.rest import rest
from mercator_design.robot.safety import Signals
from mercator_design.robot.settings import Settings, Swarm
from mercator_design.robot.swarm import HEARTBEAT, Speaker

_BEATS = 0.1
"""[s] between heartbeats."""

_PORT = click.option(
    "--port",
    type=click.IntRange(1, 65535),
    help=f"Of UDP.  [default: swarm.port of ROBOT.yaml, as usual {Swarm().port}]",
)


@click.command(short_help="Bring this robot to rest, or stop others.")
@click.argument("hosts", nargs=-1, metavar="[HOST]...")
@ROBOT
@_PORT
def stop(hosts: tuple[str, ...], settings: Settings, port: int | None) -> None:
    """Bring this robot to rest, or stop those that run at HOSTs; at a broadcast address, all of a network.

    Without HOST, a run in progress here is told to stop; then wheels, streaming, lamps and the lidar are stopped over
    their ports, each device by itself. Exit code 1 if one could not be.

    With HOSTs, prints which robots say that they have stopped; exit code 1 unless one does at each.
    """
    if port is not None:
        settings = replace(settings, swarm=replace(settings.swarm, port=port))
    if not hosts:
        show(rest(settings))
        return
    if settings.swarm.port is None:
        raise click.UsageError("expected --port, as ROBOT.yaml has none")
    with Speaker(hosts, settings.swarm.port) as speaker:
        stopped, silent = speaker.stop()
    for name in stopped:
        click.echo(f"{printable(name)} has stopped")
    if silent:
        raise RobotError("; ".join(silent))


@click.command(short_help="Let robots run as long as this command does.")
@click.argument("hosts", nargs=-1, required=True, metavar="HOST...")
@click.option("--port", type=click.IntRange(1, 65535), default=Swarm().port, show_default=True, help="Of UDP.")
def heartbeat(hosts: tuple[str, ...], port: int) -> None:
    """Let robots whose robot.yaml has swarm.heartbeat run, as long as this command does; Ctrl-C stops them."""
    with Signals().caught(), Speaker(hosts, port) as speaker:
        if missing := speaker.look_up():  # before any robot runs
            raise RobotError("; ".join(missing))
        tell("Robots may run. Ctrl-C stops them.")
        try:
            while True:
                speaker.tell(HEARTBEAT)
                time.sleep(_BEATS)
        except Signalled as signalled:
            if signalled.exit_code != 128 + signal.SIGINT:
                raise
        finally:
            speaker.stop()
