"""Stop this robot, also if the program that drove it is dead."""

from collections.abc import Iterator

from mercator_design.robot.devices.findings import RobotFinding, check_devices
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import halt, stop_lidar, stop_rvr, wake_rvr
from mercator_design.robot.run.network import Speaker

END_WAIT = 10.0  # [s] for a stopped run to close its ports; a run in its start-up takes longest


def safe_stop(settings: Settings) -> Iterator[RobotFinding]:
    """Stop the run in progress here, if it receives stops, then the RVR and the lidar, each by itself."""
    patience = 0.0
    if settings.swarm.port is not None:
        with Speaker(["127.0.0.1"], settings.swarm.port) as speaker:
            stopped, _ = speaker.stop()
        if stopped:
            yield RobotFinding("run", is_fine=True, words=f"{', '.join(stopped)} has stopped")
            patience = END_WAIT
    yield from check_devices(settings, {"rvr": _stop_rvr, "lidar": _stop_lidar}, patience)


def _stop_rvr(_: Settings, link: Link) -> Iterator[RobotFinding]:
    link.send("rvr", 2 * halt(link))
    try:
        found = wake_rvr(link)  # an RVR that sleeps refuses the rest
    finally:
        stop_rvr(link)  # also if the RVR is not heard: it may hear
    yield RobotFinding("rvr", is_fine=True, words=f"at rest; battery {found.words()['battery']}")


def _stop_lidar(_: Settings, link: Link) -> Iterator[RobotFinding]:
    stop_lidar(link)
    yield RobotFinding("lidar", is_fine=True, words="stop sent")
