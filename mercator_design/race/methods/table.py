"""The methods by name. A method proposes configurations and decides which of them run on which instances."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal, Protocol

from mercator_design.race.methods.evostick import EvoStick
from mercator_design.race.methods.halving import Halving
from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.optuna_sampler import OptunaSampler
from mercator_design.race.methods.search import Proposal, Sampler, Search, SearchOptions
from mercator_design.race.space.parameter import Bounds, Parameter, Value
from mercator_design.race.space.space import Space
from mercator_design.seeds import generator


class Method(Protocol):
    """Makes a race over a space, with initial configurations if there are any."""

    def __call__(
        self, space: Space, *, budget: int, seed: int, initial: Sequence[Mapping[str, Value]] = ()
    ) -> Optimizer: ...


def _uniform(space: Space, *, seed: int, generation: int) -> Sampler:  # noqa: ARG001 - the signature of MakeSampler
    """Makes a sampler that draws every active parameter uniformly from its domain."""
    draws = generator(seed, "search, random")

    def anywhere(parameter: Parameter, bounds: Bounds) -> Value:
        if parameter.kind == "categorical":
            return parameter.values[int(draws.integers(len(parameter.values)))]
        return parameter.quantile(draws.random(), bounds)

    return lambda given=None: Proposal(space.build(anywhere) if given is None else given)


def _learning(space: Space, *, budget: int, options: SearchOptions, **given: Any) -> Search:  # noqa: ANN401
    """A search whose sampler learns from earlier generations, with a note if the budget is too small for that."""
    race = Search(space, budget=budget, options=options, **given)
    if budget <= options.generation * options.instances:
        race.notes.append(
            f"a budget of {budget} is little more than random search: it suffices for one generation of "
            f"{options.generation} random configurations, on up to {options.instances} instances each"
        )
    return race


def _optuna(name: Literal["tpe", "cma-es"]) -> Method:
    options = SearchOptions(instances=20, generation=10, pruning=0.1)
    return partial(_learning, options=options, sampler=partial(OptunaSampler, name=name))


DEFAULT_METHOD = "halving"
METHODS: Mapping[str, Method] = {
    "halving": Halving,
    "irace": IteratedRace,
    "random": partial(Search, options=SearchOptions(instances=10, generation=100), sampler=_uniform),
    "tpe": _optuna("tpe"),
    "cma-es": _optuna("cma-es"),
    "evostick": EvoStick,
}
"""Generations by successive halving; iterated F-race; uniform random search; searches with Optuna's tree-structured
Parzen estimator and CMA-ES, with the rule of its Wilcoxon pruner; and EvoStick's evolutionary algorithm.
"""
