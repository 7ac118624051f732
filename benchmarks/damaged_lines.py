"""How many neighbours a robot counts whose lidar's line is damaged, against how many there are.

`python benchmarks/damaged_lines.py` has a robot of the twin stand in simulated time, without ports, among three others
that stand or drive in circles around it, while a fraction of the bytes that its lidar sends has a bit flipped. For each
rate it prints what arrives whole; how many neighbours the robot perceives, and how many it would perceive if it had the
lidar's last turn alone and kept nothing of the one before; in how many control cycles the number is the true one; and
after how long a run that needs the lidar would end.

With `--frames` it damages what the RVR and the hub send in the same way, and prints of how many frames that were
damaged the checksum is right nevertheless. Then it damages commands to drive on their way to the RVR, and its answers,
and prints what share is answered, how many commands are refused as damaged, and how many are obeyed with other speeds.
"""

import argparse
import math
import random
import re
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.missions.mission import Mission, load_mission
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.sweep import Sweep
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.rvr_messages import DAMAGED, Error
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.run.monitor import Monitor
from mercator_design.robot.run.senses import Senses
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.twin.arena import TwinArena, without_noise
from mercator_design.twin.faults import Flip, Lose, Script
from mercator_design.twin.twin import Twin

RATES = (0.0, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02)
"""Of bytes that have a bit flipped."""

FrameDevice: TypeAlias = Literal["rvr", "proximity"]
_FRAMES: dict[FrameDevice, re.Pattern[bytes]] = {
    "rvr": re.compile(rb"\x8d[^\xd8]*\xd8"),
    "proximity": re.compile(rb"MF.{18}", re.DOTALL),
}
_TICK, _CYCLE, _BEGIN = 0.01, 10, 2.0  # [s], ticks, [s] until all is heard
_AROUND = ((0.45, 0.3), (0.55, 2.4), (0.6, -1.7))  # distance [m] and bearing [rad] of the others
_CIRCLES = 0.1, 0.13  # [m/s] of their treads
_SPEEDS = (0.0, 0.3, -0.3, 0.15, -0.12, 0.21)  # [m/s] of commands to drive


class Cycle(NamedTuple):
    """What a robot perceives in a control cycle.

    alone: Neighbours in the lidar's last turn alone.
    share: Of the lidar's turns that arrived whole lately.
    is_silent: Whether a run that needs the lidar would end.
    """

    neighbours: int
    alone: int
    share: float
    is_silent: bool


class _LastTurn(Sweep):
    """One that keeps nothing of the turn before."""

    def _count(self, packet: ydlidar.Packet, read: float) -> bool:
        super()._count(packet, read)
        return False


def perceived(rate: float, seconds: float, *, is_moving: bool, seed: int = 1) -> Iterator[Cycle]:
    """What a robot perceives in each control cycle, among three others."""
    twin = Twin(TwinArena(_mission(), without_noise(load_robot_model("mercator")), 1), _faults(rate, seed))
    settings = Settings()
    senses, alone = (Senses(settings, ("neighbours",), settings.labels_of({})) for _ in range(2))
    monitor = Monitor(settings.limits, senses, Answers(), str)
    alone.sweep = _LastTurn()
    robot, *others = twin.robots
    host, lidar = rvr.Host(), ydlidar.decoder()
    robot.note_port("lidar", is_open=True, now=0.0)
    robot.lidar.receive(ydlidar.encode_command("scan"), 0.0)
    for name, target, values in streaming(STREAMED, 50):
        robot.receive("rvr", host.send(name, target=target, **values), 0.0)
    left, right = _CIRCLES if is_moving else (0.0, 0.0)
    drive = rvr.Host().send("drive_tank_si_units", left_velocity=left, right_velocity=right)
    for tick in range(1, round((_BEGIN + seconds) / _TICK) + 1):
        now = round(tick * _TICK, 6)
        for number, device, said in twin.advance(now):
            if number == 0 and device != "proximity":
                for event in (host if device == "rvr" else lidar).receive(said):
                    senses.take(event, now)
                    alone.take(event, now)
        if tick % _CYCLE == 0:
            for other in others:
                other.receive("rvr", drive, now)
            for _ in monitor.check(now, {"rvr": host.counts, "lidar": lidar.counts, "proximity": Counts()}):
                pass
            is_silent, share = "lidar" in senses.stale(now), senses.lines["lidar"].share
            senses.lines["lidar"].min_share = 0.0  # so that it is seen what would be perceived
            whole, last = (int(each.readings(now).neighbours) for each in (senses, alone))
            if now > _BEGIN:
                yield Cycle(whole, last, share, is_silent)
            senses.lines["lidar"].min_share = settings.limits.lidar_whole


def _faults(rate: float, seed: int) -> Script:
    flip = Flip(at=0.0, robot=0, device="lidar", direction="from_robot", rate=rate)
    return Script(seed=seed, faults=(flip,))


def _mission() -> Mission:
    poses = [(0.0, 0.0, 0.0), *((r * math.cos(at), r * math.sin(at), at + math.pi / 2.0) for r, at in _AROUND)]
    placement = "{shape: poses, poses: [" + ", ".join(f"[{x:.6f}, {y:.6f}, {at:.6f}]" for x, y, at in poses) + "]}"
    return load_mission("aggregation", [f"robots={len(poses)}", f"placement={placement}"])


