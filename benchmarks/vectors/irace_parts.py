"""Parts of irace: budgets, sampling models, quantiles, similar configurations, ranks, command lines, random numbers.

A file has an object `vectors` with a list or object for each kind. What was drawn in R is compared with what is drawn
here at evenly spaced places of the unit interval, which is exact but for 1e-4: the recorded samples of N_DRAWS may be
CHANCE_SIGMAS standard errors off, so that one number fails by luck with a chance below 1e-8.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from benchmarks.vectors.checks import Check, attempt, difference, each, table
from benchmarks.vectors.irace_tests import order_is_same
from mercator_design.race import Configuration, Parameter, RaceOptions, Space, categorical, integer, ordered, real
from mercator_design.race.elimination.budget import iteration_budget, minimum_budget, n_configurations, n_iterations
from mercator_design.race.elimination.statistics import concordance, overall_ranks
from mercator_design.race.proposals.model import SamplingModel, elite_weights
from mercator_design.race.proposals.sampling import similar, truncated_normal
from mercator_design.race.space.parameter import DEFAULT_DIGITS

Floats = NDArray[np.float64]
Vectors = dict[str, Any]
N_DRAWS = 200_000
CHANCE_SIGMAS = 6.0
EVENLY = 20_000
EXACT = 1e-5
"""Part of the domain's width within which the mean of N_DRAWS evenly spaced draws is exact."""
ROUNDING = 1e-12
"""Of the columns of the table, which are sums of many terms."""


def recognises(document: Any) -> bool:
    return isinstance(document, dict) and isinstance(document.get("vectors"), dict)


def checks(document: dict[str, Any]) -> Iterator[Check]:
    vectors = document["vectors"]
    for kind, of_kind in vectors.items():
        if kind in _CASES:
            yield from attempt(kind, "all", each(kind, of_kind, partial(_CASES[kind], vectors)))
        elif kind == "model":
            yield from attempt(kind, "all", _model(vectors))
        elif kind == "sampled_frequencies":
            yield from attempt(kind, "all", _sampled_frequencies(of_kind))
        else:
            yield Check(kind, "all", "unknown kind of vectors")


def parameters(vectors: Vectors) -> dict[str, Parameter]:
    """The parameters that models, quantiles and similar configurations are of."""
    return {name: parameter(name, described) for name, described in vectors["model"]["parameters"].items()}


def parameter(name: str, described: Mapping[str, Any]) -> Parameter:
    """A parameter as it is described: type (cat, ord, int or real), values or low and high, and what else it has."""
    kind, condition = described["type"], described.get("condition")
    if kind in {"cat", "ord"}:
        return (categorical if kind == "cat" else ordered)(name, described["values"], condition=condition)
    low, high, log = described["low"], described["high"], described.get("log", False)
    if kind == "int":
        return integer(name, low, high, log=log, condition=condition)
    return real(name, low, high, log=log, digits=described.get("digits", DEFAULT_DIGITS), condition=condition)


def _configuration(row: dict[str, Any], space: Space) -> Configuration:
    """The values of a row of irace's table, without the parameters that are fixed."""
    return {p.name: row[p.name] for p in space.parameters if row.get(p.name) is not None}


