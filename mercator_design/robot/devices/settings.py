"""The settings of one robot in a YAML file, robot.yaml: its ports, limits, colours and the angles of its sensors."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from mercator_design.config.colours import COLOURS, LABELS, RGB, ColourName, Levels
from mercator_design.config.loading import parse
from mercator_design.config.schema import FieldError, Length, Name, Range, checked
from mercator_design.config.yaml_tree import FromFile, text_of
from mercator_design.errors import FsmError, SettingsError, excerpt
from mercator_design.modules.perception import nearest_label
from mercator_design.modules.reference import ReferenceModel
from mercator_design.robot.devices.ports import PortNames
from mercator_design.robot.devices.sweep import covered

Angle = Annotated[float, Range(-7.0, 7.0)]
Degrees = Annotated[float, Range(-360.0, 360.0)]
Age = Annotated[float, Range(0.3, 10.0)]
Offset = Annotated[float, Range(-0.2, 0.2)]
Speed = Annotated[float, Range(0.01, 1.55)]
Percentage = Annotated[float, Range(0.0, 100.0)]
Share = Annotated[float, Range(0.0, 1.0)]

CONTROL_PERIOD = 0.1
"""[s] of a control cycle; the default of missions."""
COMMANDS_END = 0.3
"""[s] without a command after which the RVR stops by itself, for example if this program has died; the default."""

# Readings are no newer than the RVR's streams, and a control loop that gives no command for 0.18 s has stalled.
_PERIOD = Annotated[float, Range(0.05, 0.12)]
_RING = tuple(eighths * math.pi / 4.0 for eighths in (1, 0, -1, -2, -3, 4, 3, 2))
"""Angles of the proximity sensors in the robot model mercator."""
_MIN_KEY = 16  # characters
_MEMORY = ("neighbour_memory", "neighbour_count_memory", "ground_vote_cycles")
"""Constants of reference models with a memory, such as the e-puck's."""


