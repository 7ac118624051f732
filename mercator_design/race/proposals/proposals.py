"""New configurations that a surrogate proposes.

irace learns only from which configurations survive. Here all costs so far train a surrogate. Candidates come from
moves of the best configurations and from uniform draws; further moves improve them. Each proposal is the best candidate
for one function that is sampled from the surrogate (Thompson sampling), so proposals differ where the surrogate is
uncertain.

Candidates are rows of numbers (encoding.py). Only the chosen ones are built, and brought to canonical form if the
space has a structure.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from hashlib import blake2b
from itertools import cycle, islice

import numpy as np
from numpy.random import Generator
from threadpoolctl import ThreadpoolController

from mercator_design.arrays import Floats
from mercator_design.race.elimination.additive_model import effects, table
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.proposals.moves import Moves
from mercator_design.race.proposals.surrogate import Features, Surrogate
from mercator_design.race.space.encoding import Encoding
from mercator_design.race.space.parameter import Configuration, Key, key_of
from mercator_design.race.space.space import Structure

MAX_LEARNT_FROM = 200
"""Maximum number of configurations to learn from: half are those with most results, half the newest."""
_IN_STRUCTURE = 0.5
"""Part of the mutations that are moves in the structure of the space, if it has one."""
_MUTATED, _CROSSED, _UNIFORM = 100, 40, 60
"""Candidates before further moves."""
_ROUNDS = 2
"""Rounds of further moves, from the most promising candidates."""
_PROMISING = 20
_CHILDREN = 4
"""Mutations of each promising candidate; one more child is made by crossing."""
_MIN_NEIGHBOURS, _NEIGHBOURS_EACH, _MAX_NEIGHBOURS = 6, 2, 30
"""Neighbours by the structure of the space in each round: the largest number for few proposals, for each proposal, and
the largest of all. They are made one by one, in fifty times the time of other candidates."""
_MIN_SAMPLED, _SAMPLED_EACH, _MAX_SAMPLED = 150, 2, 300
"""Candidates at which functions are sampled, in the same way: the time grows with the cube of their number."""
_MIN_PARENTS = 5
_DIGITS = 9
"""Rows are equal if they are so many decimals long."""


class Proposer:
    """Proposes configurations of a space.

    Args:
        encoding: Of its configurations as rows.
        structure: Makes a part of the mutations, if there is one.
    """

    def __init__(self, encoding: Encoding, structure: Structure | None = None) -> None:
        self._structure = structure
        self._in_structure = 0.0 if structure is None else _IN_STRUCTURE
        self._encoding = encoding
        self._features = Features(encoding)
        self._surrogate = Surrogate(self._features)
        self._known: dict[int, Floats] = {}  # rows of configurations that it has learnt from last, and of elites
        self._keys: set[bytes] = set()  # of all rows so far
        # The matrices are small: threads would mostly wait, and the last bits would depend on the number of cores.
        self._threads = ThreadpoolController()

    def propose(
        self,
        n: int,
        ranked: Sequence[int],
        history: RaceHistory,
        *,
        generator: Generator,
        excluded: Callable[[Configuration], bool],
    ) -> list[tuple[Configuration, int]]:
        """Up to n different configurations, each with its most similar elite.

        Args:
            n: Maximum number.
            ranked: The elites, best first.
            history: The history of the race.
            generator: Makes all random draws.
            excluded: Returns True for a configuration that must not be proposed.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            expected = self._learn(history, generator)
            best = sorted(expected, key=expected.__getitem__)[: max(_MIN_PARENTS, len(ranked))]
            candidates = self._candidates(n, ranked, best, history, generator)
            features = self._features.of(candidates)
            chosen = self._chosen(candidates, self._surrogate.sample(features, n, generator), excluded)
            elites = self._features.of(self._rows_of(ranked, history))
            nearest = self._surrogate.distances(features[list(chosen)], elites).argmin(axis=1)
            return [(child, ranked[e]) for child, e in zip(chosen.values(), nearest.tolist(), strict=True)]

    def _learn(self, history: RaceHistory, generator: Generator) -> dict[int, float]:
        """Fit the surrogate; return the expected cost of each configuration that it was fitted to.

        With several objectives, it learns a sum of their costs on the compressed scale with weights that are drawn anew
        for each generation, so that proposals spread along the front (ParEGO, Knowles 2006).
        """
        learnt_from = _most_informative(history.costs)
        self._known = {number: self._known[number] for number in learnt_from if number in self._known}
        parts = []
        for costs in history.tables:
            known = table([costs[number] for number in learnt_from])
            rejected = np.isinf(known).any(axis=1)
            known = known[:, (~np.isnan(known[~rejected])).any(axis=0)]
            means, variance = effects(known[~rejected])
            parts.append(_compressed(means, variance / (~np.isnan(known[~rejected])).sum(axis=1)))
        weights = generator.dirichlet(np.ones(len(parts))) if len(parts) > 1 else np.ones(1)
        y = sum(weight * part for weight, (part, _) in zip(weights, parts, strict=True))
        noise = sum(weight**2 * part for weight, (_, part) in zip(weights, parts, strict=True))
        values, errors = np.full(len(known), y.max()), np.full(len(known), noise.max())
        values[~rejected], errors[~rejected] = y, noise
        scale = values.std() or 1.0
        features = self._features.of(self._rows_of(learnt_from, history))
        expected = self._surrogate.fit(features, (values - values.mean()) / scale, errors / scale**2)
        return dict(zip(np.array(learnt_from)[~rejected].tolist(), expected[~rejected].tolist(), strict=True))

    def _candidates(
        self,
        n: int,
        ranked: Sequence[int],
        best: Sequence[int],
        history: RaceHistory,
        generator: Generator,
    ) -> Floats:
        """The most promising ones, which have not run."""
        moves = Moves(self._encoding, generator)
        numbers = [*ranked, *best]
        parents = self._rows_of(numbers, history)
        pool = _Pool(self._surrogate, self._features, self._keys)
        max_neighbours = min(max(_MIN_NEIGHBOURS, _NEIGHBOURS_EACH * n), _MAX_NEIGHBOURS)

        def any_of(n: int) -> list[int]:
            found: list[int] = generator.integers(len(numbers), size=n).tolist()
            return found

        def add(neighbours_of: Iterable[Configuration], *others: Floats) -> None:
            structure = self._structure
            neighbours = [] if structure is None else [structure.neighbour(one, generator) for one in neighbours_of]
            pool.add(np.vstack((self._encoding.rows(neighbours), self._encoding.settled(np.vstack(others)))))

        n_neighbours = min(round(self._in_structure * _MUTATED), max_neighbours)
        add(
            [history.configurations[numbers[k]] for k in any_of(n_neighbours)],
            moves.mutated(parents[any_of(_MUTATED - n_neighbours)], parents),
            moves.crossed(parents[any_of(_CROSSED)], parents[any_of(_CROSSED)]),
            self._encoding.uniform(_UNIFORM, generator),
        )
        for _ in range(_ROUNDS):
            promising = pool.best(_PROMISING, optimism=1.0)
            if not len(promising):
                break
            n_neighbours = min(round(self._in_structure * _CHILDREN * len(promising)), max_neighbours)
            built = [self._encoding.configuration(row) for row in promising[:n_neighbours]]
            add(
                islice(cycle(built), n_neighbours),
                moves.mutated(
                    np.resize(promising, (_CHILDREN * len(promising) - n_neighbours, promising.shape[1])), parents
                ),
                moves.crossed(promising, promising[generator.integers(len(promising), size=len(promising))]),
            )
        return pool.best(min(max(_MIN_SAMPLED, _SAMPLED_EACH * n), _MAX_SAMPLED), optimism=2.0)

    def _chosen(
        self, candidates: Floats, sampled: Floats, excluded: Callable[[Configuration], bool]
    ) -> dict[int, Configuration]:
        """The best candidate for each sampled function that is not excluded, with its place."""
        found: dict[int, Configuration] = {}
        keys: set[Key] = set()
        is_left = np.ones(len(candidates), dtype=bool)
        for values in sampled:
            while is_left.any():
                k = int(np.where(is_left, values, np.inf).argmin())
                is_left[k] = False
                child = self._encoding.configuration(candidates[k])
                if self._structure is not None:
                    child = self._structure.canonical(child)
                key = key_of(child)
                if key not in keys and not excluded(child):
                    found[k] = child
                    keys.add(key)
                    break
        return found

    def _rows_of(self, numbers: Sequence[int], history: RaceHistory) -> Floats:
        new = [number for number in numbers if number not in self._known]
        rows = self._encoding.rows([history.configurations[number] for number in new])
        self._known.update((number, row.copy()) for number, row in zip(new, rows, strict=True))
        self._keys.update(_keys(rows))
        return np.array([self._known[number] for number in numbers])


