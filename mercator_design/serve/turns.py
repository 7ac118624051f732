"""The rule by which users take turns."""

from collections.abc import Iterable, Mapping


def next_user(users: Iterable[str], at_work: Mapping[str, int], served: Mapping[str, int], limit: int) -> str | None:
    """The user to serve next, or None.

    The user for whom the least is at work comes first; of several, the one who was served longest ago.

    Args:
        users: Those who wait.
        at_work: What is at work for each user.
        served: A number for each user who was served; it is higher for a later one.
        limit: What may be at work for a user.
    """
    may_be = {user for user in users if at_work.get(user, 0) < limit}
    return min(may_be, key=lambda user: (at_work.get(user, 0), served.get(user, -1), user), default=None)
