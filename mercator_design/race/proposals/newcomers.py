"""The configurations that enter a race by halving: simple and evenly spread ones first, then children of the elites."""

from collections.abc import Callable, Iterable, Sequence

from numpy.random import Generator

from mercator_design.errors import RaceError
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.proposals.moves import Moves
from mercator_design.race.proposals.proposals import Proposer
from mercator_design.race.proposals.sampling import even_sample, latin_hypercube
from mercator_design.race.space.encoding import Encoding
from mercator_design.race.space.parameter import Configuration, Key, key_of
from mercator_design.race.space.space import Space

Child = tuple[Configuration, int | None]
"""A configuration and the number of its parent; None if it has none."""

_MAX_TRIES = 20
"""Rounds of neighbours that may give nothing new before the search for them ends."""


class Newcomers:
    """Makes configurations that have not run and may run, each once.

    Args:
        space: The space of the configurations.
        history: The history of the race, which is only read.
        structure: Whether to use the structure of the space, if it has one.
    """

    def __init__(self, space: Space, history: RaceHistory, *, structure: bool) -> None:
        self._space = space
        self._history = history
        self._structure = space.structure if structure else None
        self._encoding = Encoding(space)
        self._proposer: Proposer | None = None

    def simple(self, n: int, initial: Sequence[Configuration], part: float, draws: Generator) -> list[Child]:
        """Up to n configurations without parents: given ones, and simple ones if the space's structure knows any.

        Args:
            n: Maximum number of configurations for which there is room.
            initial: The given ones.
            part: Part of the room left by the given ones that is for simple ones.
            draws: Makes all random draws.
        """
        found = _Different(self._is_possible)
        found.add((one, None) for one in initial[:n])
        found.add(self._simple(len(found.children) + round(part * (n - len(found.children))), found, draws))
        return found.children

    def first(self, n: int, simple: Sequence[Child], draws: Generator) -> list[Child]:
        """Up to n configurations without parents: those of `simple`, then those of a Latin hypercube.

        Args:
            n: Maximum number.
            simple: What `simple` has returned.
            draws: Makes all random draws.

        Raises:
            RaceError: All configurations of the hypercube are excluded, and there are no others.
        """
        found = _Different(self._is_possible)
        found.add(simple)
        if (n_left := n - len(found.children)) > 0:
            try:
                sampled = even_sample(
                    self._space,
                    n_left,
                    draws,
                    lambda one: not found.accepts(self._canonical(one)),
                    latin_hypercube,
                )
            except RaceError:
                if not found.children:
                    raise
                sampled = []  # the given and simple ones are all that there are
            found.add((self._canonical(one), None) for one in sampled)
        return found.children

    def neighbours(self, n: int, elites: Sequence[int], draws: Generator) -> list[Child]:
        """Up to n neighbours of elites, each of one that is drawn.

        Args:
            n: Maximum number.
            elites: Numbers of the elites.
            draws: Makes all random draws.
        """
        found = _Different(self._is_possible)
        found.add(self._moved(n, elites, draws))
        return found.children

    def later(
        self,
        n: int,
        elites: Sequence[int],
        neighbours: Sequence[Child],
        *,
        n_proposed: int,
        proposals: Generator,
        draws: Generator,
    ) -> list[Child]:
        """Up to n children of elites: those that a surrogate proposes, then neighbours.

        Args:
            n: Maximum number.
            elites: Numbers of the elites, best first.
            neighbours: The first neighbours.
            n_proposed: Maximum number of those that the surrogate proposes.
            proposals: Makes the random draws of the surrogate.
            draws: Makes those of further neighbours.
        """
        found = _Different(self._is_possible)
        if n_proposed:
            if self._proposer is None:  # made late: finding BLAS and the features of a space takes time
                self._proposer = Proposer(self._encoding, self._structure)
            found.add(
                self._proposer.propose(
                    n_proposed,
                    elites,
                    self._history,
                    generator=proposals,
                    excluded=lambda one: not self._is_possible(one),
                )
            )
        found.add(neighbours)
        for _ in range(_MAX_TRIES):
            if (n_left := n - len(found.children)) <= 0:
                break
            found.add(self._moved(n_left, elites, draws))
        return found.children[:n]

    def _is_possible(self, configuration: Configuration) -> bool:
        """Whether a configuration may run and has not."""
        return self._history.number(configuration) is None and not self._history.is_excluded(configuration)

    def _canonical(self, configuration: Configuration) -> Configuration:
        return configuration if self._structure is None else self._structure.canonical(configuration)

    def _simple(self, n: int, found: "_Different", draws: Generator) -> Iterable[Child]:
        """Simple configurations, until so many were found or a round gives nothing new."""
        if self._structure is None:
            return
        n_before = -1
        while n_before < len(found.children) < n:
            n_before = len(found.children)
            for one in self._structure.simple(draws):
                if len(found.children) >= n:
                    return
                yield one, None

    def _moved(self, n: int, elites: Sequence[int], draws: Generator) -> list[Child]:
        """For each of n elites that are drawn, a configuration that differs from it by a move or a few."""
        parents = draws.choice(elites, size=n).tolist()
        configurations = [self._history.configurations[number] for number in parents]
        if self._structure is not None:
            children = [self._structure.neighbour(one, draws) for one in configurations]
        else:
            rows = self._encoding.rows(configurations)
            moved = self._encoding.settled(Moves(self._encoding, draws).mutated(rows, rows))
            children = [self._encoding.configuration(row) for row in moved]
        return list(zip(children, parents, strict=True))


class _Different:
    """Children with different configurations that are possible."""

    def __init__(self, is_possible: Callable[[Configuration], bool]) -> None:
        self.children: list[Child] = []
        self._keys: set[Key] = set()
        self._is_possible = is_possible

    def accepts(self, configuration: Configuration) -> bool:
        """Whether a configuration is possible and not yet there."""
        return key_of(configuration) not in self._keys and self._is_possible(configuration)

    def add(self, children: Iterable[Child]) -> None:
        """Add children that are accepted; a generator sees each before it gives the next."""
        for child in children:
            if self.accepts(child[0]):
                self._keys.add(key_of(child[0]))
                self.children.append(child)
