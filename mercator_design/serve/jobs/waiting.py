"""How long a new job will wait: the jobs before it are run through, in the order of the scheduler."""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mercator_design.serve.jobs.index import Row
from mercator_design.serve.jobs.scheduler import next_job

_MAX_JOBS = 200
"""Jobs that are run through; those behind them begin at the same time as the last of these."""


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
    new: Row,
    queued: Sequence[Row],
    running: Sequence[Row],
    *,
    seconds: Callable[[Row], float],
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
    served = {row.owner: -1 for row in queued}
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
                served[row.owner] = begun
                heapq.heappush(at_work, (now + seconds(row), len(running) + begun, row))
                continue
        if not at_work:
            break
        now, _, _ = heapq.heappop(at_work)
    return Wait(running=len(running), queued=begun, seconds=now)


def remaining_seconds(row: Row, usual: float) -> float:
    """The time that a job still takes [s].

    Args:
        row: The job.
        usual: Seconds that an experiment takes, for a job that has run too few to know.
    """
    if row.left is not None:
        return row.left
    left = max(0, row.budget - row.experiments)
    pace = row.seconds / row.experiments if row.experiments and row.seconds else usual
    return left * pace
