"""Places: how many requests of a user, and of all users, are answered at a time."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from mercator_design.serve.accounts.refusals import Refusal

_AGAIN = {"Retry-After": "5"}


class Places:
    """The requests of one kind that are being answered.

    Args:
        what: Their kind, in messages.
        of_user: The number of those of a user.
        of_all: The number of all; more is left to health, to the login, and to other kinds.

    Attributes:
        taken: Their number now, by the name of the user.
    """

    def __init__(self, what: str, of_user: int, of_all: int) -> None:
        self._what, self._of_user, self._of_all = what, of_user, of_all
        self.taken: Counter[str] = Counter()

    @contextmanager
    def take(self, name: str) -> Iterator[None]:
        """Take a place for a user.

        Raises:
            Refusal: There is none.
        """
        if self.taken[name] >= self._of_user:
            wrong = f"expected at most {self._of_user} {self._what} of a user at a time: end one, or try again later"
            raise Refusal(429, "Limit reached", wrong, _AGAIN)
        if self.taken.total() >= self._of_all:
            wrong = f"expected at most {self._of_all} {self._what} of all users at a time: try again later"
            raise Refusal(503, "Busy", wrong, _AGAIN)
        self.taken[name] += 1
        try:
            yield
        finally:
            self.taken -= Counter([name])
