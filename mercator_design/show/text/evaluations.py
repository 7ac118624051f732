"""Evaluations of PFSMs on the same instances, as text, CSV and data for JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from mercator_design.errors import printable
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software
from mercator_design.race.analysis.pairs import Pair, compared
from mercator_design.race.elimination.fronts import nondominated
from mercator_design.race.elimination.summary import ALPHA, CONFIDENCE, Scores
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.results.analysis.swarm import SwarmStats
from mercator_design.scores import ScoreRange
from mercator_design.show.text.columns import aligned, difference
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.architectures import part_names, text_of
from mercator_design.system.csv_text import csv_text

_MAX_PAIRS = 10
"""Number of pairs that are printed; of more, only those with the best."""

_MAX_WIDTH = 30
"""Maximum width of a name in a table [characters]."""


class Evaluated(NamedTuple):
    """Control software with its results."""

    name: str
    software: Software
    result: Evaluation
    stats: SwarmStats | None = None

    @property
    def scores(self) -> Scores:
        return self.result.scores

    @property
    def label(self) -> str:
        """The name in tables; of a long one only its end, which has the number of the line."""
        name = printable(self.name)
        return name if len(name) <= _MAX_WIDTH else f"...{name[3 - _MAX_WIDTH :]}"


class Comparison:
    """PFSMs that ran on the same instances of a mission.

    Attributes:
        of: The PFSMs.
        mission: The mission.
        robot_model: The robot model.
        best: The index in `of` of the best PFSM: that with the best mean, the first if several are equal.
        pairs: All pairs of places, with paired t-tests and Holm's correction; none of a single instance.
        p_values: Of the pairs with the best, by the other's place.
    """

    def __init__(self, of: Sequence[Evaluated], mission: Mission, robot_model: RobotModel) -> None:
        self.of, self.mission, self.robot_model = of, mission, robot_model
        costs = [mission.cost(one.scores.mean) for one in of]
        self.best = costs.index(min(costs))
        scores = {k: dict(enumerate(one.scores.values)) for k, one in enumerate(of)}
        self.pairs: list[Pair[int]] = compared(scores, possible=of[0].scores.possible)
        self.p_values = {
            pair.second if pair.first == self.best else pair.first: pair.p_value
            for pair in self.pairs
            if self.best in (pair.first, pair.second)
        }


def evaluation_summary(one: Evaluated, mission: Mission, robot_model: RobotModel, *, seed: int | None) -> str:
    """The figures of an evaluation, a line each; given instances have no master seed."""
    scores = one.scores
    low, middle, high = scores.quartiles
    lines = [
        *_head(scores, mission, robot_model, seed),
        f"mean                 {scores.mean:.6g}{scores.possible.limit}",
    ]
    if scores.confidence_interval is not None:
        lines += [
            f"standard deviation   {scores.standard_deviation:.6g}",
            f"confidence interval  {scores.confidence_interval[0]:.6g} to {scores.confidence_interval[1]:.6g} "
            f"({CONFIDENCE:.0%} for the mean, by Student's t{_within(scores.possible)})",
        ]
    lines += [f"quartiles            {low:.6g}  {middle:.6g}  {high:.6g}"]
    if one.result.by_objective:
        lines = [*lines[:3], *(lines[3:] if mission.weights else []), *_objective_lines([one], mission)]
    if one.stats is not None:
        stats, names = one.stats, part_names(one.software)
        lines += [
            *(f"{f'in state {k}':21}{share:.1%} {names[k]}" for k, share in enumerate(stats.states)),
            f"transitions          {stats.transitions:.3g}/s of a robot",
            *(f"{f'on {colour}':21}{share:.1%}" for colour, share in stats.ground.items()),
            *([] if stats.neighbours is None else [f"neighbours           {stats.neighbours:.3g}"]),
            *([] if stats.obstacles is None else [f"obstacles in sight   {stats.obstacles:.1%} of the time"]),
            f"speed                {stats.speed:.3g} m/s",
        ]
    return "\n".join(map(printable, lines))


def evaluation_data(one: Evaluated, mission: Mission, robot_model: RobotModel, *, seed: int | None) -> dict[str, Any]:
    """The figures of an evaluation, for JSON; what is not defined, as for one run, is None."""
    scores = {"scores": one.scores.values, "seeds": one.result.seeds}
    return _facts(one.scores, mission, robot_model, seed) | scores | _figures(one)


def _objective_lines(of: Sequence[Evaluated], mission: Mission) -> list[str]:
    """A table of the means by each of several objectives, a row for each controller."""
    costs = [mission.costs([scores.mean for scores in one.result.by_objective.values()]) for one in of]
    is_on_front = nondominated(np.array(costs))
    named = zip(mission.objective_names, mission.all_objectives, strict=True)
    goals = [f"{name} ({one.direction})" for name, one in named]
    rows: list[Sequence[object]] = [("FSM", *goals, "")]
    for k, one in enumerate(of):
        figures = [f"{scores.mean:.4g}{_around(scores)}" for scores in one.result.by_objective.values()]
        rows.append((one.label, *figures, "on the front" if len(of) > 1 and is_on_front[k] else ""))
    about = f"means, with intervals of {CONFIDENCE:.0%} by Student's t"
    about += "; on the front: no other has better means in all" if len(of) > 1 else ""
    return [f"by objective         {about}", "", *aligned(rows)]


def _around(scores: Scores) -> str:
    interval = scores.confidence_interval
    return "" if interval is None else f" ({interval[0]:.4g} to {interval[1]:.4g})"


def comparison_text(found: Comparison, *, seed: int | None) -> str:
    """A table of PFSMs, their paired tests, and which is best."""
    rows: list[Sequence[object]] = [
        ("FSM", "mean", f"{CONFIDENCE:.0%} interval", "sd", "quartiles", "against the best", "p")
    ]
    best, possible = found.of[found.best], found.of[found.best].scores.possible
    for k, one in enumerate(found.of):
        scores, p = one.scores, found.p_values.get(k)
        against = "best" if k == found.best else difference(scores.values, best.scores.values, possible=possible)
        interval, sd = scores.confidence_interval, scores.standard_deviation
        rows.append(
            (
                one.label,
                f"{scores.mean:.4g}",
                None if interval is None else f"{interval[0]:.4g} to {interval[1]:.4g}",
                None if sd is None else f"{sd:.3g}",
                "  ".join(f"{value:.4g}" for value in scores.quartiles),
                against,
                None if p is None else _p_text(p),
            )
        )
    lines = [*_head(best.scores, found.mission, found.robot_model, seed)]
    lines += [
        f"scores               means{possible.limit}; intervals of {CONFIDENCE:.0%} by Student's t{_within(possible)}",
        "",
    ]
    lines += aligned(rows)
    if best.result.by_objective:
        lines += ["", *_objective_lines(found.of, found.mission)]
    if 1 < len(found.pairs) <= _MAX_PAIRS:
        pairs = [
            (
                f"{found.of[pair.first].label} - {found.of[pair.second].label}",
                difference(pair.differences.values, possible=possible),
                _p_text(pair.p_value),
            )
            for pair in found.pairs
        ]
        lines += ["", *aligned([("pair", "mean difference", "p"), *pairs])]
    equals = [found.of[k].label for k, p in found.p_values.items() if p >= ALPHA]
    if not found.pairs:
        rest = ""
    elif equals:
        names = ", ".join(equals) if len(equals) < _MAX_PAIRS else f"{len(equals)} of the {len(found.of) - 1} others"
        rest = f"; not significantly worse: {names}"
    else:
        rest = ", significantly better than the others"
    by = f" by {found.mission.objective_names[0]}" if found.mission.is_ranked_by_all else ""
    lines += ["", f"Best{by}: {best.label}{rest}"]
    if found.pairs:
        n = len(found.pairs)
        lines += ["p: paired t-test" if n == 1 else f"p: paired t-tests of {n} pairs, with Holm's correction"]
    if best.stats is not None:
        header, *cells = _stats_rows(found.of)
        shown = [[f"{cell:.3g}" if isinstance(cell, float) else cell for cell in row] for row in cells]
        lines += ["", *aligned([header, *shown])]
    return "\n".join(map(printable, lines))


def comparison_csv(found: Comparison) -> str:
    """The table as CSV, with the figures of `comparison_text`."""
    names = ("fsm", "mean", "low", "high", "standard_deviation", "lower_quartile", "median", "upper_quartile")
    stats = [row[1:] for row in _stats_rows(found.of)] if found.of[0].stats is not None else [()] * (len(found.of) + 1)
    by_name = [f"mean of {name}" for name in found.of[0].result.by_objective]
    rows: list[Sequence[object]] = [(*names, "runs", "p_value_against_best", *by_name, *stats[0])]
    for k, (one, others) in enumerate(zip(found.of, stats[1:], strict=True)):
        scores = one.scores
        low, high = scores.confidence_interval or (None, None)
        figures = (scores.mean, low, high, scores.standard_deviation, *scores.quartiles, len(scores.values))
        means = [each.mean for each in one.result.by_objective.values()]
        rows.append((one.name, *figures, found.p_values.get(k), *means, *others))
    return csv_text(rows)


def comparison_data(found: Comparison, *, seed: int | None) -> dict[str, Any]:
    """All figures and pairs, for JSON."""
    best = found.of[found.best]
    return {
        **_facts(best.scores, found.mission, found.robot_model, seed),
        "seeds": best.result.seeds,
        "best": best.name,
        "fsms": [
            {"name": one.name, "fsm": text_of(one.software), "scores": one.scores.values, **_figures(one)}
            for one in found.of
        ],
        "pairs": [
            {
                "first": found.of[pair.first].name,
                "second": found.of[pair.second].name,
                "mean_difference": pair.differences.mean,
                "confidence_interval": pair.differences.confidence_interval,
                "p_value": pair.p_value,
            }
            for pair in found.pairs
        ],
    }


def _head(scores: Scores, mission: Mission, robot_model: RobotModel, seed: int | None) -> list[str]:
    n = len(scores.values)
    instances = "given instances" if seed is None else f"fresh instances, seed {seed}"
    return [
        f"mission              {mission.name} ({mission.goal})",
        f"                     {mission.robots} robots, {mission.duration:g} s, robot model {robot_model.name}",
        f"runs                 {n}, on {instances}",
    ]


def _within(possible: ScoreRange) -> str:
    """The limits within which intervals are, in words."""
    low, high = (f"{limit:.6g}" if math.isfinite(limit) else "" for limit in possible[:2])
    if not low and not high:
        return ""
    return f", within {low} to {high}" if low and high else f", from {low} up" if low else f", up to {high}"


def _facts(scores: Scores, mission: Mission, robot_model: RobotModel, seed: int | None) -> dict[str, Any]:
    return {
        "mission": mission.name,
        "direction": mission.direction,
        "robots": mission.robots,
        "duration": mission.duration,
        "robot_model": robot_model.name,
        "runs": len(scores.values),
        "seed": seed,
        "possible_scores": [limit if math.isfinite(limit) else None for limit in scores.possible[:2]],
    }


def _figures(one: Evaluated) -> dict[str, Any]:
    scores = one.scores
    figures: dict[str, Any] = _statistics(scores)
    if one.result.by_objective:
        figures["objectives"] = {
            name: {"scores": each.values, **_statistics(each)} for name, each in one.result.by_objective.items()
        }
    return figures if one.stats is None else figures | {"stats": asdict(one.stats)}


def _statistics(scores: Scores) -> dict[str, Any]:
    return {
        "mean": scores.mean,
        "standard_deviation": scores.standard_deviation,
        "quartiles": scores.quartiles,
        "confidence_interval": scores.confidence_interval,
    }


def _stats_rows(of: Sequence[Evaluated]) -> list[list[object]]:
    """A header, and a row for each PFSM, by its label."""
    known = [(one, one.stats) for one in of if one.stats is not None]
    n_states = max(len(stats.states) for _, stats in known)
    colours = known[0][1].ground
    header = ["FSM", *(f"state {k}" for k in range(n_states)), *(f"on {colour}" for colour in colours)]
    rows: list[list[object]] = [[*header, "transitions/s", "neighbours", "obstacles", "speed m/s"]]
    for one, stats in known:
        shares = [*stats.states, *[None] * (n_states - len(stats.states)), *stats.ground.values()]
        rows.append([one.label, *shares, stats.transitions, stats.neighbours, stats.obstacles, stats.speed])
    return rows


def _p_text(p: float) -> str:
    return "< 0.0001" if p < 1e-4 else f"{p:.4f}"
