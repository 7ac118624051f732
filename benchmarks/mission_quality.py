"""How good are the designs that a budget buys? Methods side by side on missions, by the winners on fresh instances.

Each winner runs on FRESH instances that no race has; its score is their mean. For each budget and mission: the median
of the races' scores and their quartiles, and against --against the share of pairs of races in which a method's design
is the better one (probability of superiority, Vargha and Delaney's A; 0.5: no difference) with its 95 % bootstrap
interval, and the p of the rank-sum test, corrected by Holm over the missions. Over all missions van Elteren's test
(stratified rank sums). A mission has headroom at a budget if some winner's score, less three of its standard errors,
is better than the median of --against by more than 5 % of the best one's distance from random configurations. Then,
what methods without an option are beside the default, and the budget at which the default's median reaches irace's
median at the largest budget, interpolated in the logarithm of the budget.

Missions: four with Mercator as they are shipped; four of the literature and of this project, shorter or with fewer
robots than shipped, as their names say; and six random ones: of each class of `mdesign missions sample` the first two
seeds that give at most 6 robots, cut to 60 s, one for Watermelon and one for Chocolate. --missions takes the six of
SWARMS as well, of 20 robots and cut to 30 s, and other shipped missions, as `mdesign race` designs for them.

Results are kept in --cache, a line for each race; a run that was stopped goes on, and several processes may share the
file. mission_quality.jsonl has those of docs/explanation/benchmarks.md. Methods: see race_results.py; METHOD@CODE is a
method in an earlier version of the code, from the cache.

Cost: the default and irace at 500 and 2000, 20 seeds each, are 1.6 million experiments. On two cores with ten busy
processes one took 2.4 to 10 ms of CPU, 6.8 in the mean (--cost measures it): 3 hours. `foraging` took 2.7 times what it
takes on an idle machine, on which it should be a good hour. Budget 5000 costs twice as much as 500 and 2000.

Run: python benchmarks/mission_quality.py [--budgets 500 2000 5000] [--seeds 20] [--methods default irace no-moves]
         [--missions NAME ...] [--against irace] [--cache FILE.jsonl] [-j N] [--cost]
"""

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.race_results import Race, Row, results
from mercator_design import seeds
from mercator_design.api import fresh_instances
from mercator_design.config import shipped
from mercator_design.config.writing import dump
from mercator_design.designer import mission_space
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.fsm.text import to_text
from mercator_design.mission_sampler import MissionClass, sample_mission
from mercator_design.missions.mission import Mission, load_mission, parse_mission
from mercator_design.race import Configuration
from mercator_design.race.elimination.summary import ALPHA
from mercator_design.show.study.verdicts import share_text
from mercator_design.sim.simulate import Simulator
from mercator_design.studies.statistics.comparison import PairOnMission, compared
from mercator_design.studies.statistics.rank_tests import van_elteren
from mercator_design.studies.table import DESIGN_MODEL, StudyTable

FRESH = 300
FRESH_BEFORE = 200
"""The number of fresh instances of the rows without a number of runs."""
RANDOM = 200
HEADROOM = 0.05


class Shipped(NamedTuple):
    """A shipped mission, with overrides."""

    file: str
    flavour: str
    overrides: tuple[str, ...] = ()

    def load(self) -> Mission:
        return load_mission(self.file, self.overrides)


class Sampled(NamedTuple):
    """A random mission, cut to 60 s."""

    class_: MissionClass
    seed: int
    flavour: str

    def load(self) -> Mission:
        model = {"watermelon": "mercator", "chocolate": "mercator-chocolate"}[self.flavour]
        overrides = ("duration=60", f"robot_model={model}")
        return parse_mission(dump(sample_mission(self.class_, seed=self.seed)), overrides=overrides)


