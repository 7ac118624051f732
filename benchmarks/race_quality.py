"""How good are the configurations that a race finds? Regret on problems with a known optimum, beside irace's.

Problems are objects with `name`, `parameters`, `instances`, `evaluate(configuration, instance, seed)`,
`true_cost(configuration)`, `optimum` and `reference` (the mean cost of random configurations); a module of them has
`PROBLEMS`, or `NAMES` and `get(name)`. Missions are problems too, by --missions: their true cost is the mean over fresh
instances, their optimum the best winner of any method. The regret is (true cost - optimum) / (reference - optimum).

Each method is compared with --against, and with the runs that R irace left in a file, by Mann-Whitney's rank-sum test,
which also says which of them is better; p-values are Holm's over the problems.

Methods are those of `mdesign race --method`, `default` (the
library's own, `surrogate`), and `no-NAME`, the default but for the option NAME, which is irace's.

Run: python benchmarks/race_quality.py --problems FILE.py [--budgets 1000 5000] [--seeds 20] [--irace results.json]
         [--methods default irace no-surrogate ...] [--cache FILE] [--missions NAME ...] [-j N]
"""

import argparse
import hashlib
import importlib.util
import json
import multiprocessing
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

import mercator_design
from benchmarks.two_samples import share_above
from benchmarks.vectors.irace_parts import parameter
from mercator_design import seeds
from mercator_design.race import Configuration, IteratedRace, RaceOptions, Space, parse_space
from mercator_design.race.methods.table import METHODS
from mercator_design.race.racing.statistics import holm

Row = dict[str, Any]
Task = tuple[str | None, str, str, int, int]
"""File, problem, method, budget, seed."""
SIGNIFICANT = 0.05


def space_of(parameters: Iterable[Mapping[str, Any]]) -> Space:
    """The space of a problem's own description of its parameters."""
    return Space([parameter(p["name"], {**p, "condition": _condition(p["condition"])}) for p in parameters])


def _condition(tree: list[Any] | None) -> str | None:
    """The text of a condition's tree: ["and", tree, ...], ["in", name, values] or [comparison, name, number]."""
    if tree is None:
        return None
    operation, *operands = tree
    if operation == "and":
        return " & ".join(f"({_condition(one)})" for one in operands)
    name, value = operands
    if operation == "in":
        return f"{name} %in% c({', '.join(json.dumps(str(v)) for v in value)})"
    return f"{name} {operation} {value}"


class Synthetic:
    """A problem of a module, and its stream of instances: passes over the training instances, each in a new order."""

    def __init__(self, problem: Any) -> None:
        self.space = space_of(problem.parameters)
        self.problem = problem

    def start(self, seed: int) -> None:
        self._draws = seeds.generator(seed, "instances of a problem")
        self._instances: list[tuple[str, int]] = []

    def cost(self, configuration: Configuration, instance: int) -> float:
        while len(self._instances) <= instance:
            order = self._draws.permutation(len(self.problem.instances))
            self._instances += [
                (self.problem.instances[k], int(self._draws.integers(1, seeds.MAX_SEED, endpoint=True))) for k in order
            ]
        return float(self.problem.evaluate(configuration, *self._instances[instance]))

    def true_cost(self, configuration: Configuration) -> float:
        return float(self.problem.true_cost(configuration))

    def scale(self, rows: Iterable[Row]) -> tuple[float, float]:  # noqa: ARG002 - missions need them
        return self.problem.optimum, self.problem.reference


class Mission:
    """A mission as a problem; its true costs are means over FRESH instances that no race sees."""

    FRESH = 100
    RANDOM = 100

    def __init__(self, name: str) -> None:
        from mercator_design.fsm.space.grammar import parameters_text
        from mercator_design.fsm.space.structure import PfsmStructure
        from mercator_design.missions.mission import load_mission
        from mercator_design.sim.simulate import Simulator

        self.space = parse_space(parameters_text("watermelon"), "grammar", structure=PfsmStructure("watermelon"))
        self._simulator = Simulator(load_mission(name))
        self._seed = 0

    def start(self, seed: int) -> None:
        self._seed = seed

    def cost(self, configuration: Configuration, instance: int) -> float:
        return self._cost(configuration, seeds.instance_seed(self._seed, "race", instance))

    def true_cost(self, configuration: Configuration) -> float:
        fresh = (seeds.instance_seed(0, "evaluation", k) for k in range(self.FRESH))
        return float(np.mean([self._cost(configuration, seed) for seed in fresh]))

    def scale(self, rows: Iterable[Row]) -> tuple[float, float]:
        """The best winner, and the mean of random configurations on one instance each."""
        draws = seeds.generator(0, "random configurations")
        randoms = [self.space.build(lambda p, b: p.quantile(draws.random(), b)) for _ in range(self.RANDOM)]
        costs = [self._cost(c, seeds.instance_seed(0, "evaluation", k)) for k, c in enumerate(randoms)]
        return min(row["true_cost"] for row in rows), float(np.mean(costs))

    def _cost(self, configuration: Configuration, seed: int) -> float:
        from mercator_design.fsm.space.grammar import to_pfsm

        return self._simulator.mission.cost(self._simulator.run(to_pfsm(configuration, "watermelon"), seed).score)


