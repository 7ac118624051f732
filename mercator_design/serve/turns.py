"""The rule by which users take turns."""

from collections.abc import Iterable, Mapping


def next_user(users: Iterable[str], at_work: Mapping[str, int], served: Mapping[str, int], limit: int) -> str | None:
    """The user to serve next, or None.

    The user with the least work at present comes first; of several, the one who was served longest ago.

    Args:
        users: Users who wait.
        at_work: Number of jobs or tasks at work, by user.
        served: Number of the last turn, by user; absent before the first one.
        limit: Maximum number at work for a user.
    """
    may_be = {user for user in users if at_work.get(user, 0) < limit}
    return min(may_be, key=lambda user: (at_work.get(user, 0), served.get(user, -1), user), default=None)
