"""The experiments of a race that workers run, or get next, and the results that are not recorded yet."""

from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator

from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import Failed
from mercator_design.race.session.events import Measurement


class Workload:
    """The work of a race.

    Attributes:
        todo: Experiments that have to run and have not begun, in their order.
        held: Results that are not recorded yet.
    """

    def __init__(self) -> None:
        self.todo: deque[Experiment] = deque()
        self.held: dict[Experiment, Measurement | Failed] = {}
        self._under_way: dict[int, Experiment] = {}  # by the index of its item
        self._likely: Iterator[Experiment] | None = None  # speculative experiments; None if not computed yet

    @property
    def under_way(self) -> set[Experiment]:
        """The experiments that are running."""
        return set(self._under_way.values())

    @property
    def is_done(self) -> bool:
        """Whether nothing has to run, and nothing is running."""
        return not (self.todo or self._under_way)

    def begin(self, place: int, experiment: Experiment) -> None:
        """Note that an experiment runs as the item of this index."""
        self._under_way[place] = experiment

    def end(self, place: int, result: Measurement | Failed) -> None:
        """Note that an item has run; hold its result, unless the prediction of its experiment was wrong."""
        if (experiment := self._under_way.pop(place, None)) is not None:
            self.held[experiment] = result

    def keep(self, is_right: Callable[[Experiment], bool]) -> None:
        """Forget experiments whose prediction was wrong, and what has not begun."""
        self._under_way = {place: one for place, one in self._under_way.items() if is_right(one)}
        self.held = {one: result for one, result in self.held.items() if is_right(one)}
        self.todo.clear()

    def forget_likely(self) -> None:
        """Forget which speculative experiments are likely: the race is about to ask for others."""
        self._likely = None

    def next_likely(
        self, lookahead: Callable[[], Iterable[Experiment]], known: Container[Experiment]
    ) -> Experiment | None:
        """The next speculative experiment that neither runs nor is known; None if there is none."""
        if self._likely is None:
            self._likely = iter(lookahead())
        under_way = self.under_way
        return next((one for one in self._likely if one not in under_way and one not in known), None)
