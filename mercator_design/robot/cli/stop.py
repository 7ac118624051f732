"""mercator-robot stop, heartbeat: what is told to all robots of a swarm."""

import time

import click

from mercator_design.command import tell
from mercator_design.errors import RobotError
from mercator_design.robot.settings import Swarm
from mercator_design.robot.swarm import HEARTBEAT, Speaker

_BEATS = 0.1
"""[s] between heartbeats."""

_HOSTS = click.argument("hosts", nargs=-1, required=True, metavar="HOST...")
_PORT = click.option("--port", type=click.IntRange(1, 65535), default=Swarm().port, show_default=True, help="Of UDP.")


@click.command()
@_HOSTS
@_PORT
def stop(hosts: tuple[str, ...], port: int) -> None:
    """Stop the robots that run at HOSTs, or, at a broadcast address, all of a network.

    Prints which say that they have stopped; exit code 1 if none does.
    """
    with Speaker(hosts, port) as speaker:
        stopped = speaker.stop()
    for name in stopped:
        click.echo(f"{name} has stopped")
    if not stopped:
        raise RobotError("no robot has answered; one that runs nothing does not")


@click.command()
@_HOSTS
@_PORT
def heartbeat(hosts: tuple[str, ...], port: int) -> None:
    """Let robots whose robot.yaml has swarm.heartbeat run, as long as this command does; Ctrl-C stops them."""
    with Speaker(hosts, port) as speaker:
        tell("Robots may run. Ctrl-C stops them.")
        try:
            while True:
                speaker.tell(HEARTBEAT)
                time.sleep(_BEATS)
        finally:
            speaker.stop()
