"""What a robot that turns on the spot makes of the robots around it, which its lidar sees one after the other.

`python benchmarks/turning.py` simulates an X4 that turns 7 times a second, and an RVR that tells every 50 ms how it
stood 10 ms before. It prints, for several speeds, in how many control cycles the robot finds as many robots as there
are, and by how much their bearings are wrong; first as if nobody told how the robot turns.
"""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.modules.clustering import lidar_neighbours
from mercator_design.modules.reference import ReferenceModel
from mercator_design.robot.devices.samples import Sample, heading
from mercator_design.robot.devices.sweep import BINS, STEP, Sweep
from mercator_design.robot.protocols.ydlidar import SAMPLE_RATE, Packet, correction

ROBOTS = ((0.2, 0.4), (1.7, 0.3), (3.0, 0.6), (-1.6, 0.5), (-0.6, 0.45))
"""Bearings [rad] from where the robot looked first, and distances [m] of the others' lidar heads."""
SPEEDS = (0.0, 1.0, 2.0, 4.0, -4.0)
"""[rad/s]; treads at 0.3 m/s, one backwards, make 4.1."""

_TURN = 360 * 64  # the unit of angles in packets
_SAMPLES, _PACKET = 714, 40  # of a turn at 7 Hz; of a packet
_HEAD = 0.035  # [m] radius of a lidar's head
_CYCLE, _STREAM, _LATE = 0.1, 0.05, 0.01  # [s]


class Perceived(NamedTuple):
    """In a control cycle: how many robots, and the largest error of a bearing [rad] of one that is found."""

    robots: int
    error: float


def perceived(speed: float, seconds: float, *, is_corrected: bool) -> Iterator[Perceived]:
    """What a robot that turns at a speed [rad/s] perceives, cycle by cycle, once its lidar has gone round twice."""
    sweep, latest = Sweep(), dict[str, Sample]()
    streamed, cycle, sample = 0.0, 3 * _CYCLE, 0
    while (now := sample / SAMPLE_RATE) < seconds:
        if now >= streamed:
            streamed += _STREAM
            yaw = math.remainder(speed * (now - _LATE), math.tau)
            latest = {"attitude": Sample(now, (0.0, 0.0, yaw)), "turning": Sample(now, (0.0, 0.0, speed))}
        first = sample % _SAMPLES
        count = 1 if first == 0 else min(_PACKET, _SAMPLES - first)
        sample += count
        began, ended = now, (sample - 1) / SAMPLE_RATE
        angles = [round(_TURN * (first + k) / _SAMPLES) for k in range(count)]
        ranges = [
            _range(speed * (began + k / SAMPLE_RATE) - math.tau * angle / _TURN) for k, angle in enumerate(angles)
        ]
        packet = Packet(angles[0], angles[-1], tuple(round(4000 * r) for r in ranges), is_ring_start=first == 0)
        sweep.add(packet, *((heading(latest, began), heading(latest, ended)) if is_corrected else ()))
        if ended >= cycle:
            cycle += _CYCLE
            yield _find(sweep, heading(latest, ended) if is_corrected else 0.0, speed * ended)


def _range(towards: float) -> float:
    """What the lidar reads towards an angle [rad]; where that is depends on how far it is."""
    for at, distance in ROBOTS:
        if abs(math.remainder(towards + correction(distance) - at, math.tau)) < math.asin(_HEAD / distance):
            return distance
    return 0.0


def _find(sweep: Sweep, known: float, true: float) -> Perceived:
    distances, x, y = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
    n = lidar_neighbours(ReferenceModel(), sweep.ranges(), -known, STEP, distances, x, y)
    errors = []
    for k in range(n):
        at, _ = min(ROBOTS, key=lambda robot: abs(robot[1] - distances[k]))
        errors.append(abs(math.remainder(math.atan2(y[k], x[k]) - (at - true), math.tau)))
    return Perceived(n, max(errors, default=math.inf))


def main() -> None:
    print(
        "| turns, rad/s | corrected | all robots found | largest error of a bearing: median | maximum |\n"
        "|---|---|---|---|---|"
    )
    for is_corrected in (False, True):
        for speed in SPEEDS:
            cycles = [*perceived(speed, 60.0, is_corrected=is_corrected)]
            right = sum(found.robots == len(ROBOTS) for found in cycles) / len(cycles)
            errors = sorted(math.degrees(found.error) for found in cycles)
            row = [f"{speed:g}", "yes" if is_corrected else "no", f"{100.0 * right:.1f} %"]
            print(f"| {' | '.join(row)} | {errors[len(errors) // 2]:.1f}° | {errors[-1]:.1f}° |")


if __name__ == "__main__":
    main()
