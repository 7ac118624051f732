"""Does the winner of a race mean something? Its score on fresh instances, against random and hand-made PFSMs.

For each mission: a race, then its winner, random valid PFSMs and two made by hand (AutoMoDe's examples W1, which
stops on black, and W1b, which explores) on the same instances, which the race has not seen. Prints a Markdown table.

Run: python benchmarks/designs.py [--budget 3000] [--seed 1] [--random 200] [--instances 100] [MISSION ...]
"""

import argparse
import sys

import numpy as np

from mercator_design.api import evaluate, fresh_instances
from mercator_design.config import shipped
from mercator_design.designer import Designer, flavour_space
from mercator_design.fsm import Pfsm, parse
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.architecture import Software
from mercator_design.race.executors.executor import available_jobs
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.runner import RaceRun
from mercator_design.seeds import generator
from mercator_design.sim.simulate import Simulator

HAND_MADE = {
    "W1": "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1",
    "W1b": "--nstates 1 --s0 0 --rwm0 5",
}


def random_pfsms(n: int, seed: int) -> list[Pfsm]:
    """PFSMs with every parameter uniform over its domain."""
    space = flavour_space("watermelon")
    draws = generator(seed, "random PFSMs")
    configurations = [space.build(lambda p, bounds: p.quantile(draws.random(), bounds)) for _ in range(n)]
    return [to_pfsm(configuration, "watermelon") for configuration in configurations]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("missions", nargs="*", metavar="MISSION", default=list(shipped.missions()))
    parser.add_argument("--budget", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--random", type=int, default=200)
    parser.add_argument("--instances", type=int, default=100)
    given = parser.parse_args()
    jobs, seeds = available_jobs(), fresh_instances(given.seed, given.instances)
    columns = ("mission", "winner: mean ± standard error", "better than random PFSMs", "best random", "median random")
    print(f"| {' | '.join((*columns, *HAND_MADE))} |")
    print("|---|---|---|---|---|---|---|")
    for name in given.missions:
        mission = load_mission(name)
        simulator = Simulator(mission)
        with ThreadExecutor(jobs) as executor:
            designer = Designer(simulator, budget=given.budget, seed=given.seed)
            result = RaceRun(designer, executor).finish()

        def scores(pfsm: Software, mission: Mission = mission) -> np.ndarray:
            return np.array(evaluate(mission, pfsm, seeds=seeds, jobs=jobs).scores.values)

        winner = scores(designer.software(result.configuration))
        others = np.array([scores(pfsm).mean() for pfsm in random_pfsms(given.random, given.seed)])
        hand_made = {label: scores(parse(text)).mean() for label, text in HAND_MADE.items()}
        sign = -mission.cost(1.0)  # +1 where more is better
        beaten = np.mean(sign * winner.mean() > sign * others)
        error = winner.std(ddof=1) / np.sqrt(len(winner))
        best = sign * np.max(sign * others)
        cells = [
            f"{name} ({mission.objective.direction})",
            f"{winner.mean():.5g} ± {error:.2g}",
            f"{beaten:.1%}",
            *(f"{value:.5g}" for value in (best, np.median(others), *hand_made.values())),
        ]
        print(f"| {' | '.join(cells)} |")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