class _Pool:
    """Different rows, with what the surrogate expects of them.

    Args:
        surrogate: Predicts their costs.
        features: Of their space.
        known: Keys of rows that do not get into it.
    """

    def __init__(self, surrogate: Surrogate, features: Features, known: Iterable[bytes]) -> None:
        self._surrogate = surrogate
        self._features = features
        self._keys = set(known)
        self._rows = np.empty((0, features.n_parameters))
        self._mean, self._spread = np.empty(0), np.empty(0)

    def add(self, rows: Floats) -> None:
        """Add those rows that are different from all others."""
        new = {key: k for k, key in enumerate(_keys(rows)) if key not in self._keys}
        self._keys.update(new)
        rows = rows[list(new.values())]
        mean, spread = self._surrogate.predict(self._features.of(rows))
        self._rows = np.vstack((self._rows, rows))
        self._mean, self._spread = np.append(self._mean, mean), np.append(self._spread, spread)

    def best(self, n: int, *, optimism: float) -> Floats:
        """At most n rows, those with the lowest means less so many standard deviations."""
        return self._rows[np.argsort(self._mean - optimism * self._spread, kind="stable")[:n]]


def _keys(rows: Floats) -> list[bytes]:
    """Equal for rows that differ by rounding alone."""
    return [blake2b(row, digest_size=16).digest() for row in np.round(np.nan_to_num(rows, nan=-1.0), _DIGITS)]


def _most_informative(costs: Sequence[Mapping[int, float]]) -> list[int]:
    """Numbers of configurations to learn from."""
    known = [number for number, own in enumerate(costs) if own]
    if len(known) <= MAX_LEARNT_FROM:
        return known
    half = MAX_LEARNT_FROM // 2
    chosen = set(sorted(known, key=lambda number: -len(costs[number]))[:half])
    newest = [number for number in reversed(known) if number not in chosen]
    return sorted([*chosen, *newest[: MAX_LEARNT_FROM - half]])


def _compressed(means: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Compress costs above the median to a logarithmic scale: differences between bad costs say little of good ones.

    The unit is the distance from the median to the first decile.
    """
    middle = np.median(means)
    unit = float(middle - np.quantile(means, 0.1)) or 1.0
    above = np.maximum(means - middle, 0.0) / unit
    values = np.where(means > middle, np.log1p(above), (means - middle) / unit)
    return values, noise / (unit * (1 + above)) ** 2
