"""Comparisons: of the winner with others on fresh instances, and of the elites in the race."""

import math
from typing import Any

from mercator_design.race.analysis.pairs import Pair, compared
from mercator_design.race.elimination.summary import ALPHA, CONFIDENCE, Scores
from mercator_design.results.analysis.comparison import ALONE, RUNNER_UP, WinnerComparison
from mercator_design.results.facts import Facts
from mercator_design.show.charts import Axis, Dot, heat_map, interval_chart, number
from mercator_design.show.report.markup import Html, figure, folded, note, p_text, section, table
from mercator_design.show.text.columns import difference

_MAX_COLUMNS = 120


def comparison_part(facts: Facts, comparison: WinnerComparison | None, without: str) -> Html:
    """The section of the winner and others on fresh instances; `without` says why there is none."""
    shown = _fresh(facts, comparison) if comparison is not None else note(without) if without else ""
    made = facts.command() if comparison is not None else ""
    return section("comparison", "Comparison on fresh instances", shown, command=made)


def elites_part(facts: Facts) -> Html:
    """The section of the elites' scores in the race, and of the tests between them."""
    return section(
        "elites",
        "Elites in the race",
        _matrix(facts),
        _tests(facts),
        command=facts.command("runs", "show", options=["--csv", "experiments"]),
    )


def verdict(facts: Facts, comparison: WinnerComparison) -> str:
    """The conclusion of the comparison, in a sentence or two."""
    simple = [one.name for one in comparison.contestants if one.name.endswith(ALONE)]
    better, alike, worse = "significantly better than", "not distinguishable from", "significantly worse than"
    groups: dict[str, list[str]] = {better: [], alike: [], worse: []}
    sign = 1.0 if facts.task is None or facts.task.maximise else -1.0
    for pair in comparison.pairs():
        how = alike if pair.p_value >= ALPHA else better if sign * pair.differences.mean > 0 else worse
        groups[how].append(pair.second)
    parts = [f"it is {how} {_listed(group, simple)}" for how, group in groups.items() if group]
    if not parts:
        return "A single fresh instance is too few to compare the winner with others."
    mission = facts.mission
    if mission is not None and mission.is_ranked_by_all:
        return f"By {mission.objective_names[0]} alone, on the same fresh instances, {'; '.join(parts)}."
    return f"On the same fresh instances, {'; '.join(parts)}."


def _fresh(facts: Facts, comparison: WinnerComparison) -> Html:
    pairs = {pair.second: pair for pair in comparison.pairs(facts.possible_scores)}
    dots, rows = [], []
    for place, one in enumerate(comparison.contestants):
        scores = Scores(one.scores, facts.possible_scores)
        low, high = scores.interval
        pair = pairs.get(one.name)
        remark = "" if pair is None else p_text(pair.p_value)
        dots.append(Dot(one.name, scores.mean, low, high, one.scores, remark, min(place, 3)))
        figures = number(scores.mean), f"{number(low)} to {number(high)}", len(one.scores)
        rows.append((one.name, *figures, *_difference(facts, pair)))
    head = ("on fresh instances", "mean", f"{CONFIDENCE:.0%} interval", "runs", "difference", "p (Holm)")
    n, fewer = len(comparison.seeds), len(comparison.contestants[1].scores)
    where = f"{n} fresh instance{'s' * (n != 1)}" + (f" (the others on the first {fewer})" if fewer < n else "")
    caption = (
        f"The winner on {where}, against the runner-up, random control software (another one on each instance) and, "
        f"if PFSMs were raced, PFSMs of one state: mean, interval of {CONFIDENCE:.0%} by Student's t, without what is "
        "impossible, single runs. p: of no difference from the winner, by paired t-tests with Holm's correction. These "
        "runs do not count towards the budget."
    )
    chart = figure(interval_chart(dots, Axis(facts.score_name)), caption)
    return Html(
        note(verdict(facts, comparison)) + f'<div class="narrow">{chart}</div>' + table(head, rows, name="fresh")
    )


def _matrix(facts: Facts) -> Html:
    scores = [facts.view.scores(one) for one in facts.elites]
    instances = sorted({instance for known in scores for instance in known})[-_MAX_COLUMNS:]
    if not instances:
        return Html()
    values = [[known.get(instance, math.nan) for instance in instances] for known in scores]
    means = [Scores(tuple(known.values())).mean if known else math.nan for known in scores]
    names = [f"{facts.called(one)}, race mean {number(mean)}" for one, mean in zip(facts.elites, means, strict=True)]
    chart = heat_map(values, names, list(map(str, instances)), Axis("instance of the race"), Axis(facts.score_name))
    caption = "The elites' scores on the instances of the race, the winner first; a blank was not run."
    return figure(chart, caption, is_wide=True)


def _tests(facts: Facts) -> Html:
    pairs = compared({one: scores for one in facts.elites if (scores := facts.view.scores(one))})
    if not pairs:
        return Html()
    rows = [
        (facts.called(pair.first), facts.called(pair.second), len(pair.differences.values), *_difference(facts, pair))
        for pair in pairs
    ]
    about = note(
        "The elites in pairs, on the instances of the race that both have seen: difference of the means, and p of no "
        "difference by paired t-tests with Holm's correction. The elites were chosen on these instances, so fresh ones "
        "are fairer."
    )
    head, n = (
        ("elite", "against", "instances", "difference", "p (Holm)"),
        sum(pair.first == facts.best for pair in pairs),
    )
    others = folded("The other elites", table(head, rows[n:], name="other-pairs")) if rows[n:] else ""
    return Html(about + table(head, rows[:n], name="pairs") + others)


def _difference(facts: Facts, pair: Pair[Any] | None) -> tuple[str, str]:
    if pair is None:
        return "", ""
    return difference(pair.differences.values, possible=facts.possible_scores), p_text(pair.p_value).removeprefix(
        "p = "
    ).removeprefix("p ")


def _listed(contestants: list[str], simple: list[str]) -> str:
    """Contestants in words; all PFSMs of one state are named together."""
    names = [f"the {name}" if name == RUNNER_UP else name for name in contestants]
    if simple and set(simple) <= set(names):
        names = [*(name for name in names if name not in simple), "every PFSM of one state"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
