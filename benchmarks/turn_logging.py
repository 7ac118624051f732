"""Does the logging of lidar turns make control cycles later? Robots of one twin, half of them without it, at once.

Each round is a run of explorers in map_dodecagon. In the first round the robots of even numbers write their turns, in
the second the others, and so on, so that neither the place nor the load of the machine favours one. The rest of their
program is the same: only the function that collects turns returns none.

Late are control cycles that began more than 5 ms from when they were due.

Run: python benchmarks/turn_logging.py [--robots 2] [--rounds 4] [--duration 60]
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.robot_cycles import Kept, kept, most

_RUN = "from mercator_design.robot.cli import main; main()"
_WITHOUT = (
    f"from mercator_design.robot.logs.turns import TurnCollector; TurnCollector.take = lambda self, heard: []; {_RUN}"
)
_EXPLORATION = "--nstates 1 --s0 0 --rwm0 20\n"


def round_of(folder: Path, robots: int, duration: float, number: int) -> dict[bool, list[Path]]:
    """The logs of a run, by whether they have turns."""
    (folder / "fsm.txt").write_text(_EXPLORATION)
    line = [sys.executable, "-m", "mercator_design.twin", "map_dodecagon", "--set", f"robots={robots}"]
    found: dict[bool, list[Path]] = {True: [], False: []}
    with subprocess.Popen([*line, "--folder", folder / "twin"], stdout=subprocess.PIPE, text=True) as twin:
        if twin.stdout is None or not all(twin.stdout.readline() for _ in range(robots)):
            sys.exit("the twin has not begun")
        try:
            runs = []
            for k in range(robots):
                has_turns = (k + number) % 2 == 0
                log = folder / f"{number}-{k}.jsonl"
                found[has_turns].append(log)
                options = ["--robot", f"{folder}/twin/{k}/robot.yaml", "--duration", f"{duration:g}", "-o", str(log)]
                program = [sys.executable, "-c", _RUN if has_turns else _WITHOUT, "run", f"{folder}/fsm.txt", *options]
                runs.append(subprocess.Popen(program, stdout=subprocess.DEVNULL))
            for run in runs:  # a run that the watchdog has stopped counts until then
                run.wait()
        finally:
            twin.terminate()
    return found


def row(name: str, logs: list[Path]) -> str:
    """Figures of all cycles of some logs."""
    all_of: list[Kept] = [kept(log) for log in logs]
    periods = [period for one in all_of for period in one.periods]
    late = 1.0 - sum(one.near * len(one.periods) for one in all_of) / len(periods)
    cpu = sum(sum(one.program_cpu) for one in all_of) / len(periods)
    size = sum(log.stat().st_size for log in logs) / len(periods) * 600.0 / 1e6
    figures = (
        f"{100.0 * late:.2f} % of {len(periods)}",
        f"{1e3 * most(periods):.1f}",
        f"{1e3 * cpu:.2f}",
        f"{size:.2f}",
    )
    return f"| {name} | {' | '.join(figures)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--duration", type=float, default=60.0, help="seconds of a round")
    given = parser.parse_args()
    logs: dict[bool, list[Path]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as name:
        for number in range(given.rounds):
            for has_turns, new in round_of(Path(name), given.robots, given.duration, number).items():
                logs[has_turns] += new
        print("| log | late cycles | 99 % of periods below [ms] | CPU of the program a cycle [ms] | MB a minute |")
        print("|---|---|---|---|---|")
        print(row("with turns", logs[True]))
        print(row("without", logs[False]))


if __name__ == "__main__":
    main()
