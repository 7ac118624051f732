"""How the race went: its budget, its best configuration, how it converged, its elites."""

import math
from collections import Counter

from mercator_design.race.analysis.convergence import first_iterations, spreads
from mercator_design.race.elimination.summary import CONFIDENCE, Scores
from mercator_design.race.session.view import Incumbent
from mercator_design.results.analysis.pruning import module_counts
from mercator_design.results.facts import Facts
from mercator_design.show.charts import Axis, Bars, ChartLine, Thread, bar_chart, line_chart, parallel_chart
from mercator_design.show.report.markup import Html, figure, folded, note, row_of, section, table
from mercator_design.show.text.iterations import COLUMNS, FEW, best_line, iteration_cells, iteration_name, last_gain

_MAX_THREADS = 40
_MAX_AXES = 14
_MAX_NOTES = 3


def course(facts: Facts) -> Html:
    """The section of the race's iterations."""
    iterations = facts.view.incumbents
    if not iterations:
        return Html()
    charts = [_budget(facts), _incumbent(facts, iterations), _elimination(iterations), _convergence(facts)]
    return section(
        "course",
        "How the race went",
        row_of(*charts) if len(iterations) > 1 else _table(iterations),
        note(f"Last gain: {found}") if (found := last_gain(facts.record)) else "",
        _elites(facts),
        folded("All iterations as a table", _table(iterations)) if len(iterations) > 1 else "",
        _notes(iterations),
        command=facts.command("runs", "show"),
    )


def _notes(found: list[Incumbent]) -> Html:
    notes = [note(f"Iteration {one.ended.iteration}: {one.ended.note}") for one in found if one.ended.note]
    return Html("".join(notes[:_MAX_NOTES]) + (folded("More notes", *notes[_MAX_NOTES:]) if notes[_MAX_NOTES:] else ""))


def _budget(facts: Facts) -> Html:
    first = first_iterations(facts.record)
    iterations, experiments = facts.view.iterations, facts.record.experiments.values()
    used = Counter((one.iteration, first[one.configuration] < one.iteration) for one in experiments)
    kinds = [
        Bars(name, [used[one.iteration, again] for one in iterations])
        for name, again in (("new configurations", False), ("elites again", True))
    ]
    chart = bar_chart(list(map(iteration_name, iterations)), kinds, Axis("iteration"), Axis("experiments"))
    return figure(chart, "The budget, by iteration and by what it was spent on.")


def _incumbent(facts: Facts, found: list[Incumbent]) -> Html:
    line = best_line("best of each iteration, in the race", found, facts.possible_scores)
    lines = [line]
    if facts.headline is not None and facts.headline.is_fresh:
        mean, (low, high) = facts.headline.scores.mean, facts.headline.scores.interval
        lines.append(ChartLine("winner on fresh instances", [line.x[0], line.x[-1]], [mean] * 2, [low] * 2, [high] * 2))
    caption = (
        f"The best configuration at the end of each iteration: mean and interval of {CONFIDENCE:.0%}, on the instances "
        "that it had seen by then. It was chosen on them, so the mean is optimistic while it has seen few. "
        f"Intervals of fewer than {FEW} scores are cut off."
    )
    chart = line_chart(lines, Axis("experiments", whole=True), Axis(facts.score_name))
    return figure(chart, caption)


def _elimination(found: list[Incumbent]) -> Html:
    iterations = [one.ended for one in found]
    lines = [
        ChartLine(name, [one.iteration for one in iterations], [getattr(one, key) for one in iterations])
        for name, key in (("raced", "configurations"), ("alive at the end", "alive"), ("instances", "instances"))
    ]
    caption = (
        "How each iteration eliminated: configurations that raced, those alive at its end, instances that it raced on."
    )
    chart = line_chart(lines, Axis("iteration", whole=True), Axis("number", whole=True, low=0.0))
    return figure(chart, caption)


def _convergence(facts: Facts) -> Html:
    if facts.task is None:
        return Html()
    found = spreads(facts.task.optimizer.space, facts.record)
    lines = []
    for name, kind in (("choices differ", "categories"), ("numbers spread", "numbers")):
        known = [(one.iteration, value) for one in found if not math.isnan(value := getattr(one, kind))]
        if known:
            lines.append(ChartLine(name, [x for x, _ in known], [y for _, y in known]))
    if not lines:
        return Html()
    caption = (
        "How the sampling converged: how different the new configurations of an iteration are; 1 as if drawn at "
        "random, 0 if equal. Choices, as of behaviours and conditions: the probability that two of "
        "them differ. Numbers: their standard deviation."
    )
    axes = Axis("iteration", whole=True), Axis("spread, relative to random", low=0.0)
    return figure(line_chart(lines, *axes), caption)


def _elites(facts: Facts) -> Html:
    """The elites of all iterations as lines across the axes of their parts."""
    first = first_iterations(facts.record)
    numbers = [one for one in facts.former_elites if facts.view.scores(one)][:_MAX_THREADS]
    if len(numbers) < 2:
        return Html()
    made_of = [_made_of(facts, one) for one in numbers]
    names = [name for name in made_of[0] if len({one[name] for one in made_of}) > 1][: _MAX_AXES - 1]
    axes = [Axis("race mean"), *(_axis(name, [one[name] for one in made_of]) for name in names)]
    last = max(first.values())
    threads = [
        Thread(
            f"{facts.called(one)}, found in iteration {first[one]}",
            [Scores(tuple(facts.view.scores(one).values())).mean, *(_place(axis, row[axis.name]) for axis in axes[1:])],
            (first[one] - 1) / max(last - 1, 1),
            is_bold=one == facts.best,
        )
        for one, row in zip(numbers, made_of, strict=True)
    ]
    chart = parallel_chart(axes, threads, Axis("iteration that found it", low=1, high=last))
    what = "how many of each module they have" if facts.parts == "modules" else "their parameters"
    caption = (
        f"The {len(numbers)} elites of all iterations, a line each: their mean in the race, and {what}, where they "
        "differ."
    )
    return figure(chart, caption, is_wide=True)


def _made_of(facts: Facts, configuration: int) -> dict[str, object]:
    pfsm = facts.pfsm(configuration)
    if pfsm is None:
        values = facts.record.configurations[configuration]
        names = dict.fromkeys(name for one in facts.former_elites for name in facts.record.configurations[one])
        return {name: values.get(name) for name in names}
    counts = {name.replace("_", " "): count for name, count in module_counts(pfsm).items()}
    return {"states": len(pfsm.states), "transitions": sum(len(s.transitions) for s in pfsm.states), **counts}


def _axis(name: str, values: list[object]) -> Axis:
    words = sorted({value for value in values if isinstance(value, str)})
    return Axis(name, categories=tuple(words)) if words else Axis(name)


def _place(axis: Axis, value: object) -> float:
    if isinstance(value, str):
        return float(axis.categories.index(value))
    return math.nan if value is None else float(value)  # type: ignore[arg-type]  # numbers, else


def _table(found: list[Incumbent]) -> Html:
    return table(COLUMNS, map(iteration_cells, found), name="iterations")
