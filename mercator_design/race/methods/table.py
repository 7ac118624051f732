"""The methods of a race by name: what proposes configurations, and decides which of them run on which instances."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Literal, Protocol

from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.methods.moves import Moves
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.optuna_sampler import OptunaSampler
from mercator_design.race.methods.search import MakeSampler, Proposal, Sampler, Search, SearchOptions
from mercator_design.race.racing.options import RaceOptions
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space
from mercator_design.seeds import generator


class Method(Protocol):
    """Makes a race over a space, which begins with some configurations if it is given any."""

    def __call__(
        self, space: Space, *, budget: int, seed: int, initial: Sequence[Mapping[str, Value]] = ()
    ) -> Optimizer: ...


def _uniform(space: Space, *, seed: int, generation: int) -> Sampler:  # noqa: ARG001 - as samplers are made
    """Proposes configurations in which every active parameter is uniform over its domain."""
    moves = Moves(space, generator(seed, "search, random"))

    def propose(given: Configuration | None = None) -> Proposal:
        return Proposal(moves.uniform() if given is None else given)

    return propose


def _learning(
    space: Space,
    *,
    budget: int,
    seed: int,
    options: SearchOptions,
    sampler: MakeSampler,
    initial: Sequence[Mapping[str, Value]] = (),
) -> Search:
    """A search whose sampler learns from generations before, with a note if it hardly can."""
    race = Search(space, budget=budget, seed=seed, options=options, sampler=sampler, initial=initial)
    if budget <= options.generation * options.instances:
        race.notes.append(
            f"a budget of {budget} is hardly more than random search: what there is to learn from is a generation of "
            f"{options.generation} random configurations, on up to {options.instances} instances each"
        )
    return race


def _optuna(name: Literal["tpe", "cma-es"]) -> Method:
    options = SearchOptions(instances=20, generation=10, pruning=0.1)
    return partial(_learning, options=options, sampler=partial(OptunaSampler, name=name))


RACES: Mapping[str, RaceOptions] = {"irace": RaceOptions.irace(), "surrogate": RaceOptions()}
"""Iterated F-race as irace's; and with the library's own options, a surrogate above all."""
METHODS: Mapping[str, Method] = {
    **{name: partial(IteratedRace, options=options) for name, options in RACES.items()},
    "random": partial(Search, options=SearchOptions(instances=10, generation=100), sampler=_uniform),
    "tpe": _optuna("tpe"),
    "cma-es": _optuna("cma-es"),
}
"""Races, and searches: uniform; and Optuna's tree-structured Parzen estimator and CMA-ES, with its Wilcoxon pruner's
rule.
"""
