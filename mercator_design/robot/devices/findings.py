"""Findings about a robot's devices: a fault of one does not prevent the checks of the others."""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Literal, NamedTuple, TypeAlias

from mercator_design.errors import RobotError
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import DeviceName, Line, open_port
from mercator_design.robot.devices.settings import Settings


class RobotFinding(NamedTuple):
    """The result of a check or a step, with the remedy if something is wrong."""

    what: str  # what was checked, or the step
    is_fine: bool
    words: str
    is_unclear: bool = False  # whether a person has to judge it
    device: DeviceName | None = None  # which `value` is about
    quantity: Literal["presence", "battery", "line"] | None = None  # what `value` says; None: nothing
    value: str = ""  # the result in few words, for a table


DeviceCheck: TypeAlias = Callable[[Settings, Link], Iterator[RobotFinding]]
"""Checks a device over the link to it."""


def check_devices(
    settings: Settings, checks: Mapping[DeviceName, DeviceCheck], patience: float = 0.0
) -> Iterator[RobotFinding]:
    """Check each device over its port, waiting for the port for `patience` seconds at most; yield the findings."""
    end = time.monotonic() + patience
    for device, check in checks.items():
        try:
            with open_port(device, getattr(settings.ports, device), end) as port:
                yield from check(settings, Link([Line(device, port)]))
        except RobotError as error:
            words = str(error).removeprefix(f"{device}: ")
            yield RobotFinding(
                device, is_fine=False, words=words, device=device, quantity="presence", value="not found"
            )
