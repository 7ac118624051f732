"""What decoding the three devices' data costs: CPU time for each second of what they send.

The lidar sends 5000 samples a second in 7 turns, of which all points are computed; the RVR streams the eight services
of the original robot every 100 ms; the hub sends 50 frames a second. Bytes are handed over in pieces of 64, as a serial
port might. Needs nothing but Python, so that it can be run on a robot.
Run: python benchmarks/codecs.py
"""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData, streaming

SAMPLES, TURNS, PACKET = 5000, 7, 40
PERIOD = 100
FRAMES = 50
PIECE = 64
SECONDS = 100
STREAMED = [name for name in SERVICES if name not in {"speed", "core_time", "encoders"}]


def lidar_second() -> bytes:
    """Ring starts, and packets between them, in a room of 2 m to 4 m."""
    n = SAMPLES // TURNS
    unit = 360 * 64 / n
    turn = [ydlidar.Packet(0, 0, (12000,), is_ring_start=True)]
    for first in range(0, n, PACKET):
        samples = tuple(round(4000 * (3 + math.sin(i / 40))) for i in range(first, min(first + PACKET, n)))
        turn.append(ydlidar.Packet(round(first * unit), round((first + len(samples) - 1) * unit), samples))
    return b"".join(packet.encode() for packet in turn) * TURNS


def rvr_second() -> tuple[rvr.Host, bytes]:
    """The computer, which has asked for it, and what the robot streams."""
    host, device = rvr.Host(), rvr.RvrEnd()
    for name, target, values in streaming(STREAMED, PERIOD):
        for command in device.receive(host.send(name, target=target, **values)):
            if isinstance(command, rvr.RvrCommand):
                device.follow(command)
    messages = [
        device.stream(
            StreamData(processor, slot, True, {name: dict.fromkeys(SERVICES[name].attributes, 0.3) for name in names})
        )
        for processor in Processor
        for slot, names in device.slots.of(processor).items()
    ]
    return host, b"".join(messages) * (1000 // PERIOD)


def milliseconds(receive: Callable[[bytes], object], data: bytes, piece: int = PIECE) -> float:
    """CPU time for a second of data, on average over SECONDS."""
    pieces = [data[i : i + piece] for i in range(0, len(data), piece)]
    start = time.process_time()
    for _ in range(SECONDS):
        for each in pieces:
            receive(each)
    return 1e3 * (time.process_time() - start) / SECONDS


def main() -> None:
    scan, decoder = lidar_second(), ydlidar.decoder()
    host, streamed = rvr_second()
    hub = multiflex.Distances(tuple(range(100, 900, 100))).encode() * FRAMES
    rows = {
        "lidar, packets": (decoder.receive, scan),
        "rvr": (host.receive, streamed),
        "hub": (multiflex.decoder().receive, hub),
    }
    print("| data | bytes/s | CPU ms for a second of it |\n|---|---|---|")
    for name, (receive, data) in rows.items():
        print(f"| {name} | {len(data)} | {milliseconds(receive, data):.2f} |")
    packets = [event for event in ydlidar.decoder().receive(scan) if isinstance(event, ydlidar.Packet)]
    points = milliseconds(lambda _: [packet.points() for packet in packets], b"once", len(b"once"))
    print(f"| lidar, points of the packets | | {points:.2f} |")


if __name__ == "__main__":
    main()
