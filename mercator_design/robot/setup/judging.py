"""Findings of `mercator-robot check` that several devices have: a line, a rate, a remedy if something is wrong."""

from collections.abc import Sequence
from typing import Any

from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.health import percent, warning_share
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.sweep import Swept
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.ydlidar import TURN


def judged(what: str, is_fine: bool, words: str, remedy: str, **more: Any) -> RobotFinding:  # noqa: ANN401 - its other fields
    """A finding, with the remedy behind its words if something is wrong."""
    return RobotFinding(what, is_fine, words if is_fine else f"{words}; {remedy}", **more)


def line_finding(
    device: DeviceName, settings: Settings, link: Link, before: Counts, swept: Swept | None = None, remedy: str = ""
) -> RobotFinding:
    """The finding on a device's line: the share of its data that arrived whole since the counts `before`.

    Args:
        device: The device.
        settings: The robot's settings.
        link: The link to it.
        before: Counts of its bytes then.
        swept: What the lidar has turned since; if it is a turn at least, the share of it counts, else that of bytes.
        remedy: What to do if too little arrives; by default, what to check of a damaged line.
    """
    received, lost, refused = (later - earlier for earlier, later in zip(before, link.counts()[device], strict=True))
    missing, of_all = (lost, received) if swept is None or swept.all < TURN else (swept.lost, swept.all)
    whole = 1.0 - missing / of_all if of_all else 0.0
    min_share: float = getattr(settings.limits, f"{device}_whole")
    value = f"{100.0 * whole:.1f} % arrives whole" if received else "nothing arrives"
    words = f"{value}; {lost} of {received} bytes lost, {refused} frames refused" if received else value
    usual = link.damage_remedy(device) if received else link.remedy(device)
    remedy = f"in a run it counts as silent below {percent(min_share)}; {remedy or usual}"
    is_fine = whole >= warning_share(min_share)
    return judged(f"{device}'s line", is_fine, words, remedy, device=device, quantity="line", value=value)


def rate_of(times: Sequence[float], duration: float) -> float:
    """The rate [1/s] of events at times [s] within a duration [s]; it is lower if they ceased early."""
    return (len(times) - 1) / max(times[-1] - times[0], 0.75 * duration) if times else 0.0