MISSIONS: Mapping[str, Shipped | Sampled] = {
    "aggregation": Shipped("aggregation", "watermelon"),
    "color_aggregation": Shipped("color_aggregation", "watermelon"),
    "foraging": Shipped("foraging", "watermelon"),
    "grid_exploration": Shipped("grid_exploration", "watermelon"),
    "changing_decision, 60 s": Shipped("changing_decision", "watermelon", ("duration=60",)),
    "gianduja_decision, 8 robots, 60 s": Shipped("gianduja_decision", "chocolate", ("robots=8", "duration=60")),
    "chocolate_sca, 30 s": Shipped("chocolate_sca", "chocolate", ("duration=30",)),
    "chocolate_spc, 10 robots": Shipped("chocolate_spc", "chocolate", ("robots=10",)),
    "foraging 12": Sampled("foraging", 12, "watermelon"),
    "foraging 13": Sampled("foraging", 13, "chocolate"),
    "homing 1": Sampled("homing", 1, "watermelon"),
    "homing 5": Sampled("homing", 5, "chocolate"),
    "aggregation-xor 7": Sampled("aggregation-xor", 7, "chocolate"),
    "aggregation-xor 13": Sampled("aggregation-xor", 13, "watermelon"),
}
SWARMS: Mapping[str, Shipped] = {
    "color_aggregation_20, 30 s": Shipped("color_aggregation_20", "watermelon", ("duration=30",)),
    "aggregation_20, 30 s": Shipped("aggregation_20", "watermelon", ("duration=30",)),
    "grid_exploration_20, 30 s": Shipped("grid_exploration_20", "watermelon", ("duration=30",)),
    "aggregation_single_spot, 30 s": Shipped("aggregation_single_spot", "chocolate", ("duration=30",)),
    "chocolate_aac, 30 s": Shipped("chocolate_aac", "chocolate", ("duration=30",)),
    "chocolate_lcn, 30 s": Shipped("chocolate_lcn", "chocolate", ("duration=30",)),
}


class MissionProblem:
    """A mission to race on."""

    def __init__(self, source: Shipped | Sampled) -> None:
        self._flavour = source.flavour
        self._simulator = Simulator(source.load())
        self.space = mission_space(self._simulator, self._flavour)
        self._seed = 0

    @property
    def is_maximised(self) -> bool:
        return self._simulator.mission.direction == "maximise"

    def start(self, seed: int) -> None:
        self._seed = seed

    def cost(self, configuration: Configuration, instance: int) -> float:
        score = self._score(configuration, seeds.instance_seed(self._seed, "race", instance))
        return self._simulator.mission.cost(score)

    def measure(self, configuration: Configuration) -> Row:
        pfsm = to_pfsm(configuration, self._flavour)
        scores = self.fresh_scores(pfsm)
        return {
            "score": float(np.mean(scores)),
            "error": float(np.std(scores, ddof=1)) / FRESH**0.5,
            "runs": FRESH,
            "fsm": to_text(pfsm),
        }

    def values(self, configurations: Sequence[Configuration], instances: Sequence[int]) -> np.ndarray:
        """Mean scores on instances, by their seeds; of a minimised mission their negatives."""
        sign = 1 if self.is_maximised else -1
        return np.array([sign * np.mean([self._score(one, seed) for seed in instances]) for one in configurations])

    def fresh_scores(self, pfsm: Pfsm) -> np.ndarray:
        """The scores of a PFSM on the instances that no race has."""
        return np.array([self._simulator.run(pfsm, seed).score for seed in fresh_instances(0, FRESH)])

    def random_scores(self) -> np.ndarray:
        """Random configurations, each on an instance of its own."""
        draws = seeds.generator(0, "random configurations")
        randoms = [self.space.build(lambda p, b: p.quantile(draws.random(), b)) for _ in range(RANDOM)]
        return np.array([self._score(*one) for one in zip(randoms, fresh_instances(0, RANDOM), strict=True)])

    def _score(self, configuration: Configuration, seed: int) -> float:
        return self._simulator.run(to_pfsm(configuration, self._flavour), seed).score


@cache
def problem(name: str) -> MissionProblem:
    """The problem of MISSIONS, of SWARMS or of a shipped mission; read once in a process."""
    return MissionProblem({**MISSIONS, **SWARMS}.get(name) or Shipped(name, "watermelon"))


def study_of(rows: Sequence[Row]) -> StudyTable:
    """Results as a study: each race's winner is a design, of which the mean score is known."""
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    columns = {
        "method": [row["method"] for row in rows],
        "mission": [row["problem"] for row in rows],
        "robot_model": "the mission's own",
        "budget": [row["budget"] for row in rows],
        "repetition": [row["seed"] for row in rows],
        "seed": [row["seed"] for row in rows],
        "reality": DESIGN_MODEL,
        "score": [row["score"] for row in rows],
        "error": [row["error"] for row in rows],
        "runs": [row.get("runs", FRESH_BEFORE) for row in rows],
    }
    return StudyTable(
        name="mission quality",
        runs=pd.DataFrame(),
        designs=pd.DataFrame(columns),
        directions={name: "maximise" if problem(name).is_maximised else "minimise" for name in problems},
        limits={},
    )


def quartiles_text(values: np.ndarray) -> str:
    """Median, quartiles and number of some values; empty if there are none."""
    if not len(values):
        return ""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.4g} ({low:.4g} to {high:.4g}) [{len(values)}]"


