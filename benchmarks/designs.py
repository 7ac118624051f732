"""Does the winner of a race mean something? Its score on fresh instances, against random and hand-made software.

For each mission: a race, then its winner, random valid control software of the flavour and, for Watermelon, two PFSMs
made by hand (AutoMoDe's examples W1, which stops on black, and W1b, which explores) on the same instances, which the
race has not seen. Prints a Markdown table. The p is of Wilcoxon's signed-rank test over the instances, of the winner
against the mean of the random ones.

Run: python benchmarks/designs.py [--flavour maple-mercator] [--method halving] [--budget 3000] [--seed 1]
         [--random 200] [--instances 100] [MISSION ...]
"""

import argparse
import sys

import numpy as np
from scipy.stats import wilcoxon

from mercator_design.api import evaluate, fresh_instances
from mercator_design.config import shipped
from mercator_design.designer import Designer, flavour_space
from mercator_design.fsm import parse
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.race.executors.executor import available_jobs
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS
from mercator_design.race.session.runner import RaceRun
from mercator_design.seeds import generator
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import decoded

HAND_MADE = {
    "W1": "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1",
    "W1b": "--nstates 1 --s0 0 --rwm0 5",
}


def random_software(flavour: str, n: int, seed: int) -> list[Software]:
    """Control software with every parameter uniform over its domain."""
    space = flavour_space(flavour)
    draws = generator(seed, "random software")
    configurations = [space.build(lambda p, bounds: p.quantile(draws.random(), bounds)) for _ in range(n)]
    return [decoded(configuration, flavour) for configuration in configurations]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("missions", nargs="*", metavar="MISSION", default=list(shipped.missions()))
    parser.add_argument("--flavour", default=DEFAULT_FLAVOUR)
    parser.add_argument("--method", choices=METHODS, default=DEFAULT_METHOD)
    parser.add_argument("--budget", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--random", type=int, default=200)
    parser.add_argument("--instances", type=int, default=100)
    given = parser.parse_args()
    jobs, seeds = available_jobs(), fresh_instances(given.seed, given.instances)
    hand_made = {label: parse(text) for label, text in HAND_MADE.items() if given.flavour == DEFAULT_FLAVOUR}
    columns = (
        "mission",
        "winner: mean ± standard error",
        "better than random ones",
        "best random",
        "median random",
        "p",
    )
    print(f"| {' | '.join((*columns, *hand_made))} |")
    print("|---" * (len(columns) + len(hand_made)) + "|")
    for name in given.missions:
        mission = load_mission(name)
        simulator = Simulator(mission)
        with ThreadExecutor(jobs) as executor:
            options = {"flavour": given.flavour, "method": given.method}
            designer = Designer(simulator, budget=given.budget, seed=given.seed, **options)
            result = RaceRun(designer, executor).finish()

        def scores(software: Software, mission: Mission = mission) -> np.ndarray:
            return np.array(evaluate(mission, software, seeds=seeds, jobs=jobs).scores.values)

        winner = scores(designer.software(result.configuration))
        others = np.array([scores(one) for one in random_software(given.flavour, given.random, given.seed)])
        means = others.mean(axis=1)
        sign = -mission.cost(1.0)  # +1 where more is better
        beaten = np.mean(sign * winner.mean() > sign * means)
        error = winner.std(ddof=1) / np.sqrt(len(winner))
        best = sign * np.max(sign * means)
        p = wilcoxon(sign * (winner - others.mean(axis=0)), alternative="greater").pvalue
        figures = (best, np.median(means), p, *(scores(one).mean() for one in hand_made.values()))
        cells = [
            f"{name} ({mission.direction})",
            f"{winner.mean():.5g} ± {error:.2g}",
            f"{beaten:.1%}",
            *(f"{value:.5g}" for value in figures),
        ]
        print(f"| {' | '.join(cells)} |")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
