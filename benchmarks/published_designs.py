"""Are a race's designs as good as those that were published with the founding paper?

The authors published ten FSMs for each of three missions, which irace had designed for their robots. Here races design
for the same missions with `mercator-argos`, the original simulator's robot. All run on the same instances, which no
race has: the mean of each design's scores, the median of these and their quartiles, and the part of the pairs in which
the race's design is the better one, with its 95 % bootstrap interval and the p of Mann-Whitney's test.

Run: python benchmarks/published_designs.py [--budget 5000] [--seeds 10] [--method default] [--cache FILE.jsonl] [-j N]
"""

import argparse
import json
import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.mission_quality import FRESH, MissionProblem, Shipped, quartiles_text
from benchmarks.race_results import Race, results
from mercator_design.fsm import parse
from mercator_design.show.study.verdicts import share_text
from mercator_design.studies.statistics.effects import a_effect
from mercator_design.studies.statistics.rank_tests import rank_sum

PUBLISHED = Path(__file__).parents[1] / "tests" / "data" / "published_fsms.json"
ROBOT = "mercator-argos"
DESIGNS = {"aggregation": range(2, 12), "color_aggregation": range(12, 22), "grid_exploration": range(22, 32)}
"""The numbers of the published FSMs of each mission: W2, W3, ..."""


@cache
def problem(name: str) -> MissionProblem:
    """The problem of a mission and robot model."""
    mission, model = name.split(", ")
    return MissionProblem(Shipped(mission, "watermelon", (f"robot_model={model}",)))


def published(mission: str) -> np.ndarray:
    """The mean scores of a mission's published FSMs."""
    texts = json.loads(PUBLISHED.read_text())["watermelon"]
    one = problem(f"{mission}, {ROBOT}")
    return np.array([one.fresh_scores(parse(texts[f"W{number}"])).mean() for number in DESIGNS[mission]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", nargs="+", choices=DESIGNS, default=list(DESIGNS), metavar="NAME")
    parser.add_argument("--budget", type=int, default=5000)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--method", default="default")
    parser.add_argument("--cache", type=Path, metavar="FILE.jsonl", help="where results are kept, to go on later")
    parser.add_argument("-j", "--jobs", type=int, default=1)
    given = parser.parse_args()
    seeds = range(1, given.seeds + 1)
    races = [
        Race(f"{mission}, {ROBOT}", given.method, given.budget, seed) for seed in seeds for mission in given.missions
    ]
    rows = results(races, problem, path=given.cache, jobs=given.jobs)
    print(
        f"| mission, on {FRESH} instances | published | races of {given.budget} | better | p |\n|---|---|---|---|---|"
    )
    for mission in given.missions:
        name = f"{mission}, {ROBOT}"
        ours, theirs = np.array([row["score"] for row in rows if row["problem"] == name]), published(mission)
        sign = 1 if problem(name).is_maximised else -1
        cells = [quartiles_text(theirs), quartiles_text(ours)]
        if len(ours) > 1:
            pair = sign * ours, sign * theirs
            cells += [share_text(a_effect(*pair)), f"{rank_sum(*pair):.2g}"]
        print(f"| {mission} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