class Table:
    """Scores of winners by mission, method and budget; as values to maximise inside."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._rows, study = rows, study_of(rows)
        self.missions = study.missions
        self.methods = study.levels
        self.budgets = sorted({row["budget"] for row in rows})
        self._signs = {name: 1 if study.possible(name).maximise else -1 for name in self.missions}
        self._values: dict[tuple[str, str, int], list[float]] = {}
        for row in rows:
            value = self._signs[row["problem"]] * row["score"]
            self._values.setdefault((row["problem"], row["method"], row["budget"]), []).append(value)
        # Less three standard errors: of a hundred equal winners the best one is that which was measured too well.
        sure = [(row["problem"], self._signs[row["problem"]] * row["score"] - 3 * row["error"]) for row in rows]
        self._sure = {m: max(value for name, value in sure if name == m) for m in self.missions}
        best = {m: max(max(v) for (name, _, _), v in self._values.items() if name == m) for m in self.missions}
        randoms = {m: float(self._signs[m] * problem(m).random_scores().mean()) for m in self.missions}
        self._width = {m: best[m] - randoms[m] for m in self.missions}

    def values(self, mission: str, method: str, budget: int) -> np.ndarray:
        return np.array(self._values.get((mission, method, budget), []))

    def cell(self, mission: str, method: str, budget: int) -> str:
        values = self._signs[mission] * self.values(mission, method, budget)
        return quartiles_text(values)

    def middle(self, mission: str, method: str, budget: int) -> str:
        values = self._signs[mission] * self.values(mission, method, budget)
        return f"{np.median(values):.4g} [{len(values)}]" if len(values) else ""

    def gap(self, mission: str, method: str, budget: int) -> float:
        """From the median to what a winner surely reaches, as a part of the distance from random configurations."""
        median = float(np.median(self.values(mission, method, budget)))
        return float((self._sure[mission] - median) / self._width[mission])

    def _rows_of(self, method: str, budget: int) -> list[Row]:
        return [row for row in self._rows if row["method"] == method and row["budget"] == budget]

    def compared(self, method: str, other: str, budget: int) -> dict[str, PairOnMission]:
        """What the study of two methods at a budget shows, by mission; nothing if one of both has no races."""
        both = [self._rows_of(one, budget) for one in (method, other)]
        if not all(both):
            return {}
        return {pair.block.mission: pair for pair in compared(study_of([*both[0], *both[1]])).pairs}

    def pooled(self, method: str, other: str, budget: int) -> float:
        """The p-value of van Elteren's test."""
        return van_elteren(
            (pair.block.values(method), pair.block.values(other))
            for pair in self.compared(method, other, budget).values()
        )

    def budget_to_reach(self, mission: str, method: str, target: float) -> str:
        """The budget at which a method's median is as good as a value, by linear interpolation over log budget."""
        medians = [(b, float(np.median(v))) for b in self.budgets if len(v := self.values(mission, method, b))]
        for k, (budget, median) in enumerate(medians):
            if median >= target:
                if k == 0:
                    return f"at most {budget}"
                before, below = medians[k - 1]
                return f"{before * (budget / before) ** ((target - below) / (median - below)):.0f}"
        return f"more than {medians[-1][0]}" if medians else ""

    def median(self, mission: str, method: str, budget: int) -> float | None:
        values = self.values(mission, method, budget)
        return float(np.median(values)) if len(values) else None


def report(table: Table, against: str) -> Iterator[str]:
    """What is printed: all missions at each budget, methods without an option, and the budgets that reach irace."""
    others = [method for method in table.methods if method != against]
    for budget in table.budgets:
        yield f"\n## Budget {budget}: median of the winners' scores (quartiles) [races]\n"
        heads = [head for method in others for head in (method, f"better than {against}", "p (Holm)")]
        yield f"| mission | {against} | gap | {' | '.join(heads)} |"
        yield "|---" * (3 + len(heads)) + "|"
        comparisons = {method: table.compared(method, against, budget) for method in others}
        for mission in table.missions:
            known = table.median(mission, against, budget) is not None
            gap = f"{table.gap(mission, against, budget):.0%}" if known else ""
            cells = [table.cell(mission, against, budget), gap]
            for method in others:
                one = comparisons[method].get(mission)
                share = share_text(one.a) if one else ""
                cells += [table.cell(mission, method, budget), share, f"{one.p_holm:.2g}" if one else ""]
            yield f"| {mission} | {' | '.join(cells)} |"
        yield ""
        yield from (verdict(table, method, against, budget) for method in others if comparisons[method])
    if "default" in table.methods:
        yield from bought(table, "default")
    without = [method for method in table.methods if method.startswith("no-") or "=" in method]
    if without and "default" in table.methods:
        yield from left_out(table, without)
    if {"default", "irace"} <= set(table.methods):
        yield from budgets_to_reach(table)


