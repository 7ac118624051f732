"""The scheduler: the next job to run, and the waiting time of a new one. Users take turns."""

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.turns import next_user

_MAX_JOBS = 200
"""Maximum number of simulated starts; later jobs get the waiting time of the last one."""


def next_job(
    queued: Sequence[IndexRow], running: Iterable[IndexRow], served: Mapping[str, int], max_running: int
) -> IndexRow | None:
    """The job to run next, or None.

    Users take turns (`next_user`). Of the jobs of a user, the one of the highest priority comes first; of several, the
    oldest.

    Args:
        queued: Jobs that can run, in the order of their submission.
        running: Jobs that run.
        served: Number of the last turn, by user.
        max_running: Maximum number of running jobs of a user.
    """
    owner = next_user((row.job.owner for row in queued), Counter(row.job.owner for row in running), served, max_running)
    return max(
        (row for row in queued if row.job.owner == owner), key=lambda row: row.job.request.priority, default=None
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Wait:
    """Jobs before a new job, and its waiting time.

    running: Number of running jobs.
    queued: Number of jobs that begin before it.
    seconds: Time until it begins [s].
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
    """Jobs before a new job, if nobody submits or stops another one.

    Args:
        new: The job.
        queued: Jobs that wait, in the order of their submission.
        running: Jobs that run.
        seconds: The time that a job still takes [s].
        races: Maximum number of running jobs.
        max_running: Maximum number of running jobs of a user.
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
    """Estimated remaining time of a job [s].

    Args:
        row: The job.
        usual: Time of an experiment, for a job that has run too few of them [s].
    """
    if row.left is not None:
        return row.left
    left = max(0, row.job.request.budget - row.experiments)
    pace = row.job.seconds / row.experiments if row.experiments and row.job.seconds else usual
    return left * pace
