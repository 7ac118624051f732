"""The experiments of a race that workers run, or get next, and the results that are not recorded yet."""

from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator

from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import Failed
from mercator_design.race.session.events import Measurement

_RENEWED = 0.15
"""Part of a batch after which results what is likely is computed again; it may take a millisecond."""


class Workload:
    """The work of a race.

    Attributes:
        todo: Experiments that have to run and have not begun, in their order.
        held: Results that are not recorded yet.
        under_way: The experiments that are running.
    """

    def __init__(self) -> None:
        self.todo: deque[Experiment] = deque()
        self.held: dict[Experiment, Measurement | Failed] = {}
        self._under_way: dict[int, Experiment] = {}  # by the index of its item
        self.under_way: set[Experiment] = set()
        self._likely: Iterator[Experiment] | None = None  # speculative experiments; None if not computed yet
        self._known_part = 0.0  # of the batch, when they were computed

    @property
    def is_done(self) -> bool:
        """Whether nothing has to run, and nothing is running."""
        return not (self.todo or self._under_way)

    def begin(self, place: int, experiment: Experiment) -> None:
        """Note that an experiment runs as the item of this index."""
        self._under_way[place] = experiment
        self.under_way.add(experiment)

    def end(self, place: int, result: Measurement | Failed) -> None:
        """Note that an item has run; hold its result, unless the prediction of its experiment was wrong."""
        if (experiment := self._under_way.pop(place, None)) is not None:
            self.under_way.discard(experiment)
            self.held[experiment] = result

    def keep(self, is_right: Callable[[Experiment], bool]) -> None:
        """Forget experiments whose prediction was wrong, and what has not begun."""
        self._under_way = {place: one for place, one in self._under_way.items() if is_right(one)}
        self.under_way = set(self._under_way.values())
        self.held = {one: result for one, result in self.held.items() if is_right(one)}
        self.todo.clear()

    def forget_likely(self) -> None:
        """Forget which speculative experiments are likely: the race is about to ask for others."""
        self._likely = None

    def next_likely(
        self, lookahead: Callable[[], Iterable[Experiment]], known: Container[Experiment], part: float
    ) -> Experiment | None:
        """The next speculative experiment that neither runs nor is known; None if there is none.

        Args:
            lookahead: Computes them.
            known: Those that have run.
            part: How much of the batch has run. What is likely is computed again when this has grown.
        """
        if self._likely is None or part >= self._known_part + _RENEWED:
            self._likely, self._known_part = iter(lookahead()), part
        return next((one for one in self._likely if one not in self.under_way and one not in known), None)
