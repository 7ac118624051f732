"""What a twin costs: all its robots' devices at work, and each driven ten times a second.

`python benchmarks/twin.py` prints the twin's own processor time for a second, how late it was at most, and what the
clients in this process heard.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.rvr_streaming import streaming


class Client:
    """Starts all that a robot has, drives it about, and counts the bytes that it hears."""

    def __init__(self, folder: Path, number: int, period: int) -> None:
        names = {device: folder / device for device in ("rvr", "lidar", "proximity")}
        self.fds = [os.open(name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for name in names.values()]
        self.host, self.heard = rvr.Host(), [0, 0, 0]
        self.speeds = 0.15 + 0.01 * (number % 5), 0.2 - 0.01 * (number % 7)
        start = [self.host.send("wake"), self.host.send("enable_color_detection", is_enabled=True)]
        start += [self.host.send(name, target=target, **values) for name, target, values in streaming(STREAMED, period)]
        os.write(self.fds[0], b"".join(start))
        os.write(self.fds[1], ydlidar.encode_command("scan"))
        os.write(self.fds[2], multiflex.BINARY_MODE.encode())

    def tick(self) -> None:
        left, right = self.speeds
        os.write(self.fds[0], self.host.send("drive_tank_si_units", left_velocity=left, right_velocity=right))
        os.write(self.fds[0], self.host.send("set_all_leds", led_group=0b111, led_brightness_values=(0, 114, 178)))
        for k, fd in enumerate(self.fds):
            with contextlib.suppress(BlockingIOError):
                self.heard[k] += len(os.read(fd, 65536))

    def close(self) -> None:
        for fd in self.fds:
            os.close(fd)


def measure(mission: str, robots: int, seconds: float, period: int) -> tuple[str, dict[str, list[float]]]:
    """What a twin says of how it kept time, and what was heard of each device of each robot [bytes/s].

    Args:
        mission: Whose arena it is.
        robots: How many.
        seconds: How long they are driven.
        period: Of streaming [ms].
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        line = [sys.executable, "-m", "mercator_design.twin", mission, "--set", f"robots={robots}", "--folder", name]
        with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            for _ in zip(range(robots), process.stdout or (), strict=False):
                pass
            try:
                clients = [Client(folder / str(number), number, period) for number in range(robots)]
                start = time.monotonic()
                ticks = 0
                while time.monotonic() - start < seconds:
                    for client in clients:
                        client.tick()
                    ticks += 1
                    time.sleep(max(0.0, start + 0.1 * ticks - time.monotonic()))
                took = time.monotonic() - start
            finally:
                process.terminate()
            _, output = process.communicate()
        for client in clients:
            client.close()
    heard = zip(*(client.heard for client in clients), strict=True)
    rates = ([count / took for count in counts] for counts in heard)
    return output.strip(), dict(zip(("rvr", "lidar", "proximity"), rates, strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mission", default="aggregation_20")
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--period", type=int, default=100, help="of streaming [ms]")
    options = parser.parse_args()
    output, heard = measure(options.mission, options.robots, options.seconds, options.period)
    print(f"{options.robots} robots in {options.mission}: {output}")
    for device, rates in heard.items():
        print(f"{device:10} {min(rates):8.0f} to {max(rates):8.0f} bytes/s of a robot")


if __name__ == "__main__":
    main()
