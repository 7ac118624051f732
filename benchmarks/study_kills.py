"""A study that is killed at random moments, and what comes of it; and how long an undisturbed one takes to its page.

Runs a study of 2 methods x 2 missions x --repetitions at --budget once, and again with `kill -9` --kills times: each up
to a second after a random number of experiments, so that what has run grows from kill to kill. The tables have to be
the same to the last digit. Exits with 1 if they differ.

Run: python benchmarks/study_kills.py [--kills 10] [--budget 500] [--repetitions 3] [--runs 100] [--seed 1] [--jobs 2]
"""

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mercator_design.errors import RaceError, StudyError
from mercator_design.studies.reading import read_status

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
PLAN = """
schema: 1
budgets: [{budget}]
repetitions: {repetitions}
methods: {{halving: {{}}, random: {{method: random}}}}
missions: [aggregation, foraging]
assess: {{runs: {runs}, realities: [mercator-pseudo-reality]}}
"""
FILES = ("tables/runs.csv", "tables/designs.csv", "tables/comparisons.csv", "tables/scores.tex")


def done(folder: Path) -> int:
    """Experiments that a study has run."""
    try:
        return read_status(folder).done
    except (StudyError, RaceError):  # not begun
        return 0


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--budget", type=int, default=500)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    draws = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as temporary:
        whole, killed, plan = (Path(temporary) / name for name in ("whole", "killed", "kills.yaml"))
        plan.write_text(PLAN.format(**vars(given)))
        command = [*MDESIGN, "study", str(plan), "-j", str(given.jobs), "-q", "-o"]
        started = time.monotonic()
        subprocess.run([*command, str(whole)], check=True, stdout=subprocess.DEVNULL)
        seconds, total = time.monotonic() - started, done(whole)
        figures = [*whole.glob("figures/*.pdf")]
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(
            f"undisturbed: {total} experiments, page, tables and {len(figures)} PDFs in {seconds:.0f} s, "
            f"{usage.ru_utime + usage.ru_stime:.0f} s of processors",
            flush=True,
        )
        for number in range(1, given.kills + 1):
            before = done(killed)
            target = before + draws.randrange(max(2 * (total - before) // (given.kills - number + 2), 1))
            with subprocess.Popen([*command, str(killed)], stdout=subprocess.DEVNULL) as process:
                while process.poll() is None and done(killed) < target:
                    time.sleep(0.1)
                time.sleep(draws.uniform(0.0, 1.0))
                process.kill()
                code = process.wait()
            print(f"kill {number}: exit code {code}, {done(killed)} experiments kept", flush=True)
        subprocess.run([*command, str(killed)], check=True, stdout=subprocess.DEVNULL)
        expected, found = contents(whole), contents(killed)
        wrong = [name for name in FILES if expected[name] != found[name]]
        print(f"resumed: {', '.join(wrong) + ' differ' if wrong else 'the same tables'}")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
