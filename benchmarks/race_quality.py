"""How good are the configurations that a race finds? Regret on problems with a known optimum, beside irace's.

Problems are objects with `name`, `parameters`, `instances`, `evaluate(configuration, instance, seed)`,
`true_cost(configuration)`, `optimum` and `reference` (the mean cost of random configurations); a module of them has
`PROBLEMS`, or `NAMES` and `get(name)`. The regret is (true cost - optimum) / (reference - optimum). mission_quality.py
measures missions.

Each method is compared with --against, and with the runs that R irace left in a file, by Mann-Whitney's rank-sum test,
which also says which of them is better; p-values are Holm's over the problems.

Methods: see race_results.py.

Run: python benchmarks/race_quality.py --problems FILE.py [--budgets 1000 5000] [--seeds 20] [--irace results.json]
         [--methods default irace no-surrogate ...] [--cache FILE] [-j N]
"""

import argparse
import importlib.util
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.race_results import Race, Row, results
from benchmarks.vectors.irace_parts import parameter
from mercator_design import seeds
from mercator_design.race import Configuration, Space
from mercator_design.race.elimination.statistics import holm
from mercator_design.studies.statistics.effects import a_measure

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

    def measure(self, configuration: Configuration) -> Row:
        return {"true_cost": float(self.problem.true_cost(configuration))}

    def regret(self, true_cost: float) -> float:
        optimum, reference = self.problem.optimum, self.problem.reference
        return float((true_cost - optimum) / (reference - optimum))


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
def problem(name: str, file: str) -> Synthetic:
    """A problem of a module."""
    module = load_module(file)
    found = module.get(name) if hasattr(module, "get") else next(p for p in _listed(module) if p.name == name)
    return Synthetic(found)


def _listed(module: Any) -> list[Any]:
    problems = module.PROBLEMS
    return list(problems.values() if isinstance(problems, Mapping) else problems)


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
    above = [a_measure(np.array(mine), np.array(theirs)) for mine, theirs in pairs]
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
    parser.add_argument("--problems", metavar="FILE.py", required=True)
    parser.add_argument("--only", nargs="+", metavar="PROBLEM", help="some of them")
    parser.add_argument("--budgets", nargs="+", type=int, default=[1000, 5000])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--methods", nargs="+", default=["default", "irace"])
    parser.add_argument("--against", default="irace", help="the method that others are compared with")
    parser.add_argument("--irace", type=Path, metavar="FILE.json", help="recorded results of R irace")
    parser.add_argument("--cache", type=Path, metavar="FILE.jsonl", help="where results are kept, to go on later")
    parser.add_argument("-j", "--jobs", type=int, default=1)
    given = parser.parse_args()
    names = [name for name in problem_names(given.problems) if not given.only or name in given.only]
    races = [
        Race(name, method, budget, seed)
        for budget in given.budgets
        for name in names
        for method in given.methods
        for seed in range(1, given.seeds + 1)
    ]
    find = partial(problem, file=given.problems)
    rows = results(races, find, path=given.cache, jobs=given.jobs)
    if given.irace:
        recorded = json.loads(given.irace.read_text(encoding="utf-8"))["runs"]
        rows += [{**row, "method": "R irace"} for row in recorded if row["method"] == "irace"]
    for budget in given.budgets:
        regrets: dict[tuple[str, str], list[float]] = defaultdict(list)
        for row in rows:
            if row["budget"] == budget and row["problem"] in names:
                regrets[row["problem"], row["method"]].append(find(row["problem"]).regret(row["true_cost"]))
        print_budget(budget, regrets, names, given.against)
        for method in given.methods:
            own = [row["overhead"] for row in rows if row["method"] == method and row["budget"] == budget]
            print(f"* {method}: the race itself takes {1e6 * np.mean(own):.0f} µs of CPU an experiment")


if __name__ == "__main__":
    main()
