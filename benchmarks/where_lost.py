"""Where a race loses the best design: never proposed, dropped too early, or beaten by luck at the end?

Each race is run to its end. Then all configurations that it ran are raced again on fresh instances: all on a few, the
best RATIO of them on more, until some FINALISTS are left, which are chosen on fresh instances and scored on others, so
that no score is selected. So for each race:

* chosen: the score of its winner;
* kept: of the best former elite, chosen on fresh instances; above `chosen`: the confirmation was beaten by luck;
* sampled: of the best configuration that it ran; above `kept`: it was dropped too early; and how many results it had;
* others: of the best winner of the other races; above `sampled`: the race never proposed anything as good.

With --given, each race is also run again with the best winner of the others among its first configurations: whether it
keeps it, and what its winner then scores.

Scores are means of FRESH instances, as in mission_quality.py; all are divided by the best winner's distance from random
configurations, so 1 is the best winner.

Run: python benchmarks/where_lost.py [--missions NAME ...] [--budget 20000] [--seeds 4] [--method default] [--given]
         [-j N]
"""

import argparse
import multiprocessing
import multiprocessing.pool
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.mission_quality import FRESH, MISSIONS, SWARMS, MissionProblem, problem
from benchmarks.race_results import options_of
from mercator_design.api import fresh_instances
from mercator_design.race import Configuration, Halving
from mercator_design.race.space.parameter import key_of

FIRST_RUNS = 3
"""Fresh instances that all configurations run on."""
RATIO = 6
FINALISTS = 12


class Found(NamedTuple):
    """What one race found; scores as values to maximise."""

    chosen: float
    kept: float
    sampled: float
    n_results: int  # of the best sampled configuration, in the race
    generation: int  # that it entered in
    n_generations: int
    winner: Configuration


def best_of(mission: MissionProblem, configurations: Sequence[Configuration], seed: int) -> int:
    """The place of the best configuration, by halving on instances of a seed."""
    left, total, first, n = np.arange(len(configurations)), np.zeros(len(configurations)), 0, FIRST_RUNS
    while len(left) > 1:
        instances = fresh_instances(seed, first + n)[first:]
        total[left] += n * mission.values([configurations[k] for k in left.tolist()], instances)
        first += n
        last = len(left) <= FINALISTS
        left = left[np.argsort(-total[left])[: 1 if last else max(FINALISTS, len(left) // RATIO)]]
        n *= RATIO - 1  # fewer in all from step to step
    return int(left[0])


def race(name: str, seed: int, budget: int, method: str, given: Sequence[Configuration] = ()) -> Halving:
    """A race to its end."""
    mission = problem(name)
    mission.start(seed)
    optimizer = Halving(mission.space, budget=budget, seed=seed, options=options_of(method), initial=given)
    while batch := optimizer.ask():
        optimizer.tell([mission.cost(optimizer.configurations[e.configuration], e.instance) for e in batch])
    return optimizer


def searched(task: tuple[str, int], budget: int, method: str) -> Found:
    """A race, and all its configurations again."""
    name, seed = task
    mission, optimizer = problem(name), race(name, seed, budget, method)
    known, history = optimizer.configurations, optimizer.history
    numbers = history.different([n for n, own in enumerate(history.costs) if own])
    former = history.former_elites
    kept = known[former[best_of(mission, [known[n] for n in former], seed=1)]]
    best = numbers[best_of(mission, [known[n] for n in numbers], seed=1)]
    winner = known[optimizer.best.configuration]
    chosen, again, sampled = mission.values([winner, kept, known[best]], fresh_instances(0, FRESH)).tolist()
    bounds = np.cumsum([one.n_new for one in history.iterations])
    n_generations = sum(not one.postselection for one in history.iterations)
    return Found(
        chosen,
        again,
        sampled,
        len(history.costs[best]),
        int(np.searchsorted(bounds, best, "right")) + 1,
        n_generations,
        winner,
    )


def with_given(task: tuple[str, int, Configuration], budget: int, method: str) -> tuple[bool, float]:
    """Whether a race's winner is a configuration that it was given, and the winner's score."""
    name, seed, given = task
    optimizer = race(name, seed, budget, method, [given])
    winner = optimizer.configurations[optimizer.best.configuration]
    score = problem(name).values([winner], fresh_instances(0, FRESH))[0]
    return key_of(winner) == key_of(optimizer.configurations[0]), float(score)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--missions", nargs="+", choices=[*MISSIONS, *SWARMS], default=["homing 5", "foraging 13"], metavar="NAME"
    )
    parser.add_argument("--budget", type=int, default=20_000)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--method", default="default")
    parser.add_argument("--given", action="store_true", help="also give each race the best winner of the others")
    parser.add_argument("-j", "--jobs", type=int, default=1)
    given = parser.parse_args()
    with multiprocessing.get_context("fork").Pool(given.jobs) as pool:
        for name in given.missions:
            report(name, given, pool)


def report(name: str, given: argparse.Namespace, pool: multiprocessing.pool.Pool) -> None:
    options = {"budget": given.budget, "method": given.method}
    seeds = range(1, given.seeds + 1)
    found = pool.map(partial(searched, **options), [(name, seed) for seed in seeds], chunksize=1)
    mission = problem(name)
    low = (1 if mission.is_maximised else -1) * float(mission.random_scores().mean())
    best = max(one.chosen for one in found)

    def scaled(value: float) -> str:
        return f"{(value - low) / (best - low):.3f}"

    print(f"\n## {name}, {given.budget}: 1 is {abs(best):.4g}, 0 is {abs(low):.4g}\n")
    print("| seed | chosen | kept | sampled | its results | its generation | others | given: kept | given: chosen |")
    print("|---" * 9 + "|")
    other = [max((one for one in found if one is not own), key=lambda one: one.chosen) for own in found]
    again = [(False, np.nan)] * len(found)
    if given.given:
        tasks = [(name, seed, one.winner) for seed, one in zip(seeds, other, strict=True)]
        again = pool.map(partial(with_given, **options), tasks, chunksize=1)
    for seed, own, rival, (is_kept, score) in zip(seeds, found, other, again, strict=True):
        cells = [scaled(own.chosen), scaled(own.kept), scaled(own.sampled), own.n_results]
        cells += [f"{own.generation} of {own.n_generations}", scaled(rival.chosen)]
        cells += [{True: "yes", False: "no"}[is_kept], scaled(score)] if given.given else ["", ""]
        print(f"| {seed} | {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
