"""Asks a method for its next batch in a thread, so that the experiments that are upcoming can run meanwhile."""

from collections.abc import Container
from concurrent.futures import ThreadPoolExecutor

from mercator_design.race.elimination.race import Experiment
from mercator_design.race.methods.optimizer import Optimizer


class NextBatch:
    """The next batch of a method that is proposing configurations.

    Args:
        optimizer: The method. Until `done`, only its configurations may be read.
        known: Experiments that are not upcoming, because they have run or are running.

    Attributes:
        upcoming: The configurations of experiments that the batch will most probably have; new ones have the numbers
            that they will most probably have.
    """

    def __init__(self, optimizer: Optimizer, known: Container[Experiment]) -> None:
        self._optimizer = optimizer
        experiments, configurations = optimizer.upcoming or ([], {})
        self.upcoming = {one: configurations[one.configuration] for one in experiments if one not in known}
        thread = ThreadPoolExecutor(1)
        self._batch = thread.submit(optimizer.ask)
        thread.shutdown(wait=False)

    @property
    def done(self) -> bool:
        """Whether `batch` returns at once."""
        return self._batch.done()

    def batch(self) -> list[Experiment]:
        """Wait for the batch.

        Raises:
            RaceError: As `Optimizer.ask`.
        """
        return self._batch.result()

    def is_right(self, experiment: Experiment) -> bool:
        """Whether the number of an experiment's configuration was predicted rightly, when the batch is there."""
        predicted = self.upcoming.get(experiment)
        number = experiment.configuration
        return predicted is None or self._optimizer.configurations[number : number + 1] == [predicted]
