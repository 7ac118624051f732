"""How often races on missions say that they stagnate, and what they would have missed.

python benchmarks/stagnation.py [-j JOBS] [--seeds N] [--budget N] [MISSION ...]

Of each mission: the races whose first iteration found no difference between configurations, those that noted no gain,
when, and how much better on 100 fresh instances the final winner was than the best was then; of races that noted none,
how much better it was than the best after two fifths of the budget.
"""

import argparse
from typing import NamedTuple

import numpy as np

from mercator_design.designer import Designer
from mercator_design.missions.mission import load_mission
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import Executor, available_jobs, in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.record import Record
from mercator_design.race.session.runner import RaceRun
from mercator_design.sim.simulate import Simulator

TESTS = 100


class Noted(NamedTuple):
    """When a race noted that it no longer gained, and what it gained after that."""

    noisy: bool  # whether its first iteration found no difference
    noted: bool  # whether it noted that it no longer gained
    when: float  # as a part of the budget
    gain: float
    score: float  # of the winner, on fresh instances


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("missions", nargs="*", default=["aggregation", "foraging"])
    parser.add_argument("-j", "--jobs", type=int, default=available_jobs())
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--method", default="irace")
    arguments = parser.parse_args()
    print(f"method {arguments.method}, budget {arguments.budget}, {arguments.seeds} races each")
    with ThreadExecutor(arguments.jobs) as executor:
        for mission in arguments.missions:
            races = [raced(mission, seed, arguments, executor) for seed in range(1, arguments.seeds + 1)]
            noisy = sum(one.noisy for one in races)
            noted = [one for one in races if one.noted]
            others = [one for one in races if not one.noted]
            when = [f"{one.when:.0%}" for one in noted]
            print(
                f"{mission}: {noisy} of {len(races)} first iterations found no difference; {len(noted)} noted no gain, "
                f"after {', '.join(when)} of the budget; gain after that {figures(noted)}; gain of the others after "
                f"40% {figures(others)}"
            )


def raced(mission: str, seed: int, arguments: argparse.Namespace, executor: Executor) -> Noted:
    simulator = Simulator(load_mission(mission))
    designer = Designer(simulator, budget=arguments.budget, seed=seed, method=arguments.method)
    record = Record()
    record.begin(designer.start())
    RaceRun(designer, executor, record).finish()
    iterations = [one for _, one in sorted(record.iterations.items())]
    noted = next((one for one in iterations[1:] if one.note), None)
    used = np.cumsum([one.used for one in iterations])
    last = iterations.index(noted) if noted else int(np.argmax(used >= 0.4 * arguments.budget))
    bests = [iterations[last].elites[0], record.ends[-1].winner]
    items = [
        designer.item(Experiment(number, k), record.configurations[number], test=True)
        for number in bests
        for k in range(TESTS)
    ]
    costs = [designer.cost(one.score) for one in in_order(executor, designer.function, items)]
    before, after = float(np.mean(costs[:TESTS])), float(np.mean(costs[TESTS:]))
    return Noted(
        noisy=bool(iterations[0].note),
        noted=noted is not None,
        when=float(used[last]) / arguments.budget,
        gain=before - after,
        score=simulator.mission.score(after),
    )


def figures(races: list[Noted]) -> str:
    if not races:
        return "-"
    gains = [one.gain for one in races]
    return f"{np.mean(gains):.3g} (of {np.mean([one.score for one in races]):.3g})"


if __name__ == "__main__":
    main()
