"""New configurations that a surrogate proposes.

irace learns only from which configurations survive. Here all costs so far train a surrogate. Candidates come from the
sampling model, from moves of the best configurations, and from uniform draws; further moves improve them. Each proposal
is the best candidate for one function that is sampled from the surrogate (Thompson sampling), so proposals differ where
the surrogate is uncertain.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.random import Generator
from threadpoolctl import ThreadpoolController

from mercator_design.race.methods.additive_model import effects, table
from mercator_design.race.methods.model import SamplingModel
from mercator_design.race.methods.moves import Moves
from mercator_design.race.methods.surrogate import Features, Floats, Surrogate
from mercator_design.race.racing.history import RaceHistory
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

MAX_LEARNT_FROM = 200
"""Maximum number of configurations to learn from: half are those with most results, half the newest."""
_CANDIDATES = {"model": 50, "mutated": 87, "crossed": 33, "uniform": 30}
_ROUNDS = 2
"""Rounds of moves from the most promising candidates."""
_PROMISING = 20
_CHILDREN = 4
"""Mutations of each promising candidate; one more child is made by crossing."""
_MAX_SAMPLED = 300
"""Maximum number of candidates at which functions are sampled: the time grows with its cube."""
_MIN_PARENTS = 5


class Proposer:
    """Proposes configurations of a space; `structure` as for `Moves`."""

    def __init__(self, space: Space, *, structure: float = 0.0) -> None:
        self._space = space
        self._structure = structure
        self._features = Features(space)
        self._surrogate = Surrogate(self._features)
        self._places: dict[int, Floats] = {}  # of configurations that have run
        # The matrices are small: threads would mostly wait, and the last bits would depend on the number of cores.
        self._threads = ThreadpoolController()

    def propose(
        self,
        n: int,
        ranked: Sequence[int],
        history: RaceHistory,
        *,
        model: SamplingModel,
        generator: Generator,
        excluded: Callable[[Configuration], bool],
    ) -> list[tuple[Configuration, int]]:
        """Up to n different configurations, each with its most similar elite.

        Args:
            n: Maximum number.
            ranked: The elites, best first.
            history: The history of the race.
            model: The elites' distributions.
            generator: Makes all random draws.
            excluded: Returns True for a configuration that must not be proposed.
        """
        with self._threads.limit(limits=1, user_api="blas"):
            expected = self._learn(history)
            best = sorted(expected, key=lambda number: expected[number])[: max(_MIN_PARENTS, len(ranked))]
            parents = [history.configurations[number] for number in (*ranked, *best)]
            candidates, places = self._candidates(parents, ranked, model, generator, excluded)
            if not candidates:
                return []
            features = self._features.of(places)
            mean, spread = self._surrogate.predict(features)
            promising = np.argsort(mean - 2 * spread, kind="stable")[:_MAX_SAMPLED]
            n = min(n, len(promising))
            chosen: list[int] = []
            for values in self._surrogate.sample(features[promising], n, generator):
                values[chosen] = np.inf
                chosen.append(int(values.argmin()))
            elites = self._features.of(self._places_of(ranked, history.configurations))
            nearest = self._surrogate.distances(features[promising[chosen]], elites).argmin(axis=1)
            return [(candidates[promising[k]], ranked[e]) for k, e in zip(chosen, nearest.tolist(), strict=True)]

    def _learn(self, history: RaceHistory) -> dict[int, float]:
        """Fit the surrogate; return the expected cost of each configuration that it was fitted to."""
        learnt_from = _most_informative(history.costs)
        known = table([history.costs[number] for number in learnt_from])
        rejected = np.isinf(known).any(axis=1)
        known = known[:, (~np.isnan(known[~rejected])).any(axis=0)]
        means, variance = effects(known[~rejected])
        y, noise = _compressed(means, variance / (~np.isnan(known[~rejected])).sum(axis=1))
        values, errors = np.full(len(known), y.max()), np.full(len(known), noise.max())
        values[~rejected], errors[~rejected] = y, noise
        scale = values.std() or 1.0
        features = self._features.of(self._places_of(learnt_from, history.configurations))
        self._surrogate.fit(features, (values - values.mean()) / scale, errors / scale**2)
        expected, _ = self._surrogate.predict(features)
        return dict(zip(np.array(learnt_from)[~rejected].tolist(), expected[~rejected].tolist(), strict=True))

    def _candidates(
        self,
        parents: Sequence[Configuration],
        ranked: Sequence[int],
        model: SamplingModel,
        generator: Generator,
        excluded: Callable[[Configuration], bool],
    ) -> tuple[list[Configuration], Floats]:
        """Candidates without duplicates, and their places."""
        moves = Moves(self._space, generator, structure=self._structure)
        taken: set[tuple[Value | None, ...]] = set()

        def different(drawn: Sequence[Configuration]) -> list[Configuration]:
            fresh = []
            for configuration in drawn:
                key = self._space.key(configuration)
                if key not in taken and not excluded(configuration):
                    fresh.append(configuration)
                taken.add(key)
            return fresh

        def any_of(pool: Sequence[Configuration]) -> Configuration:
            return pool[int(generator.integers(len(pool)))]

        candidates = different(
            [
                *(child for child, _ in model.draw(_CANDIDATES["model"], ranked, generator)),
                *(moves.mutated(any_of(parents), parents) for _ in range(_CANDIDATES["mutated"])),
                *(moves.crossed(any_of(parents), any_of(parents)) for _ in range(_CANDIDATES["crossed"])),
                *(moves.uniform() for _ in range(_CANDIDATES["uniform"])),
            ]
        )
        places = self._features.places(candidates)
        for _ in range(_ROUNDS):
            if not candidates:
                break
            mean, spread = self._surrogate.predict(self._features.of(places))
            order = np.argsort(mean - spread, kind="stable")[:_PROMISING]
            promising = [candidates[k] for k in order]
            children = different(
                [
                    *(moves.mutated(one, parents) for one in promising for _ in range(_CHILDREN)),
                    *(moves.crossed(one, any_of(promising)) for one in promising),
                ]
            )
            candidates += children
            places = np.vstack((places, self._features.places(children)))
        return candidates, places

    def _places_of(self, numbers: Sequence[int], configurations: Sequence[Configuration]) -> Floats:
        for number in numbers:
            if number not in self._places:
                self._places[number] = self._features.places([configurations[number]])[0]
        return np.array([self._places[number] for number in numbers])


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