Problem = Synthetic | Mission


@cache
def load_module(file: str) -> Any:
    spec = importlib.util.spec_from_file_location(Path(file).stem, file)
    if spec is None or spec.loader is None:
        sys.exit(f"{file}: expected a Python module of problems")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def problem_names(file: str) -> list[str]:
    module = load_module(file)
    if hasattr(module, "NAMES"):
        return list(module.NAMES)
    return [problem.name for problem in _listed(module)]


@cache
def problem(file: str | None, name: str) -> Problem:
    """A problem of a module, or a mission."""
    if file is None:
        return Mission(name)
    module = load_module(file)
    found = module.get(name) if hasattr(module, "get") else next(p for p in _listed(module) if p.name == name)
    return Synthetic(found)


def _listed(module: Any) -> list[Any]:
    problems = module.PROBLEMS
    return list(problems.values() if isinstance(problems, Mapping) else problems)


def options_of(method: str) -> RaceOptions:
    """`default`, or `no-NAME`: the default but for an option, which is irace's."""
    if method == "default":
        return RaceOptions()
    name = method.removeprefix("no-")
    if method == name or not hasattr(RaceOptions(), name):
        sys.exit(f"--methods: expected default, no-NAME of an option or {', '.join(METHODS)}, found {method}")
    return replace(RaceOptions(), **{name: getattr(RaceOptions.irace(), name)})


def run(file: str | None, name: str, method: str, budget: int, seed: int) -> Row:
    """One race to its end."""
    one = problem(file, name)
    one.start(seed)
    evaluating = 0.0
    began = time.process_time()
    make = METHODS.get(method) or partial(IteratedRace, options=options_of(method))
    race = make(one.space, budget=budget, seed=seed)
    while batch := race.ask():
        started = time.process_time()
        costs = [one.cost(race.configurations[e.configuration], e.instance) for e in batch]
        evaluating += time.process_time() - started
        race.tell(costs)
    overhead = time.process_time() - began - evaluating
    return {
        "problem": name,
        "method": method,
        "budget": budget,
        "seed": seed,
        "true_cost": one.true_cost(race.configurations[race.best.configuration]),
        "used": race.used,
        "overhead": overhead / race.used,
    }


def fingerprint() -> str:
    """Of the source of races and of what they know of PFSMs, lest results of other code are taken for this one's."""
    folder = Path(mercator_design.__file__).parent
    files = [*folder.glob("race/*.py"), *folder.glob("fsm/*.py")]
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(files))).hexdigest()[:12]


def results(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """Of all runs, as they come. Processes are forked, and keep the problems they have read."""
    if jobs == 1:
        yield from (run(*task) for task in tasks)
        return
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        yield from pool.imap_unordered(_run, tasks)


def _run(task: Task) -> Row:
    return run(*task)


def all_rows(tasks: Sequence[Task], file: Path | None, jobs: int) -> list[Row]:
    """The results of all runs, those from the cache first; new ones are appended to it as they come."""
    code = fingerprint()
    known: dict[tuple[Any, ...], Row] = {}
    if file is not None and file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            if row["code"] == code:
                known[row["problem"], row["method"], row["budget"], row["seed"]] = row
    rows = [known[task[1:]] for task in tasks if task[1:] in known]
    missing = [task for task in tasks if task[1:] not in known]
    for done, row in enumerate(results(missing, jobs), start=1):
        rows.append({**row, "code": code})
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[-1]) + "\n")
        if sys.stderr.isatty():
            print(f"\r{done}/{len(missing)}", end="", file=sys.stderr)
    return rows


