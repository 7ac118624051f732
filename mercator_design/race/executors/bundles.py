"""How many experiments go to a worker in one message, which costs a millisecond or more: an experiment may cost less.

Experiments that the race has asked for are dealt evenly, so that all workers end at about the same time. When none of
them is left, workers without anything get the speculative ones that `items` then gives, but nobody gets them as a
reserve: what the race asks for next would wait for them.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import islice, takewhile
from operator import length_hint
from typing import Any, Generic, TypeVar

T = TypeVar("T")
Bundle = list[tuple[int, T]]
"""Items with their indices."""

BUNDLE = 0.2
"""Maximum seconds of work in a bundle, if that is known."""
MAX_BUNDLED = 64
_MAX_SPECULATIVE = 2
"""Maximum number of speculative experiments in a bundle."""


class Bundles(Generic[T]):
    """Items of `Executor.run` in bundles.

    Args:
        items: The items.
        seconds: Maximum seconds of a bundle. [default: `BUNDLE`]
    """

    def __init__(self, items: Iterable[T | None], *, seconds: float | None = None) -> None:
        self._left = iter(items)
        self._numbered: Iterator[tuple[int, Any]] = enumerate(self._left)
        self._limit = BUNDLE if seconds is None else seconds
        self._seconds = math.inf  # per item

    def took(self, seconds: float, n: int) -> None:
        """Note that n items of one bundle took so long in a worker."""
        self._seconds = seconds / max(n, 1) or self._seconds

    def draw(self, n_under_way: int, max_under_way: int) -> list[Bundle[T]]:
        """The next bundles.

        Args:
            n_under_way: Number of bundles that workers have.
            max_under_way: The largest number of them: two for each worker.
        """
        room = max(max_under_way - n_under_way, 0)
        limit = min(max(int(self._limit / self._seconds), 1), MAX_BUNDLED)
        n_known = length_hint(self._left, room * limit)
        size = max(min(limit, math.ceil(n_known / max(max_under_way, 1))), 1)
        drawn = self._take(min(room * size, n_known))
        bundles = [drawn[k::room] for k in range(min(room, len(drawn)))]
        if n_known <= len(drawn):
            n_idle = max((max_under_way + 1) // 2 - n_under_way - len(bundles), 0)
            more = self._take(n_idle * min(limit, _MAX_SPECULATIVE))
            bundles += [more[k::n_idle] for k in range(min(n_idle, len(more)))]
        return bundles

    def _take(self, n: int) -> Bundle[T]:
        return list(takewhile(lambda one: one[1] is not None, islice(self._numbered, n)))