@dataclass(frozen=True, kw_only=True)
class RvrSettings:
    """Settings of the RVR."""

    period: Annotated[float, Range(0.033, 1.0)] = 0.05  # [s] from one streamed sample of a sensor to the next
    timeout: Annotated[float, Range(0.2, 2.0)] = (
        COMMANDS_END  # [s] without a command after which the RVR stops by itself
    )


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The limits beyond which the robot stops."""

    speed: Speed = 0.3  # [m/s] speed of a tread at full speed, unless fsm.txt has a lower one
    rvr: Annotated[float, Range(0.1, 10.0)] = 0.25  # [s] maximum age of the RVR's samples; 2 of its periods or more
    proximity: Age = 0.5  # [s] maximum age of the hub's distances, which come 6 times a second
    lidar: Age = 0.6  # [s] maximum time since the lidar's last turn; it makes 5 to 12 a second
    rvr_whole: Share = 0.8  # minimum share of the RVR's bytes that arrive whole, and of commands that it answers
    proximity_whole: Share = 0.5  # minimum share of the hub's bytes that arrive whole; a few frames are a large share
    lidar_whole: Share = 0.8  # minimum share of the lidar's turns that arrives; below it the lidar is silent
    battery_low: Percentage = 20.0  # [%] charge below which users are warned; also if the RVR reports that it is low
    battery_critical: Percentage = (
        5.0  # [%] charge below which the robot stops; also if the RVR reports that it is critical
    )
    lidar_blind: Annotated[float, Range(2.0, 3600.0)] | None = (
        5.0  # [s] for which the lidar may see nothing, of twice that time; null: for ever
    )
    stall: Annotated[float, Range(0.1, 60.0)] = 3.0  # [s] maximum time for which a tread may be stuck
    dark: Annotated[float, Range(0.1, 60.0)] | None = (
        0.5  # [s] of ground samples 0, 0, 0 after which the ground counts as not seen; null: they are always black
    )
    unending_commands: bool = False  # whether to run if the RVR reports that it drives on without commands

    def __post_init__(self) -> None:
        if self.battery_low < self.battery_critical:
            critical = f"battery_critical, {self.battery_critical:g} %"
            raise FieldError("battery_low", f"expected at least {critical}, found {self.battery_low:g}")


@dataclass(frozen=True, kw_only=True)
class LidarSettings:
    """Settings of the lidar: the sectors that it cannot see."""

    blind: Annotated[
        tuple[tuple[Degrees, Degrees], ...], Length(0, 36)
    ] = ()  # [degrees, counter-clockwise from the robot's front] sectors, each from its first angle to its second

    def __post_init__(self) -> None:
        checked(self._mistakes())

    def _mistakes(self) -> Iterator[FieldError]:
        for number, (first, last) in enumerate(self.blind):
            if (last - first) % 360.0 == 0.0:
                found = f"found [{first:g}, {last:g}]"
                yield FieldError(f"blind[{number}]", f"expected two angles, from the first to the second; {found}")
        if self.blind and all(covered(self.blind)):
            yield FieldError("blind", "expected sectors that leave something to see; use --without lidar instead")


def check_key(key: str, place: str) -> None:
    """Check that a key of heartbeats is hard to guess.

    Raises:
        FieldError: if it is too short, naming the place, but not the key.
    """
    if len(key) < _MIN_KEY:
        raise FieldError(place, f"expected at least {_MIN_KEY} characters, found {len(key)}")


@dataclass(frozen=True, kw_only=True)
class SwarmSettings:
    """Messages to all robots over the network."""

    port: Annotated[int, Range(1, 65535)] | None = 9750  # UDP port for `mercator-robot stop`; null: none
    heartbeat: Age | None = None  # [s] maximum silence of `mercator-robot heartbeat`; null: none needed

    key: str | None = field(default=None, repr=False)  # of signed heartbeats; null: no signature needed

    def __post_init__(self) -> None:
        if self.heartbeat is not None and self.port is None:
            raise FieldError("heartbeat", "there is no port to receive it on")
        if self.key is not None:
            check_key(self.key, "key")


@dataclass(frozen=True, kw_only=True)
class Settings(FromFile):
    """The settings of one robot; a key that is missing has its default."""

    KIND: ClassVar = "settings of robot"

    schema: Literal[1] = 1  # version of this format
    name: Name = "mercator"  # of the robot, in logs and answers
    ports: PortNames = PortNames()
    rvr: RvrSettings = RvrSettings()
    limits: Limits = Limits()
    labels: Mapping[ColourName, Levels] | None = None  # what the ground sensor reads on each colour; null: the colour
    missions: Mapping[str, Annotated[tuple[ColourName, ...], Length(1)]] | None = (
        None  # colours of each mission's floor, instead of those in fsm.txt
    )
    proximity_angles: Annotated[tuple[Angle, ...], Length(8, 8)] = _RING  # [rad] of the hub's sensors, in its order
    proximity_offsets: Annotated[tuple[Offset, ...], Length(8, 8)] = (0.0,) * 8  # [m] that each of them reads too much
    lidar_angle: Angle = 0.0  # [rad] of the lidar's front from the robot's
    lidar: LidarSettings = LidarSettings()
    swarm: SwarmSettings = SwarmSettings()
    reference_model: ReferenceModel = ReferenceModel()

    def __post_init__(self) -> None:
        wrong = [
            FieldError(f"reference_model.{name}", "expected 0, as this robot has no memory")
            for name in _MEMORY
            if getattr(self.reference_model, name) != 0.0
        ]
        if self.limits.rvr < 2.0 * self.rvr.period:
            expected = f"expected at least twice rvr.period, {2.0 * self.rvr.period:g} s"
            wrong.append(FieldError("limits.rvr", f"{expected}, found {self.limits.rvr:g}"))
        checked(wrong)

    def labels_of(self, header: Mapping[str, str]) -> dict[ColourName, RGB]:
        """What the ground sensor reads on each colour of the floor in the header of an fsm.txt; without it, on all.

        Raises:
            FsmError: if the floor in the header is not of colours.
            SettingsError: if only some of the floor's colours were measured: measured and nominal colours cannot be
                compared.
        """
        measured = self.labels or {}
        named = header["floor"].split(", ") if "floor" in header else []
        if unknown := [name for name in named if name not in COLOURS]:
            raise FsmError(f"floor in the header: expected {', '.join(COLOURS)}, found '{excerpt(unknown[0])}'")
        floor = tuple(name for name in COLOURS if name in named)
        names = (self.missions or {}).get(header.get("mission", "")) or floor or tuple(measured) or LABELS
        if not measured:
            return {name: COLOURS[name] for name in names}
        if lacking := [name for name in names if name not in measured]:
            raise SettingsError(
                f"{self.where('labels')}: expected all colours of the floor ({', '.join(names)}), "
                f"found none of {', '.join(lacking)}; "
                f"measure with `mercator-robot calibrate color {' '.join(lacking)}`"
            )
        return {name: measured[name] for name in names}

    def as_raced(self, header: Mapping[str, str]) -> Self:
        """These settings with the constants and the full speed in the header of an fsm.txt, if it has them.

        Raises:
            FsmError: if they are not valid or not those of this robot, or the robot cannot keep the control period.
        """
        limit = self.limits.speed
        speed = _from_header(header, "maximum speed", Speed, limit)
        if speed > limit:
            raise FsmError(
                f"maximum speed in the header: expected at most limits.speed, {limit:g} m/s, found {speed:g}"
            )
        model = reference_model_of(header, self.reference_model)
        for name, own, raced, usual in zip(model._fields, self.reference_model, model, ReferenceModel(), strict=True):
            if own not in {raced, usual}:
                place = f"reference model in the header: {name}"
                raise FsmError(f"{place}: expected {own:g}, as the robot's reference_model has it, found {raced:g}")
        control_period_of(header)  # refused before anything is started
        try:
            return replace(self, limits=replace(self.limits, speed=speed), reference_model=model)
        except FieldError as wrong:
            raise FsmError(f"the header: {wrong.field}: {wrong.message}") from None

    def corrected(self, distances: Sequence[float]) -> tuple[float, ...]:
        """The hub's distances [m] minus the offset of each sensor, at least 0; infinite ones and NaN stay."""
        return tuple(
            max(0.0, distance - offset) if math.isfinite(distance) else distance
            for distance, offset in zip(distances, self.proximity_offsets, strict=True)
        )


