"""Races on a Dask cluster whose scheduler is killed at random points, and what comes of them when they are resumed.

For each way of handling failures and each point: a scheduler, --workers workers, a race, `kill -9` of the scheduler
when the journal has so many experiments, and a resume by threads. The winner and the digest of all experiments have to
be those of a race that lost nothing, no experiment may have failed, and the race has to end with exit code 75. Exits
with 1 if a point differs.

Run: python benchmarks/lost_schedulers.py [--points 10] [--mission aggregation] [--budget 600] [--seed 1]
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
LOST = os.EX_TEMPFAIL


@contextmanager
def started(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of a module that ends with the block."""
    silent = subprocess.DEVNULL
    with subprocess.Popen([sys.executable, "-m", *command], stdout=silent, stderr=silent) as process:
        try:
            yield process
        finally:
            process.kill()


def n_experiments(journal: Path) -> int:
    """Number of experiments that a journal has, while it is written."""
    return journal.read_bytes().count(b'"event":"experiment"') if journal.exists() else 0


def lose(folder: Path, race: list[str], point: int, workers: int) -> tuple[int, str]:
    """Run a race whose scheduler is killed when so many experiments are recorded; its exit code and messages."""
    with ExitStack() as running:
        file = folder.with_suffix(".json")
        options = ["--scheduler-file", str(file), "--no-dashboard"]
        scheduler = running.enter_context(started("distributed.cli.dask_scheduler", "--port", "0", *options))
        for _ in range(workers):
            running.enter_context(started("distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *options))
        while not file.exists():
            time.sleep(0.05)
        command = [*race, "-o", str(folder), "--executor", "dask", "--scheduler", str(file)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            while process.poll() is None and n_experiments(folder / JOURNAL) < point:
                time.sleep(0.01)
            scheduler.kill()
            _, told = process.communicate()
        return process.returncode, told


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=10)
    parser.add_argument("--mission", default="aggregation")
    parser.add_argument("--budget", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    race = [*MDESIGN, "race", given.mission, "--set", "duration=10", "--budget", str(given.budget)]
    race += ["--seed", str(given.seed), "--no-report"]
    draws, n_different = random.Random(given.seed), 0
    with tempfile.TemporaryDirectory() as temporary:
        whole = Path(temporary) / "whole"
        subprocess.run([*race, "-o", str(whole)], check=True, capture_output=True)
        record = read(whole / JOURNAL).record
        expected = record.ends[-1].winner, record.digest()
        print(f"not lost: winner {expected[0]} after {len(record.experiments)} experiments")
        for on_failure in ("stop", "reject"):
            for point in sorted(draws.sample(range(1, len(record.experiments)), given.points)):
                folder = Path(temporary) / f"{on_failure}-{point}"
                code, told = lose(folder, [*race, "--on-failure", on_failure], point, given.workers)
                kept = len(read(folder / JOURNAL).record.experiments)
                if code == LOST:
                    resume = [*MDESIGN, "race", "--resume", str(folder), "--no-report"]
                    subprocess.run(resume, check=True, capture_output=True)
                record = read(folder / JOURNAL).record
                found = record.ends[-1].winner, record.digest()
                n_failed = sum(bool(one.failure) for one in record.experiments.values())
                wrong = [
                    word
                    for word, is_so in (
                        ("other winner", found[0] != expected[0]),
                        ("other experiments", found[1] != expected[1]),
                        ("other exit code", code != LOST),
                        ("traceback", "Traceback" in told),
                        ("failures", n_failed > 0),
                    )
                    if is_so
                ]
                n_different += bool(wrong)
                print(
                    f"{on_failure:6}  killed at {point:5}: exit code {code}, {kept:5} experiments kept, "
                    f"{n_failed} failed; resumed: winner {found[0]}  {', '.join(wrong) or 'the same'}",
                    flush=True,
                )
                if wrong:
                    print(told, flush=True)
    return int(n_different > 0)


if __name__ == "__main__":
    sys.exit(main())
