"""Which queued job runs next: users take turns, whatever they submit."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mercator_design.serve.jobs.index import Row


def next_job(queued: Sequence[Row], running: Iterable[Row], served: Mapping[str, int], max_running: int) -> Row | None:
    """The job to run next, or None.

    The user with the fewest running jobs comes first; of several, the one who was served longest ago. Of the jobs of a
    user, the one of the highest priority comes first; of several, the oldest.

    Args:
        queued: Jobs that can run, in the order of their submission.
        running: Jobs that run.
        served: A number for each user whose job was started; it is higher for a later one.
        max_running: Number of jobs of a user that may run at the same time.
    """
    now = Counter(row.owner for row in running)
    owners = {row.owner for row in queued if now[row.owner] < max_running}
    if not owners:
        return None
    owner = min(owners, key=lambda one: (now[one], served.get(one, -1), one))
    return max((row for row in queued if row.owner == owner), key=lambda row: row.priority)