def print_budget(budget: int, regrets: Mapping[tuple[str, str], list[float]], names: list[str], against: str) -> None:
    """A table of regrets, and what the rank-sum tests say."""
    methods = list(dict.fromkeys(method for _, method in regrets))
    print(f"\n## Budget {budget}: mean regret (sd) [runs]\n\n| problem | {' | '.join(methods)} |")
    print("|---" * (1 + len(methods)) + "|")
    for name in names:
        cells = (
            f"{np.mean(found):.3f} ({np.std(found, ddof=min(1, len(found) - 1)):.3f}) [{len(found)}]"
            if (found := regrets.get((name, method), []))
            else ""
            for method in methods
        )
        print(f"| {name} | {' | '.join(cells)} |")
    means = (np.mean([np.mean(regrets[name, m]) for name in names if (name, m) in regrets]) for m in methods)
    print(f"| **mean** | {' | '.join(f'**{mean:.3f}**' for mean in means)} |\n")
    for method in methods:
        for other in dict.fromkeys((against, "R irace")):
            if method not in {other, "R irace"}:
                print_verdict(method, other, regrets, names)


def print_verdict(method: str, other: str, regrets: Mapping[tuple[str, str], list[float]], names: list[str]) -> None:
    both = [name for name in names if (name, method) in regrets and (name, other) in regrets]
    if not both:
        return
    pairs = [(regrets[name, method], regrets[name, other]) for name in both]
    p_values = holm(np.array([mannwhitneyu(mine, theirs).pvalue for mine, theirs in pairs])).tolist()
    above = [share_above(np.array(mine), np.array(theirs)) for mine, theirs in pairs]
    better = [share < 0.5 and p < SIGNIFICANT for share, p in zip(above, p_values, strict=True)]
    worse = [share > 0.5 and p < SIGNIFICANT for share, p in zip(above, p_values, strict=True)]
    lower = sum(share < 0.5 for share in above)
    p_texts = ", ".join(f"{name} {p:.2g}" for name, p in zip(both, p_values, strict=True))
    print(
        f"* {method} beside {other}: lower ranks on {lower} of {len(both)}, better on {sum(better)}, "
        f"worse on {sum(worse)} at {SIGNIFICANT:.0%} (Holm; p: {p_texts})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", metavar="FILE.py")
    parser.add_argument("--only", nargs="+", metavar="PROBLEM", help="some of them")
    parser.add_argument("--missions", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--budgets", nargs="+", type=int, default=[1000, 5000])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--methods", nargs="+", default=["default", "irace"])
    parser.add_argument("--against", default="irace", help="the method that others are compared with")
    parser.add_argument("--irace", type=Path, metavar="FILE.json", help="recorded results of R irace")
    parser.add_argument("--cache", type=Path, metavar="FILE.jsonl", help="where results are kept, to go on later")
    parser.add_argument("-j", "--jobs", type=int, default=1)
    given = parser.parse_args()
    names = (
        [name for name in problem_names(given.problems) if not given.only or name in given.only]
        if given.problems
        else []
    )
    sources: dict[str, str | None] = {**dict.fromkeys(names, given.problems), **dict.fromkeys(given.missions)}
    if not sources:
        sys.exit("expected --problems or --missions")
    tasks = [
        (file, name, method, budget, seed)
        for budget in given.budgets
        for name, file in sources.items()
        for method in given.methods
        for seed in range(1, given.seeds + 1)
    ]
    rows = all_rows(tasks, given.cache, given.jobs)
    if given.irace:
        recorded = json.loads(given.irace.read_text(encoding="utf-8"))["runs"]
        rows += [{**row, "method": "R irace"} for row in recorded if row["method"] == "irace"]
    by_problem: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_problem[row["problem"]].append(row)
    scales = {name: problem(file, name).scale(by_problem[name]) for name, file in sources.items()}
    for budget in given.budgets:
        regrets: dict[tuple[str, str], list[float]] = defaultdict(list)
        for row in rows:
            if row["budget"] == budget and row["problem"] in scales:
                optimum, reference = scales[row["problem"]]
                regrets[row["problem"], row["method"]].append((row["true_cost"] - optimum) / (reference - optimum))
        print_budget(budget, regrets, list(sources), given.against)
        for method in given.methods:
            own = [row["overhead"] for row in rows if row["method"] == method and row["budget"] == budget]
            print(f"* {method}: the race itself takes {1e6 * np.mean(own):.0f} µs of CPU an experiment")


if __name__ == "__main__":
    main()
