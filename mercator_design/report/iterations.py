"""The iterations of a race as a table, from its record; the race may be running."""

from collections import deque
from collections.abc import Mapping

from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.events import ExperimentDone, IterationEnded, ScoreRevised
from mercator_design.race.running.record import Record
from mercator_design.report.columns import aligned, difference

_FIRST, _LAST = 10, 20
"""Numbers of iterations that are shown, if there are more."""
_HEAD = ("iteration", "budget", "used", "raced", "instances", "alive", "best", "mean", "n", "against the best before")


def iterations_table(record: Record) -> list[str]:
    """A line for each iteration that has ended.

    The mean is that of the best configuration over the n instances that it has seen by the end of the iteration, with
    the scores at that time: an evaluator may replace them later. The last column is the mean difference to the best of
    the iteration before, on the instances that both have seen by then, with its confidence interval.
    """
    iterations = [one for _, one in sorted(record.iterations.items())]
    bests = {one.elites[0] for one in iterations}
    finished = deque(one for one in _results_in_order(record) if one.configuration in bests)
    scores: dict[int, dict[int, float]] = {best: {} for best in bests}
    before = None
    rows: list[tuple[object, ...]] = [_HEAD]
    for ended in iterations:
        while finished and record.experiments[finished[0].experiment].iteration <= ended.iteration:
            one = finished.popleft()
            if one.score is None:
                scores[one.configuration].pop(one.instance, None)
            else:
                scores[one.configuration][one.instance] = one.score
        rows.append(_row(ended, before, scores))
        before = ended.elites[0]
    if len(rows) > 1 + _FIRST + _LAST:
        rows[1 + _FIRST : -_LAST] = [("...", *[None] * (len(_HEAD) - 1))]
    return aligned(rows)


def _results_in_order(record: Record) -> list[ExperimentDone | ScoreRevised]:
    """The experiments in order of their numbers, and replaced scores where they were replaced."""
    revised = [
        one for number in record.revised if number in record.experiments for one in record.revised[number].values()
    ]
    return sorted([*record.experiments.values(), *revised], key=lambda one: one.experiment)


def iteration_notes(record: Record) -> list[str]:
    """The notes of iterations, a line each."""
    return [
        f"Note       iteration {one.iteration}: {one.note}" for _, one in sorted(record.iterations.items()) if one.note
    ]


def _row(ended: IterationEnded, before: int | None, scores: Mapping[int, Mapping[int, float]]) -> tuple[object, ...]:
    best = ended.elites[0]
    own = Scores(tuple(scores[best].values()))
    mean = f"{own.mean:.4g}" if own.values else ""
    numbers = (ended.budget, ended.used, ended.configurations, ended.instances, ended.alive, best)
    name = "final" if ended.postselection else str(ended.iteration)
    return (name, *numbers, mean, len(own.values), _difference(scores, best, before))


def _difference(scores: Mapping[int, Mapping[int, float]], best: int, before: int | None) -> str:
    if before is None:
        return ""
    if before == best:
        return "the same"
    common = sorted(scores[best].keys() & scores[before].keys())
    found = difference(*([scores[one][instance] for instance in common] for one in (best, before)))
    return f"{found} (n={len(common)})" if found else ""
