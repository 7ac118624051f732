"""The experiments of a race in memory.

An experiment that has a score is a row of 37 bytes, and gets the form of an event when somebody asks for it: the
objects of a large race would take most of its memory. What does not fit in a row stays an object: failures, experiments
with scores by several objectives, and those that have ended before others with lower numbers.
"""

import struct
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import overload

from mercator_design.race.session.events import ExperimentDone, ScoreRevised

_ROW = struct.Struct("<IIIdQ9p")
"""Iteration, configuration, instance, score, seed; up to 8 bytes of the digest of what happened, with their number."""
MAX_NUMBER = 2**32 - 1
"""The largest number that an experiment or an instance may have: a row has 32 bits for it."""
_NO_ROW = bytes(_ROW.size)
_MAX_SEED, _MAX_OUTCOME = 2**64 - 1, 8


class Experiments(Mapping[int, ExperimentDone]):
    """The experiments that have run, by number: as they ended, and with their current scores."""

    def __init__(self) -> None:
        self._rows = bytearray()  # of the numbers below all that are missing
        self._n_rows = 0
        self._objects: dict[int, ExperimentDone] = {}
        self._n_ahead = 0  # numbers after one that is missing
        self._revised: dict[int, ExperimentDone] = {}
        self._of: dict[int, array[int]] = {}  # numbers by configuration

    def __setitem__(self, number: int, event: ExperimentDone) -> None:
        self._objects[number] = event
        if number < self._n_rows:  # it replaces another one
            return
        self._of.setdefault(event.configuration, array("I")).append(number)
        self._n_ahead += 1
        while (one := self._objects.get(self._n_rows)) is not None:
            row = _row(one)
            if row is not None:
                del self._objects[self._n_rows]
            self._rows += row or _NO_ROW
            self._n_rows += 1
            self._n_ahead -= 1

    def __getitem__(self, number: int) -> ExperimentDone:
        if (known := self._objects.get(number)) is not None:
            return known
        iteration, configuration, instance, score, seed, outcome = self._values(number)
        return ExperimentDone(
            experiment=number,
            iteration=iteration,
            configuration=configuration,
            instance=instance,
            seed=seed,
            score=score,
            outcome=outcome.hex(),
        )

    def __contains__(self, number: object) -> bool:
        return number in self._objects or (isinstance(number, int) and 0 <= number < self._n_rows)

    def __iter__(self) -> Iterator[int]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return self._n_rows + self._n_ahead

    @property
    def has_gaps(self) -> bool:
        """Whether a number is missing below another one."""
        return self._n_ahead > 0

    @property
    def numbers(self) -> Sequence[int]:
        """The numbers of the experiments that have run so far, in order."""
        first = range(self._n_rows)
        return [*first, *sorted(one for one in self._objects if one >= self._n_rows)] if self._n_ahead else first

    @property
    def configurations(self) -> list[int]:
        """The configurations that have run, in the order of their first experiments that have ended."""
        return [*self._of]

    def score(self, number: int) -> float | None:
        """The score of an experiment as it ended; None if it failed.

        Raises:
            KeyError: It has not run.
        """
        known = self._objects.get(number)
        return self._values(number)[3] if known is None else known.score

    def revise(self, event: ScoreRevised) -> None:
        """Replace the current score of a configuration on an instance, if it has run there."""
        for number in self._of.get(event.configuration, ()):
            if self[number].instance == event.instance:
                one = self._revised.get(number, self[number])
                self._revised[number] = replace(one, score=event.score, failure=event.failure)

    def current(self, number: int) -> ExperimentDone:
        """An experiment with its current score."""
        return self._revised.get(number) or self[number]

    def numbers_of(self, configuration: int) -> list[int]:
        """The numbers of the experiments of a configuration, in order."""
        return sorted(self._of.get(configuration, ()))

    def scores_of(self, configuration: int) -> dict[int, float]:
        """The current scores of a configuration by instance, in the order of its experiments."""
        found = {}
        for number in self.numbers_of(configuration):
            known = self._revised.get(number) or self._objects.get(number)
            instance, score = self._values(number)[2:4] if known is None else (known.instance, known.score)
            if score is not None:
                found[instance] = score
        return found

    def _values(self, number: int) -> tuple[int, int, int, float, int, bytes]:
        if not 0 <= number < self._n_rows:
            raise KeyError(number)
        values: tuple[int, int, int, float, int, bytes] = _ROW.unpack_from(self._rows, number * _ROW.size)
        return values


class Results(Sequence[ExperimentDone]):
    """Some experiments with their current scores, each made when it is asked for.

    Args:
        experiments: Those of the race.
        numbers: Of these, in order.
    """

    def __init__(self, experiments: Experiments, numbers: Sequence[int]) -> None:
        self._experiments, self._numbers = experiments, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, place: int) -> ExperimentDone: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[ExperimentDone]: ...
    def __getitem__(self, place: int | slice) -> ExperimentDone | Sequence[ExperimentDone]:
        if isinstance(place, slice):
            return Results(self._experiments, self._numbers[place])
        return self._experiments.current(self._numbers[place])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and [*self] == [*other]

    def __hash__(self) -> int:
        return hash((*self,))


def _row(event: ExperimentDone) -> bytes | None:
    """The row of an experiment; None if it does not fit."""
    try:
        outcome = bytes.fromhex(event.outcome)
    except ValueError:
        return None
    is_exact = type(event.score) is float and outcome.hex() == event.outcome and len(outcome) <= _MAX_OUTCOME
    if not is_exact or event.failure or event.scores or event.seed > _MAX_SEED:
        return None
    return _ROW.pack(event.iteration, event.configuration, event.instance, event.score, event.seed, outcome)
