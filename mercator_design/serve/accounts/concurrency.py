"""Limits of open requests, of a user and of all users."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from mercator_design.serve.accounts.refusals import Refusal

_AGAIN = {"Retry-After": "5"}


class ConcurrencyLimit:
    """The limit of one kind of requests.

    A user has at most as many as are still free, so that a few users never take all of them.

    Args:
        what: The kind, in messages.
        of_user: Maximum number of a user.
        of_all: Maximum number of all users; health, the login and other kinds are not among them.

    Attributes:
        counts: The requests that are being answered, by the name of the user.
    """

    def __init__(self, what: str, of_user: int, of_all: int) -> None:
        self._what, self._of_user, self._of_all = what, of_user, of_all
        self.counts: Counter[str] = Counter()

    @contextmanager
    def count(self, name: str) -> Iterator[None]:
        """Count a request of a user while it is answered.

        Raises:
            Refusal: It is one too many.
        """
        if self.counts[name] >= self._of_user:
            wrong = f"expected at most {self._of_user} {self._what} of a user at a time: end one, or try again later"
            raise Refusal(429, "Limit reached", wrong, _AGAIN)
        if self.counts[name] >= self._of_all - self.counts.total():
            wrong = f"expected fewer {self._what} of all users, at most {self._of_all} at a time: try again later"
            raise Refusal(503, "Busy", wrong, _AGAIN)
        self.counts[name] += 1
        try:
            yield
        finally:
            self.counts -= Counter([name])
