"""Which queued job runs next, and how long a new one will wait: users take turns, whatever they submit."""

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.turns import next_user

_MAX_JOBS = 200
"""Jobs that are run through; those behind them begin at the same time as the last of these."""


def next_job(
    queued: Sequence[IndexRow], running: Iterable[IndexRow], served: Mapping[str, int], max_running: int
) -> IndexRow | None:
    """The job to run next, or None.

    Users take turns (`next_user`). Of the jobs of a user, the one of the highest priority comes first; of several, the
    oldest.

    Args:
        queued: Jobs that can run, in the order of their submission.
        running: Jobs that run.
        served: A number for each user whose job was started; it is higher for a later one.
        max_running: Number of jobs of a user that may run at the same time.
    """
    owner = next_user((row.job.owner for row in queued), Counter(row.job.owner for row in running), served, max_running)
    return max(
        (row for row in queued if row.job.owner == owner), key=lambda row: row.job.request.priority, default=None
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Wait:
    """What is before a new job.

    running: Jobs that run now.
    queued: Jobs that begin before it.
    seconds: Until it begins.
    """

    running: int
    queued: int
    seconds: float


def wait_of(
    new: IndexRow,
    queued: Sequence[IndexRow],
    running: Sequence[IndexRow],
    *,
    seconds: Callable[[IndexRow], float],
    races: int,
    max_running: int,
) -> Wait:
    """What is before a new job, if nobody submits or stops another one.

    Args:
        new: The job.
        queued: Jobs that wait, in the order of their submission.
        running: Jobs that run.
        seconds: The time that a job still takes [s].
        races: Jobs that run at the same time.
        max_running: Jobs of a user that may run at the same time.
    """
    waiting, now, begun = [*queued, new], 0.0, 0
    served = {row.job.owner: -1 for row in queued}
    at_work = [(seconds(row), number, row) for number, row in enumerate(running)]
    heapq.heapify(at_work)
    while begun < _MAX_JOBS:
        if len(at_work) < races:
            row = next_job(waiting, [one for _, _, one in at_work], served, max_running)
            if row is new:
                break
            if row is not None:
                waiting.remove(row)
                begun += 1
                served[row.job.owner] = begun
                heapq.heappush(at_work, (now + seconds(row), len(running) + begun, row))
                continue
        if not at_work:
            break
        now, _, _ = heapq.heappop(at_work)
    return Wait(running=len(running), queued=begun, seconds=now)


def remaining_seconds(row: IndexRow, usual: float) -> float:
    """The time that a job still takes [s].

    Args:
        row: The job.
        usual: Seconds that an experiment takes, for a job that has run too few to know.
    """
    if row.left is not None:
        return row.left
    left = max(0, row.job.request.budget - row.experiments)
    pace = row.job.seconds / row.experiments if row.experiments and row.job.seconds else usual
    return left * pace
