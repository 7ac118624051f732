"""Bring this robot to rest, whatever has happened to the program that drove it."""

from collections.abc import Iterator

from mercator_design.robot.devices.findings import Finding, of_devices
from mercator_design.robot.devices.health import charge
from mercator_design.robot.devices.link import Talk
from mercator_design.robot.devices.ports import Line
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import halt, rest_rvr, stop_lidar, wake_rvr
from mercator_design.robot.run.network import Speaker

_ENDING = 10.0  # [s] that a run which was told to stop may take to let go of the ports; most may start up


def rest(settings: Settings) -> Iterator[Finding]:
    """Stop the run that is in progress here, if it hears, then the RVR and the lidar, each by itself."""
    patience = 0.0
    if settings.swarm.port is not None:
        with Speaker(["127.0.0.1"], settings.swarm.port) as speaker:
            stopped, _ = speaker.stop()
        if stopped:
            yield Finding("run", is_fine=True, words=f"{', '.join(stopped)} has stopped")
            patience = _ENDING
    yield from of_devices(settings, {"rvr": _rest_rvr, "lidar": _rest_lidar}, patience)


def _rest_rvr(_: Settings, line: Line) -> Iterator[Finding]:
    talk = Talk([line], lambda _event, _now: None)
    talk.send("rvr", 2 * halt(talk))
    found = wake_rvr(talk)  # asleep it would refuse the rest
    rest_rvr(talk)
    yield Finding("rvr", is_fine=True, words=f"at rest; battery {charge(found.battery)}")


def _rest_lidar(_: Settings, line: Line) -> Iterator[Finding]:
    stop_lidar(Talk([line], lambda _event, _now: None), line)
    yield Finding("lidar", is_fine=True, words="told to stop")