def read_settings(path: Path) -> Settings:
    """The settings in a YAML file.

    Raises:
        SettingsError: with file, line, key, what was expected and what was found.
    """
    return parse_settings(text_of(path, error=SettingsError), str(path), path.parent)


def parse_settings(text: str, label: str, folder: Path) -> Settings:
    """As `read_settings`, from a text, which `label` names in errors; an empty text has all defaults."""
    is_empty = not any(line.partition("#")[0].strip() for line in text.splitlines())
    return parse("{}" if is_empty else text, Settings, error=SettingsError, label=label, folder=folder)


def control_period_of(header: Mapping[str, str]) -> float:
    """The time [s] from one control cycle to the next in the header of an fsm.txt; by default `CONTROL_PERIOD`.

    Raises:
        FsmError: if the robot cannot keep it.
    """
    return float(_from_header(header, "control period", _PERIOD, CONTROL_PERIOD))


def reference_model_of(header: Mapping[str, str], usual: ReferenceModel) -> ReferenceModel:
    """The constants in the header of an fsm.txt, or `usual` without them.

    Raises:
        FsmError: if they are not valid.
    """
    model: ReferenceModel = _from_header(header, "reference model", ReferenceModel, usual)
    return model


def nearest(labels: Mapping[ColourName, RGB], found: RGB) -> ColourName:
    """The label whose colour is nearest to a measured one; the first of equally near ones."""
    levels = tuple(itertools.chain.from_iterable(labels.values()))
    return list(labels)[nearest_label(levels, *found)]


def _from_header(header: Mapping[str, str], key: str, kind: Any, usual: Any) -> Any:  # noqa: ANN401 - of the type `kind`
    if key not in header:
        return usual
    return parse(header[key], kind, error=FsmError, label=f"{key} in the header", lines=False)