def verdict(table: Table, method: str, other: str, budget: int) -> str:
    found = table.compared(method, other, budget)
    better = [m for m, one in found.items() if one.outcome == "better than"]
    worse = [m for m, one in found.items() if one.outcome == "worse than"]
    room = [m for m in found if table.gap(m, other, budget) > HEADROOM]
    higher = sum(one.a.value > 0.5 for one in found.values())
    mean = np.mean([one.a.value for one in found.values()])
    names = f" ({', '.join(worse)})" if worse else ""
    return (
        f"* {method} beside {other} at {budget}: better on {len(better)} of {len(found)} missions "
        f"({len(set(better) & set(room))} of the {len(room)} with headroom), worse on {len(worse)} at "
        f"{ALPHA:.0%}{names}; higher ranks on {higher}; "
        f"mean share of better designs {mean:.2f}; van Elteren p {table.pooled(method, other, budget):.2g}"
    )


def left_out(table: Table, methods: Sequence[str]) -> Iterator[str]:
    """The default beside itself without one option, or with another value of it."""
    yield "\n## The default beside itself with another value of an option: share of better designs, p (van Elteren)\n"
    yield f"| without, or with | {' | '.join(f'{budget}' for budget in table.budgets)} |"
    yield "|---" * (1 + len(table.budgets)) + "|"
    for method in methods:
        cells = []
        for budget in table.budgets:
            found = table.compared("default", method, budget)
            better = sum(one.outcome == "better than" for one in found.values())
            worse = sum(one.outcome == "worse than" for one in found.values())
            mean = np.mean([one.a.value for one in found.values()]) if found else np.nan
            p = table.pooled("default", method, budget)
            cells.append(f"{mean:.2f}, {p:.2g}; better on {better}, worse on {worse} of {len(found)}" if found else "")
        yield f"| {method.removeprefix('no-')} | {' | '.join(cells)} |"


def bought(table: Table, method: str) -> Iterator[str]:
    """The median score of a method's winners by mission and budget."""
    yield f"\n## What a budget buys: the median of the scores of {method}'s winners [races]\n"
    yield f"| mission | {' | '.join(f'{budget}' for budget in table.budgets)} |"
    yield "|---" * (1 + len(table.budgets)) + "|"
    for mission in table.missions:
        yield f"| {mission} | {' | '.join(table.middle(mission, method, budget) for budget in table.budgets)} |"


def budgets_to_reach(table: Table) -> Iterator[str]:
    last = table.budgets[-1]
    yield f"\n## The budget at which the default's median reaches irace's median at {last}\n"
    for mission in table.missions:
        target = table.median(mission, "irace", last)
        if target is not None:
            yield f"* {mission}: {table.budget_to_reach(mission, 'default', target)}"


def print_cost(names: Sequence[str]) -> None:
    """The CPU time of an experiment of each mission, of random configurations."""
    for name in names:
        one = problem(name)
        one.random_scores()
        start = time.process_time()
        scores = one.random_scores()
        spent = (time.process_time() - start) / RANDOM
        middle, best = np.median(scores), scores.max() if one.is_maximised else scores.min()
        print(f"{name}: {1e3 * spent:.1f} ms an experiment; random configurations score {middle:.4g}, best {best:.4g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--missions",
        nargs="+",
        choices=[*MISSIONS, *SWARMS, *shipped.missions()],
        default=list(MISSIONS),
        metavar="NAME",
    )
    parser.add_argument("--budgets", nargs="+", type=int, default=[500, 2000, 5000])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--methods", nargs="+", default=["default", "irace"])
    parser.add_argument("--against", default="irace", help="the method that others are compared with")
    parser.add_argument("--cache", type=Path, metavar="FILE.jsonl", help="where results are kept, to go on later")
    parser.add_argument(
        "--cost", action="store_true", help="only measure the CPU time of an experiment of each mission"
    )
    parser.add_argument("-j", "--jobs", type=int, default=1)
    given = parser.parse_args()
    if given.cost:
        print_cost(given.missions)
        return
    races = [
        Race(mission, method, budget, seed)
        for budget in given.budgets
        for seed in range(1, given.seeds + 1)
        for mission in given.missions
        for method in given.methods
    ]
    for line in report(Table(results(races, problem, path=given.cache, jobs=given.jobs)), given.against):
        print(line)


if __name__ == "__main__":
    main()