def passed(device: FrameDevice, rate: float, frames: int) -> tuple[float, int]:
    """What share of what the RVR or the hub sends arrives whole, and how many damaged frames pass for sound ones."""
    twin = Twin(TwinArena(_mission(), load_robot_model("mercator"), 1))
    robot, *_ = twin.robots
    host, hub = rvr.Host(), multiflex.decoder()
    for name, target, values in streaming(STREAMED, 50):
        robot.receive("rvr", host.send(name, target=target, **values), 0.0)
    advance = robot.rvr.advance if device == "rvr" else robot.hub.advance
    flip, chance = Flip(at=0.0, robot=0, device=device, rate=rate), random.Random(1)
    tick = wrong = count = 0
    while count < frames:
        tick += 1
        for sent in _FRAMES[device].findall(advance(round(tick * _TICK, 6))):
            count += 1
            came = b"".join(flip.damaged(byte, chance) for byte in sent)
            heard = len(host.receive(came) if device == "rvr" else hub.receive(came))
            wrong += heard if came != sent else 0
    counts = host.counts if device == "rvr" else hub.counts
    return 1.0 - counts.lost / counts.received, wrong


def print_passed(frames: int) -> None:
    print("| line | bytes with a flipped bit | whole | damaged frames that pass |\n|---|---|---|---|")
    devices: tuple[FrameDevice, ...] = ("rvr", "proximity")
    for device in devices:
        for rate in (0.001, 0.005, 0.02, 0.035):
            whole, wrong = passed(device, rate, frames)
            print(f"| {device} | {100.0 * rate:g} % | {100.0 * whole:.1f} % | {wrong} of {frames} |")


class Commanded(NamedTuple):
    """What becomes of commands to drive.

    answered: Share that is answered with success.
    refused: How many are refused as damaged.
    wrong: How many are obeyed with other speeds.
    """

    answered: float
    refused: int
    wrong: int


def commanded(fault: Flip | Lose, commands: int) -> Commanded:
    """What becomes of commands to drive, and of their answers, on a damaged line."""
    host, device, chance = rvr.Host(), rvr.RvrEnd(), random.Random(1)

    def damaged(sent: bytes) -> bytes:
        return b"".join(fault.damaged(byte, chance) for byte in sent)

    answered = refused = wrong = 0
    for _ in range(commands):
        left, right = chance.choices(_SPEEDS, k=2)
        sent = host.send("drive_tank_si_units", reply=rvr.Flags.ANSWER, left_velocity=left, right_velocity=right)
        for heard in device.receive(damaged(sent)):
            error = heard.error if isinstance(heard, rvr.Unknown) else Error.SUCCESS
            if not isinstance(heard, rvr.Unknown) and heard.name == "drive_tank_si_units":
                numbers = heard.values.values()
                if not all(math.isfinite(value) for value in numbers):
                    error = Error.BAD_DATA_VALUE
                else:
                    wrong += [*numbers] != [_single(left), _single(right)]
            for said in host.receive(damaged(device.answer(heard.frame, error))):
                if isinstance(said, rvr.Response):
                    answered += not said.error
                    refused += said.error in DAMAGED
    return Commanded(answered / commands, refused, wrong)


def _single(value: float) -> float:
    """As the line carries it."""
    return float(struct.unpack(">f", struct.pack(">f", value))[0])


def print_commanded(commands: int) -> None:
    print("\n| bytes | answered | refused as damaged | obeyed with other speeds |\n|---|---|---|---|")
    for rate in (0.001, 0.005, 0.01, 0.02):
        faults: tuple[Flip | Lose, ...] = tuple(kind(at=0.0, robot=0, device="rvr", rate=rate) for kind in (Flip, Lose))
        for fault, words in zip(faults, ("with a flipped bit", "lost"), strict=True):
            found = commanded(fault, commands)
            row = [f"{100.0 * rate:g} % {words}", f"{100.0 * found.answered:.1f} %"]
            print(f"| {' | '.join([*row, *(f'{count} of {commands}' for count in found[1:])])} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=60.0, help="For each rate.")
    parser.add_argument("--frames", type=int, help="Of the RVR and the hub, instead.")
    given = parser.parse_args()
    if given.frames is not None:
        print_passed(given.frames)
        print_commanded(given.frames)
        return
    seconds: float = given.seconds
    print("| bytes with a flipped bit | others | whole | perceived | true number in | last turn alone | a run ends |")
    print("|---|---|---|---|---|---|---|")
    for is_moving in (False, True):
        true = [cycle.neighbours for cycle in perceived(0.0, seconds, is_moving=is_moving)]
        for rate in RATES:
            cycles = [*perceived(rate, seconds, is_moving=is_moving)]
            found = [cycle.neighbours for cycle in cycles]
            same = sum(a == b for a, b in zip(found, true, strict=True)) / len(true)
            ends = next((k * _TICK * _CYCLE for k, cycle in enumerate(cycles) if cycle.is_silent), None)
            row = [
                f"{100.0 * rate:g} %",
                "drive" if is_moving else "stand",
                f"{100.0 * sum(cycle.share for cycle in cycles) / len(cycles):.1f} %",
                f"{sum(found) / len(found):.2f}",
                f"{100.0 * same:.1f} %",
                f"{sum(cycle.alone for cycle in cycles) / len(cycles):.2f}",
                "no" if ends is None else f"after {ends:.1f} s",
            ]
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
