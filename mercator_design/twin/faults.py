"""The faults of a twin: a script in YAML, and its effect on the bytes of a line.

schema: 1
seed: 7       # of the choice of bytes
faults:
  - {kind: flip, at: 5, duration: 10, robot: 0, device: rvr, rate: 0.01}
  - {kind: port_loss, at: 20, duration: 2, robot: 1, device: lidar}
"""

import random
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeAlias

from mercator_design.config.loading import read
from mercator_design.config.schema import FieldError, Length, Range
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import SettingsError, excerpt
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.protocols.rvr_messages import COMMANDS
from mercator_design.twin.devices.lidar import Hiding, LidarState

Direction: TypeAlias = Literal["from_robot", "to_robot"]
Time = Annotated[float, Range(0.0, 86_400.0)]
Rate = Annotated[float, Range(0.0, 1.0)]
Degrees = Annotated[float, Range(-360.0, 360.0)]
Service: TypeAlias = Literal[
    "quaternion",
    "imu",
    "accelerometer",
    "color_detection",
    "gyroscope",
    "locator",
    "velocity",
    "speed",
    "core_time",
    "ambient_light",
    "encoders",
]
"""Those of rvr_streaming.SERVICES."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fault:
    at: Time  # [s] since the twin began
    duration: Time = 86_400.0  # [s] that it lasts
    robot: Annotated[int, Range(0, 999)]  # its number, from 0

    def is_on(self, now: float) -> bool:
        """Whether the fault is present at a time [s]."""
        return self.at <= now < self.at + self.duration


@dataclass(frozen=True, slots=True, kw_only=True)
class _LineFault(_Fault):
    device: DeviceName  # on whose line
    direction: Literal["from_robot", "to_robot", "both"] = "both"  # of the bytes that it meets


@dataclass(frozen=True, slots=True, kw_only=True)
class Flip(_LineFault):
    """Bytes have one bit flipped."""

    kind: Literal["flip"] = "flip"
    rate: Rate  # of the bytes that it meets

    def damaged(self, byte: int, chance: random.Random) -> bytes:
        return bytes([byte ^ 1 << chance.randrange(8)]) if chance.random() < self.rate else bytes([byte])


@dataclass(frozen=True, slots=True, kw_only=True)
class Lose(_LineFault):
    """Bytes are lost."""

    kind: Literal["lose"] = "lose"
    rate: Rate  # of the bytes that it meets

    def damaged(self, byte: int, chance: random.Random) -> bytes:
        return b"" if chance.random() < self.rate else bytes([byte])


@dataclass(frozen=True, slots=True, kw_only=True)
class Double(_LineFault):
    """Bytes come twice."""

    kind: Literal["double"] = "double"
    rate: Rate  # of the bytes that it meets

    def damaged(self, byte: int, chance: random.Random) -> bytes:
        return bytes([byte] * (1 + (chance.random() < self.rate)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Insert(_LineFault):
    """Random bytes are put in."""

    kind: Literal["insert"] = "insert"
    rate: Rate  # of them, to bytes that are there

    def damaged(self, byte: int, chance: random.Random) -> bytes:
        return bytes([byte, chance.randrange(256)]) if chance.random() < self.rate else bytes([byte])


@dataclass(frozen=True, slots=True, kw_only=True)
class Silence(_LineFault):
    """No bytes arrive."""

    kind: Literal["silence"] = "silence"

    def damaged(self, byte: int, chance: random.Random) -> bytes:  # noqa: ARG002 - as the others
        return b""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongBaud(_LineFault):
    """All bytes come as others, as from a line at another speed."""

    kind: Literal["wrong_baud"] = "wrong_baud"

    def damaged(self, byte: int, chance: random.Random) -> bytes:  # noqa: ARG002 - as the others
        return bytes([chance.randrange(256)])


@dataclass(frozen=True, slots=True, kw_only=True)
class PortLoss(_Fault):
    """The port goes away, as if it were pulled out, and comes back."""

    kind: Literal["port_loss"] = "port_loss"
    device: DeviceName  # whose port


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery(_Fault):
    """The battery falls to a level: below 6 % it is critical, below 34 % low."""

    kind: Literal["battery"] = "battery"
    level: Annotated[float, Range(0.0, 100.0)]  # [%]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stall(_Fault):
    """A motor is stuck."""

    kind: Literal["stall"] = "stall"
    motor: Literal["left", "right"]  # which


@dataclass(frozen=True, slots=True, kw_only=True)
class Heat(_Fault):
    """A motor is hot: from 60 degrees on the robot warns, from 70 on it cuts the motor off."""

    kind: Literal["heat"] = "heat"
    motor: Literal["left", "right"]  # which
    temperature: Annotated[float, Range(-20.0, 200.0)]  # [degrees Celsius]


@dataclass(frozen=True, slots=True, kw_only=True)
class _LidarFault(_Fault):
    device: ClassVar[DeviceName] = "lidar"


@dataclass(frozen=True, slots=True, kw_only=True)
class Blind(_LidarFault):
    """The lidar sees nothing, in all directions or in a sector, in all turns or in some."""

    kind: Literal["blind"] = "blind"
    sector: tuple[Degrees, Degrees] | None = None  # [degrees, counter-clockwise from the front]; null: all around
    turns: Rate = 1.0  # of the turns, evenly

    def changed(self, state: LidarState) -> LidarState:
        return replace(state, hidings=(*state.hidings, Hiding(0.0, self.sector, self.turns)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Post(_LidarFault):
    """The lidar sees a part of its own robot."""

    kind: Literal["post"] = "post"
    sector: tuple[Degrees, Degrees]  # [degrees, counter-clockwise from the front]
    distance: Annotated[float, Range(0.01, 12.0)] = 0.14  # [m]

    def changed(self, state: LidarState) -> LidarState:
        return replace(state, hidings=(*state.hidings, Hiding(self.distance, self.sector)))


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowTurns(_LidarFault):
    """The lidar turns at another speed."""

    kind: Literal["slow_turns"] = "slow_turns"
    rate: Annotated[float, Range(0.5, 12.0)]  # [1/s]

    def changed(self, state: LidarState) -> LidarState:
        return replace(state, rate=self.rate)


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherLidar(_LidarFault):
    """The lidar is another model, or in another mode."""

    kind: Literal["other_lidar"] = "other_lidar"
    model: Annotated[int, Range(0, 255)] = 6  # number; an X4 is 6
    intensities: bool = False  # whether samples have three bytes, the first one an intensity
    one_way: bool = False  # whether it sends without being asked, and hears nothing
    unanswered: Annotated[tuple[Literal["health", "device_info", "scan"], ...], Length(0, 3)] = ()  # commands

    def changed(self, state: LidarState) -> LidarState:
        return replace(
            state,
            model=self.model,
            has_intensities=self.intensities,
            is_one_way=self.one_way,
            unanswered=frozenset(self.unanswered),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class OldHub(_Fault):
    """The hub refuses all commands, as old firmware does, and streams."""

    device: ClassVar[DeviceName] = "proximity"
    kind: Literal["old_hub"] = "old_hub"


@dataclass(frozen=True, slots=True, kw_only=True)
class _StreamFault(_Fault):
    service: Service  # which the RVR streams; the others in its slot have the fault, too


@dataclass(frozen=True, slots=True, kw_only=True)
class NoStream(_StreamFault):
    """The RVR does not stream a service."""

    kind: Literal["no_stream"] = "no_stream"


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowStream(_StreamFault):
    """The RVR streams a service less often than it is asked to."""

    kind: Literal["slow_stream"] = "slow_stream"
    period: Annotated[float, Range(0.01, 60.0)]  # [s] at least


@dataclass(frozen=True, slots=True, kw_only=True)
class InvalidStream(_StreamFault):
    """The RVR marks the values of a service as invalid."""

    kind: Literal["invalid_stream"] = "invalid_stream"


@dataclass(frozen=True, slots=True, kw_only=True)
class LampOff(_Fault):
    """The lamp of the RVR's colour sensor does not come on, or the robot is lifted: all colours read 0, 0, 0."""

    kind: Literal["lamp_off"] = "lamp_off"


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedCommand(_Fault):
    """The RVR refuses a command, as firmware does that does not know it."""

    kind: Literal["refusal"] = "refusal"
    command: str  # by its name in the maker's documents
    service: Service | None = None  # of configure_streaming_service, only slots with this service; null: all
    error: Annotated[int, Range(1, 255)] | None = 6  # with which it answers; null: it does not answer

    def __post_init__(self) -> None:
        if self.command not in COMMANDS:
            raise FieldError("command", f"expected a command of the RVR, found '{excerpt(self.command)}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class LockedSlots(_Fault):
    """The RVR refuses to change what it streams while it streams; only stop_streaming_service ends that."""

    kind: Literal["locked_slots"] = "locked_slots"


LineFault: TypeAlias = Flip | Lose | Double | Insert | Silence | WrongBaud
LidarFault: TypeAlias = Blind | Post | SlowTurns | OtherLidar
RvrFault: TypeAlias = NoStream | SlowStream | InvalidStream | LampOff | RefusedCommand | LockedSlots
Fault: TypeAlias = LineFault | LidarFault | RvrFault | PortLoss | Battery | Stall | Heat | OldHub


@dataclass(frozen=True, slots=True, kw_only=True)
class Script(FromFile):
    """The faults of the robots of an arena."""

    KIND: ClassVar = "script of faults"

    schema: Literal[1] = 1  # version of this format
    seed: Annotated[int, Range(0, 2**63 - 1)] = 1  # of the random effects on bytes
    faults: Annotated[tuple[Fault, ...], Length(0, 10_000)] = ()  # in any order


def read_script(path: str | Path) -> Script:
    """The script in a file.

    Raises:
        SettingsError: with file, line, key, what was expected and what was found.
    """
    return read(path, Script, error=SettingsError)


class Damage:
    """The effect of faults on the bytes of one direction of a line."""

    def __init__(self, faults: Iterable[LineFault], direction: Direction, seed: str) -> None:
        """The effect of some faults, with draws from a seed."""
        self._faults = [
            (fault, random.Random(f"{seed} {number}"))
            for number, fault in enumerate(faults)
            if fault.direction in {direction, "both"}
        ]

    def __call__(self, data: bytes, now: float) -> bytes:
        """The bytes that arrive."""
        for fault, chance in self._faults:
            if fault.is_on(now):
                data = b"".join(fault.damaged(byte, chance) for byte in data)
        return data
