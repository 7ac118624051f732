"""mercator-robot stop, heartbeat: stop this robot; send stops and heartbeats to a swarm."""

import signal
from dataclasses import replace
from pathlib import Path

import click

from mercator_design.command import FILE, print_message, print_result
from mercator_design.config.schema import FieldError
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import RobotError, SettingsError, Signalled, printable
from mercator_design.robot.cli.options import ROBOT, ROBOT_OF_SENDER, show
from mercator_design.robot.devices.settings import Settings, SwarmSettings, check_key
from mercator_design.robot.run.network import Speaker
from mercator_design.robot.run.safe_stop import safe_stop
from mercator_design.robot.run.safety import Signals

_BEAT_EVERY = 0.1  # [s]

_PORT = click.option(
    "--port",
    type=click.IntRange(1, 65535),
    help=f"Port of UDP.  [default: swarm.port in ROBOT.yaml, or {SwarmSettings().port}]",
)


@click.command()
@click.argument("hosts", nargs=-1, metavar="[HOST]...")
@ROBOT
@_PORT
def stop(hosts: tuple[str, ...], settings: Settings, port: int | None) -> None:
    """Stop this robot, or those that run at HOSTs; a broadcast address stops all robots of a network.

    Without HOST, stops a run in progress here, then wheels, streaming, lamps and the lidar over their ports, each
    device by itself. Exit code 1 if a device could not be stopped.

    With HOSTs, prints which robots answer that they have stopped; exit code 1 if there is no answer from a HOST.
    """
    if port is not None:
        settings = replace(settings, swarm=replace(settings.swarm, port=port))
    if not hosts:
        show(safe_stop(settings))
        return
    if settings.swarm.port is None:
        raise click.UsageError("expected --port, as ROBOT.yaml has none")
    with Speaker(hosts, settings.swarm.port) as speaker:
        stopped, silent = speaker.stop()
    for name in stopped:
        print_result(f"{printable(name)} has stopped")
    if silent:
        raise RobotError("; ".join(silent))


@click.command()
@click.argument("hosts", nargs=-1, required=True, metavar="HOST...")
@ROBOT_OF_SENDER
@_PORT
@click.option(
    "--key-file",
    type=FILE,
    metavar="FILE",
    help="File whose first line is the robots' swarm.key.  [default: swarm.key in ROBOT.yaml]",
)
def heartbeat(hosts: tuple[str, ...], settings: Settings, port: int | None, key_file: Path | None) -> None:
    """Let robots whose robot.yaml has swarm.heartbeat run as long as this command runs; Ctrl-C stops them.

    Robots that have a key run only if this command has the same.
    """
    key = settings.swarm.key if key_file is None else _key_in(key_file)
    port = settings.swarm.port if port is None else port
    if port is None:
        raise click.UsageError("expected --port, as ROBOT.yaml has none")
    with Signals().caught(), Speaker(hosts, port) as speaker:
        if missing := speaker.look_up():  # before any robot runs
            raise RobotError("; ".join(missing))
        if key is None:
            print_message("Warning: heartbeats are not signed, as there is no key; robots that have one do not run.")
        print_message("Robots may run. Ctrl-C stops them.")
        try:
            while True:
                speaker.beat(key, _BEAT_EVERY)
        except Signalled as signalled:
            if signalled.exit_code != 128 + signal.SIGINT:
                raise
        finally:
            speaker.stop()


def _key_in(path: Path) -> str:
    """The key in a file; errors do not show it.

    Raises:
        SettingsError: if it is missing or too short.
    """
    key = text_of(path, error=SettingsError).partition("\n")[0].strip()
    try:
        check_key(key, "first line")
    except FieldError as wrong:
        raise SettingsError(f"{path}: {wrong.field}: {wrong.message}") from None
    return key
