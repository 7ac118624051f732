"""A race that takes a moment, with a journal; as a script, one that is killed again and again.

python -m tests.race.racing FOLDER SEED POINTS: runs an undisturbed race; then for each of so many random bytes of its
journal one that is killed when it has written that many, and resumes it. Says what differs, and exits with 1, if
anything does.
"""

import os
import random
import signal
import sys
from pathlib import Path

from mercator_design.race import IteratedRace, parse_space
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.record import Record
from mercator_design.race.session.runner import RaceRun
from mercator_design.race.session.task import Problem

SPACE = parse_space('x "--x " r (-5, 5)\ny "--y " r (-5, 5)\nrule "--rule " c (slow, fast, other)')
BUDGET = 300
TESTING = Testing(runs=20, elites=2, iterations=True)


def measure(item):
    """Noise and all, a pure function of configuration and seed."""
    (x, y, rule), seed = item
    noise = random.Random(seed + int(1000 * x)).gauss(0, 1)  # as a simulation's, of both
    score = (x - 1.5) ** 2 + (y + 1) ** 2 + (rule != "fast") + noise
    return Measurement(score, f"{score:.6f}")


class Measuring(Problem):
    """Runs a function on the values of configurations."""

    def __init__(self, race, seed, function):
        self.optimizer = race
        self.function = function
        self._seed = seed

    def item(self, experiment, configuration, *, test=False):
        seed = self.test_seed(experiment.instance) if test else self.seed(experiment.instance)
        return tuple(configuration.values()), seed

    def seed(self, instance):
        return 1000 * self._seed + instance

    def test_seed(self, instance):
        return 1_000_000 + instance


def runner(record, executor, *, race=None, seed=1, function=measure, budget=BUDGET, **options):
    race = race or IteratedRace(SPACE, budget=budget, seed=seed)
    if not record.record.start:
        record.begin({"race": "a test's", "budget": race.budget, "seed": seed})
    return RaceRun(Measuring(race, seed, function), executor, record, **options)


def run_all_tests(record, executor, **options):
    """Run the tests of a race that has ended."""
    runner(record, executor, testing=TESTING, **options).finish()


def undisturbed(seed=1, budgets=(BUDGET,), **options):
    record = Record()
    with ThreadExecutor(1) as executor:
        one = runner(record, executor, seed=seed, budget=budgets[0], **options)
        record.budgets += budgets[1:]
        one.finish()
    return record


def resumed(path, executor=None, seed=1, testing=None, **options):
    """Winner, digest and how many were run anew of a journal's race, run to its end and tested."""
    anew = []

    def counted(item):
        anew.append(item)
        return measure(item)

    with Journal(path, new=not path.exists()) as journal, executor or ThreadExecutor(1) as running:
        runner(journal, running, seed=seed, function=counted, testing=testing, **options).finish()
        return journal.record.ends[-1].winner, journal.record.digest(), len(anew)


def places(record):
    """Configuration and instance of each experiment."""
    return [(one.configuration, one.instance) for one in record.experiments.values()]


class _Killed:
    """Lets only so many bytes be written, and then kills."""

    def __init__(self, most):
        self._left = most
        self._write = os.write

    def __call__(self, file, data):
        self._left -= len(data)
        if self._left < 0:
            self._write(file, data[: self._left])
            os.kill(os.getpid(), signal.SIGKILL)
        return self._write(file, data)


def main(folder, seed, points):
    complete = folder / "whole.jsonl"
    resumed(complete, seed=seed, testing=TESTING)
    whole = read(complete).record
    expected = whole.ends[-1].winner, whole.digest()
    length = complete.stat().st_size
    draws = random.Random(seed)
    for point in [draws.randrange(length) for _ in range(points)]:
        path = folder / f"{point}.jsonl"
        child = os.fork()
        if child == 0:
            os.write = _Killed(point)
            resumed(path, ThreadExecutor(2), seed, TESTING)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        known = read(path).record if path.stat().st_size else Record()
        missing = len({*places(whole)} - {*places(known)} - known.speculative.keys())
        missing += len(whole.tests.keys() - known.tests.keys())
        winner, digest, anew = resumed(path, seed=seed, testing=TESTING)
        same = (winner, digest) == expected and read(path).record.tests == whole.tests
        if not os.WIFSIGNALED(status) or not same or anew != missing:
            print(f"killed at byte {point}: {status=}, {winner=}, {digest=}, {anew=}, {missing=}")  # noqa: T201
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
