"""Both directions of the three lines, with frames to send over them."""

import math
from typing import NamedTuple

from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.multiflex import Acknowledgement, Distances
from mercator_design.robot.protocols.rvr_messages import Processor, lights
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData, streaming
from mercator_design.robot.protocols.ydlidar import DeviceInfo, Health, Packet, ScanStarted

STREAMED = [name for name in SERVICES if name not in {"speed", "core_time", "encoders"}]
QUIET = {name: dict.fromkeys(service.attributes, 0.0) for name, service in SERVICES.items()}
"""What every service streams of a robot that stands on black, in the dark."""
COLOR = ("red", "green", "blue", "confidence", "color_classification_id")


class Line(NamedTuple):
    """One direction of a line.

    decoder: Makes a new one.
    frames: As they are sent in the course of an experiment.
    begins: What a long frame begins with, after which everything is waited for.
    longest: Bytes of the longest frame.
    """

    decoder: object
    frames: list[bytes]
    begins: bytes
    longest: int


def _packets():
    """A turn of a lidar whose walls are farther away at some angles."""
    samples = [round(4000 * (1.5 + math.sin(i / 50))) for i in range(720)]
    yield Packet(0, 0, (6000,), is_ring_start=True, frequency=70)
    for i in range(0, 720, 40):
        yield Packet(32 * i, 32 * (i + 39), tuple(samples[i : i + 40]))


def _robot():
    host, device = rvr.Host(), rvr.RvrEnd()
    sent = [host.send(name, target=target, **values) for name, target, values in streaming(STREAMED, 100)]
    sent.append(host.send("set_all_leds", **lights({"headlight_left": (0x8D, 0xD8, 0xAB)})))
    sent += [host.send("drive_tank_si_units", left_velocity=v / 7, right_velocity=-v / 9) for v in range(-6, 7)]
    sent += [host.send(name) for name in ("get_battery_percentage", "get_encoder_counts", "drive_stop")]
    commands = [command for frame in sent for command in device.receive(frame)]
    assert all(device.follow(command) for command in commands)
    told = [device.notify("did_wake"), device.notify("color_detection", **dict.fromkeys(COLOR, 0xD8))]
    told.append(device.answer(commands[-3].frame, percentage=87))
    told.append(device.answer(commands[-2].frame, left=1200, right=-1187))
    for processor in Processor:
        for slot, names in device.slots.of(processor).items():
            values = {name: dict.fromkeys(SERVICES[name].attributes, 0.5) for name in names}
            told += 3 * [device.stream(StreamData(processor, slot, is_valid=True, values=values))]
    return sent, told


def _hub():
    near = [Distances((100 * k, 0xFFFF, 333, 49, 2001, 77 + k, 1000, 19782), 0xFF >> k % 2) for k in range(8)]
    return [Acknowledgement(0x11, ok=True), *near[:4], Acknowledgement(0x52, ok=False), *near[4:]]


_SENT, _TOLD = _robot()
_ANSWERS = [DeviceInfo(6, (1, 5), 1, "8312230285877766"), Health(0), ScanStarted()]
LINES = {
    "rvr, to the robot": Line(rvr.frame_decoder, _SENT, b"\x8d\x18", rvr.MAX_FRAME),
    "rvr, to the computer": Line(rvr.frame_decoder, _TOLD, b"\x8d\x28", rvr.MAX_FRAME),
    "ydlidar, to the device": Line(
        ydlidar.command_decoder, [ydlidar.encode_command(name) for name in ydlidar.COMMANDS], b"\xa5", 2
    ),
    "ydlidar, to the computer": Line(
        ydlidar.decoder, [event.encode() for event in [*_ANSWERS, *_packets()]], b"\xaa\x55\0\x50", 170
    ),
    "multiflex, to the hub": Line(
        multiflex.command_decoder,
        [multiflex.TEXT_MODE.encode(), *(multiflex.use_sensors(mask).encode() for mask in (0, 0x0F, 0x52, 0xFF))],
        b"\0\x52",
        5,
    ),
    "multiflex, to the computer": Line(multiflex.decoder, [event.encode() for event in _hub()], b"MF", 52),
    "multiflex, to the computer, text": Line(
        multiflex.decoder, [e.encode_text() if isinstance(e, Distances) else e.encode() for e in _hub()], b"MF\t", 52
    ),
}
