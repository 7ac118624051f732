"""What decoding the three devices' data costs: CPU time for each second of what they send.

The lidar sends 5000 samples a second in 7 turns, of which all points are computed; the RVR streams the eight services
of the original robot, and the hub measures, at the rates given. Bytes are handed over in pieces, as a serial port does.
Run: python benchmarks/codecs.py [--period MS] [--hub HZ] [--piece BYTES] [--seconds N]
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.robot import multiflex, rvr, ydlidar
from mercator_design.robot.rvr_messages import Processor
from mercator_design.robot.rvr_streaming import SERVICES, StreamData, streaming

SAMPLES, TURNS, PACKET = 5000, 7, 40
STREAMED = [
    "accelerometer",
    "gyroscope",
    "imu",
    "quaternion",
    "locator",
    "velocity",
    "color_detection",
    "ambient_light",
]


def lidar_second() -> bytes:
    """Ring starts, and packets between them, in a room of 2 m to 4 m."""
    n = SAMPLES // TURNS
    unit = 360 * 64 / n
    turn = [ydlidar.Packet(0, 0, (12000,), is_ring_start=True)]
    for first in range(0, n, PACKET):
        samples = tuple(round(4000 * (3 + math.sin(i / 40))) for i in range(first, min(first + PACKET, n)))
        turn.append(ydlidar.Packet(round(first * unit), round((first + len(samples) - 1) * unit), samples))
    return b"".join(packet.encode() for packet in turn) * TURNS


def rvr_second(period: int) -> tuple[rvr.Host, bytes]:
    """The computer, which has asked for it, and what the robot streams."""
    host, device = rvr.Host(), rvr.Device()
    for name, target, values in streaming(STREAMED, period):
        device.receive(host.send(name, target=target, **values))
    told = [
        device.stream(
            StreamData(processor, slot, True, {name: dict.fromkeys(SERVICES[name].attributes, 0.3) for name in names})
        )
        for processor in Processor
        for slot, names in device.slots.of(processor).items()
    ]
    return host, b"".join(told) * (1000 // period)


def milliseconds(receive: Callable[[bytes], object], data: bytes, piece: int, seconds: int) -> float:
    """CPU time for each of so many seconds."""
    pieces = [data[i : i + piece] for i in range(0, len(data), piece)]
    start = time.process_time()
    for _ in range(seconds):
        for each in pieces:
            receive(each)
    return 1e3 * (time.process_time() - start) / seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--period", type=int, default=100, metavar="MS", help="of the RVR's streaming")
    parser.add_argument("--hub", type=int, default=50, metavar="HZ", help="frames of the hub a second")
    parser.add_argument("--piece", type=int, default=64, metavar="BYTES")
    parser.add_argument("--seconds", type=int, default=100, metavar="N", help="of data")
    given = parser.parse_args()

    scan, decoder = lidar_second(), ydlidar.decoder()
    packets = ydlidar.decoder().receive(scan)
    host, streamed = rvr_second(given.period)
    hub = multiflex.Distances(tuple(range(100, 900, 100))).encode() * given.hub
    rows = {
        "lidar, packets": (decoder.receive, scan),
        "rvr": (host.receive, streamed),
        "hub": (multiflex.decoder().receive, hub),
    }
    print("| data | bytes/s | CPU ms for a second of it |\n|---|---|---|")
    for name, (receive, data) in rows.items():
        print(f"| {name} | {len(data)} | {milliseconds(receive, data, given.piece, given.seconds):.2f} |")
    points = milliseconds(
        lambda _: [p.points() for p in packets if isinstance(p, ydlidar.Packet)], b"0", 1, given.seconds
    )
    print(f"| lidar, points of the packets | | {points:.2f} |")


if __name__ == "__main__":
    main()