def _arithmetic(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    mu, block = case["mu"], case["blockSize"]
    each_test, n_new = case["eachTest"] * block, case["elitistNewInstances"] * block
    n = n_iterations(case["n_variable_parameters"])
    schedule, remaining = [], case["budget"]
    for i in range(1, n + 1):
        budget = iteration_budget(remaining, i, n)
        remaining -= budget
        elites = {"n_elites": n, "n_old": mu + (i - 2) * n_new, "n_new": n_new}
        schedule.append(
            {
                "iteration": i,
                "current_budget": budget,
                "nb_configurations_first_or_nonelitist": n_configurations(budget, i, mu=mu, each_test=each_test),
                "nb_configurations_elitist": n_configurations(budget, i, mu=mu, each_test=each_test, **elites)
                if i > 1
                else None,
            }
        )
    least = {
        elitist: minimum_budget(n, n, mu=mu, each_test=each_test, n_new=n_new, elitist=elitist)
        for elitist in (True, False)
    }
    found = {
        "nb_iterations": n,
        "min_survival": n,
        "minimum_budget_elitist": least[True],
        "minimum_budget_nonelitist": least[False],
        "schedule": schedule,
    }
    yield Check("arithmetic", name, difference({key: case[key] for key in found}, found))


def _nb_configurations(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    found = n_configurations(
        case["currentBudget"],
        case["indexIteration"],
        mu=case["mu"],
        each_test=case["eachTest"] * case["blockSize"],
        n_elites=case["nElites"],
        n_old=case["nOldInstances"],
        n_new=case["newInstances"],
    )
    yield Check("nb_configurations", name, difference(case["result"], found))


def _elite_weights(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    yield Check("elite_weights", name, difference(case["weights"], elite_weights(case["n"]).tolist()))


def _model(vectors: Vectors) -> Iterator[Check]:
    space = Space(parameters(vectors).values())
    yield from each("model", vectors["model"]["traces"], partial(_trace, space))


def _trace(space: Space, name: str, trace: dict[str, Any]) -> Iterator[Check]:
    """Initialise, updates and soft restarts in a row: each number of all distributions after each step."""
    model = SamplingModel(space, RaceOptions(elitist=trace["elitist"]))
    for number, step in enumerate(trace["steps"], start=1):
        kind, place = f"model, {step['step']}", f"{name}, step {number}"
        elites = {row[".ID."]: _configuration(row, space) for row in step.get("elites", [])}
        if step["step"] == "initialise":
            model.initialise(elites)
        elif step["step"] == "update":
            model.update(
                elites,
                {row[".ID."]: row.get(".PARENT.") for row in step["elites"]},
                n_new=step["nb_new_configurations"],
                iteration=step["iteration"],
                iterations=step["nb_iterations"],
            )
        else:
            model.restart(step["restart_ids"], step["nb_new_configurations"])
        for parameter, of_elites in step["model"].items():
            if found := difference(sorted(of_elites), sorted(map(str, model.elites))):
                yield Check(kind, f"{place}, {parameter}", f"elites: {found}")
                continue
            for elite, numbers in of_elites.items():
                ours = _distribution(model, space, elite, parameter)
                pairs = zip(_in_unit_scale(space[parameter], numbers), ours, strict=True)
                for position, (theirs, own) in enumerate(pairs, start=1):
                    where = f"{place}, {parameter} of elite {elite}, number {position}"
                    yield Check(kind, where, difference(theirs, own))


def _distribution(model: SamplingModel, space: Space, elite: str, name: str) -> list[float]:
    """The probabilities of values, or standard deviation in irace's scale and mean in ours."""
    parameter, own = space[name], model.elites[int(elite)]
    if parameter.kind == "categorical":
        return [float(weight) for weight in own.weights[name]]
    column = space.variable.index(parameter)
    low, high = parameter.bounds({}) or (0.0, 1.0)
    return [own.spreads[column] * (1.0 if parameter.log else high - low), own.centres[column]]


def _in_unit_scale(parameter: Parameter, numbers: list[float]) -> list[float | None]:
    """The recorded mean of a numeric or ordered parameter, which is a value or its place, in the scale of ours."""
    if parameter.kind == "categorical":
        return list(numbers)
    sd, mean = numbers
    bounds = parameter.bounds({})
    if mean is None or bounds is None:
        return [sd, None]
    return [sd, parameter.position(parameter.values[int(mean) - 1] if parameter.values else mean, bounds)]


def _quantiles(vectors: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    parameter = parameters(vectors)[case["parameter"]]
    parameter = replace(parameter, digits=case.get("digits", parameter.digits))
    bounds = parameter.bounds({}) or (0.0, 1.0)
    for u, expected in zip(case["u"], case["values"], strict=True):
        found = parameter.quantile(u, bounds)
        yield Check("quantiles", f"{name}, {parameter.name} at {u}", difference(expected, found))


def _similar(vectors: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    space = Space(parameters(vectors).values())
    rows = {row[".ID."]: _configuration(row, space) for row in case["configurations"]}
    yield Check("similar", name, difference(case["similar_ids"], similar(space, rows, case["threshold"])))


def _overall_ranks(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    costs = table(case["costs"])
    found = overall_ranks(costs, "friedman").tolist()
    yield Check("overall_ranks, friedman", name, difference(case["friedman"], found))
    found = overall_ranks(costs, "t-test").tolist()
    wrong = difference(case["ttest"], found)
    yield Check("overall_ranks, t-test", name, wrong, bool(wrong) and _differ_by_ties(case["ttest"], found, costs))


def _differ_by_ties(expected: list[float], found: list[float], costs: Floats) -> bool:
    """Whether only equal means, over the instances that those of as many results share, are in another order."""
    present = ~np.isnan(costs)
    counts = present.sum(axis=0)
    groups = [np.flatnonzero(counts == count) for count in np.unique(counts)[::-1]]
    theirs, ours = np.array(expected), np.array(found)
    in_order = all(theirs[a].max() < theirs[b].min() for a, b in pairwise(groups))
    return in_order and all(
        order_is_same(theirs[group], ours[group], costs[present[:, group].all(axis=1)][:, group].mean(axis=0))
        for group in groups
    )


def _table_columns(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    found = {"W": concordance(table(case["costs"]))}
    yield Check("table_columns", name, difference({"W": case["kendall_w"]}, found, digits=ROUNDING))


def _command_lines(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    space = Space([categorical(f"p{n}", ["any"], switch=switch) for n, switch in enumerate(case["switches"])])
    values = {f"p{n}": value for n, value in enumerate(case["values"]) if value is not None}
    yield Check("command_lines", name, difference(case["result"], space.command_line(values)))


def _truncated_normal(_: Vectors, name: str, case: dict[str, Any]) -> Iterator[Check]:
    low, width, n = case["low"], case["high"] - case["low"], case["n"]
    mean, sd = (case["mean"] - low) / width, case["sd"] / width
    values = truncated_normal(_evenly(N_DRAWS), mean, sd)
    error = float(values.std()) / math.sqrt(n)
    at = np.array([0.1, 0.5, 0.9])
    quantiles = truncated_normal(at, mean, sd)
    mass = float(ndtr((1 - mean) / sd) - ndtr(-mean / sd))
    densities = np.exp(-(((quantiles - mean) / sd) ** 2) / 2) / (math.sqrt(2 * math.pi) * sd * mass)
    limits = {
        "exact_mean": (case["exact_mean"], low + width * values.mean(), width * EXACT),
        "sample_mean": (case["sample_mean"], low + width * values.mean(), width * CHANCE_SIGMAS * error),
        "sample_sd": (case["sample_sd"], width * values.std(), width * CHANCE_SIGMAS * error),
    }
    errors = CHANCE_SIGMAS * np.sqrt(at * (1 - at) / n) / densities
    for q, expected, found, allowed in zip(at, case["q10_q50_q90"], quantiles, errors, strict=True):
        limits[f"quantile {q}"] = expected, low + width * found, width * allowed
    for what, (expected, found, allowed) in limits.items():
        wrong = "" if abs(expected - found) <= allowed else f"expected {expected} +- {allowed:.2g}, found {found}"
        yield Check("truncated_normal", f"{name}, {what}", wrong)


def _sampled_frequencies(domains: dict[str, Any]) -> Iterator[Check]:
    for domain, cases in domains.items():
        if domain != "note":
            kind = f"sampled_frequencies, {domain}"
            yield from each(kind, cases, partial(_frequencies, kind, domain))


def _frequencies(kind: str, domain: str, name: str, case: dict[str, Any]) -> Iterator[Check]:
    """How often each value of an integer or ordered parameter is drawn around one."""
    sd, mean = case["model"]
    expected = np.array(case["freq"])
    last = len(expected)
    log = domain.startswith("intlog")
    parameter = ordered("x", range(1, last + 1)) if domain == "ord" else integer("x", 1, last, log=log)
    model = SamplingModel(Space([parameter]), RaceOptions())
    model.initialise({0: {"x": str(mean) if domain == "ord" else mean}})
    model.elites[0].spreads[0] = sd if log else sd / (last - 1)
    drawn = model.sample(EVENLY, [0], _Even(np.random.PCG64()), lambda _: False)
    found = np.bincount([int(c["x"]) for c, _ in drawn], minlength=last + 1)[1:] / EVENLY
    allowed = CHANCE_SIGMAS * np.sqrt(np.maximum(expected, 10 / N_DRAWS) / N_DRAWS) + 2 / EVENLY
    wrong = [
        f"value {value}: expected {of_r:.6f} +- {limit:.2g}, found {ours:.6f}"
        for value, of_r, limit, ours in zip(range(1, last + 1), expected, allowed, found, strict=True)
        if abs(of_r - ours) > limit
    ]
    yield Check(kind, name, wrong[0] if wrong else "")


class _Even(np.random.Generator):
    """Not random: draws are at evenly spaced places, so that what is sampled has its exact frequencies."""

    def random(self, size: int | tuple[int, int]) -> Floats:  # type: ignore[override]
        n, *columns = np.atleast_1d(size)
        return np.broadcast_to(_evenly(n).reshape(n, *[1] * len(columns)), size)


def _evenly(n: int) -> Floats:
    return (np.arange(n) + 0.5) / n


_CASES: dict[str, Callable[[Vectors, str, dict[str, Any]], Iterator[Check]]] = {
    "arithmetic": _arithmetic,
    "nb_configurations": _nb_configurations,
    "elite_weights": _elite_weights,
    "quantiles": _quantiles,
    "similar": _similar,
    "overall_ranks": _overall_ranks,
    "table_columns": _table_columns,
    "command_lines": _command_lines,
    "truncated_normal": _truncated_normal,
}
