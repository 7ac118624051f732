"""Findings on the devices of a robot: a fault of one does not prevent the checks of the others."""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Literal, NamedTuple, TypeAlias

from mercator_design.errors import RobotError
from mercator_design.robot.devices.ports import DeviceName, Line, open_port
from mercator_design.robot.devices.settings import Settings


class Finding(NamedTuple):
    """What was looked at or done, and how it is; if something is wrong, with what to do.

    is_unclear: Only a person can judge whether it is fine.
    device: The device that `value` is about.
    quantity: What `value` says about the device; None if the finding has no value.
    value: The result in few words, for a table.
    """

    what: str
    is_fine: bool
    words: str
    is_unclear: bool = False
    device: DeviceName | None = None
    quantity: Literal["presence", "battery", "line"] | None = None
    value: str = ""


Look: TypeAlias = Callable[[Settings, Line], Iterator[Finding]]
"""At a device, over its open port."""


def of_devices(settings: Settings, looks: Mapping[DeviceName, Look], patience: float = 0.0) -> Iterator[Finding]:
    """What is found at each device, by name, or why it could not be looked at; ports are waited for so long [s]."""
    end = time.monotonic() + patience
    for device, look in looks.items():
        try:
            with open_port(device, getattr(settings.ports, device), end) as port:
                yield from look(settings, Line(device, port))
        except RobotError as error:
            words = str(error).removeprefix(f"{device}: ")
            yield Finding(device, is_fine=False, words=words, device=device, quantity="presence", value="not found")
