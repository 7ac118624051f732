"""The methods by name. A method proposes configurations and decides which of them run on which instances."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, Protocol

from mercator_design.config import spelling
from mercator_design.config.json_data import from_json
from mercator_design.config.schema import fields_of
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.methods.evostick import EvoStick, EvoStickOptions
from mercator_design.race.methods.halving import Halving, HalvingOptions
from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.optuna_sampler import OptunaSampler
from mercator_design.race.methods.search import Proposal, Sampler, Search, SearchOptions
from mercator_design.race.space.parameter import Bounds, Parameter, Value
from mercator_design.race.space.space import Space
from mercator_design.seeds import generator

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Method(Protocol):
    """Makes a race over a space, with initial configurations if there are any, and options if not the method's own."""

    def __call__(
        self,
        space: Space,
        *,
        budget: int,
        seed: int,
        initial: Sequence[Mapping[str, Value]] = (),
        options: Any = ...,  # noqa: ANN401 - each method's own dataclass
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


_UNIFORM = SearchOptions(instances=10, generation=100)
_LEARNING = SearchOptions(instances=20, generation=10, pruning=0.1)


def _optuna(name: Literal["tpe", "cma-es"]) -> Method:
    return partial(_learning, options=_LEARNING, sampler=partial(OptunaSampler, name=name))


DEFAULT_METHOD = "halving"
OPTIONS: "Mapping[str, DataclassInstance]" = {
    "halving": HalvingOptions(),
    "irace": RaceOptions(),
    "random": _UNIFORM,
    "tpe": _LEARNING,
    "cma-es": _LEARNING,
    "evostick": EvoStickOptions(),
}
"""The options of each method, by default."""
METHODS: Mapping[str, Method] = {
    "halving": Halving,
    "irace": IteratedRace,
    "random": partial(Search, options=_UNIFORM, sampler=_uniform),
    "tpe": _optuna("tpe"),
    "cma-es": _optuna("cma-es"),
    "evostick": EvoStick,
}
"""Generations by successive halving; iterated F-race; uniform random search; searches with Optuna's tree-structured
Parzen estimator and CMA-ES, with the rule of its Wilcoxon pruner; and EvoStick's evolutionary algorithm.
"""
SEVERAL_COSTS = tuple(name for name, make in METHODS.items() if getattr(make, "SEVERAL_COSTS", False))
"""The methods that rank configurations by several objectives without summing them."""


def options_of(method: str, given: Mapping[str, object]) -> "DataclassInstance":
    """The options of a method, of which some are given by name.

    Raises:
        RaceError: An option is unknown, of another type, or out of range.
    """
    default = OPTIONS[method]
    kinds = fields_of(type(default))
    wrong, read = list[str](), dict[str, object]()
    for name, value in given.items():
        if name not in kinds:
            near = spelling.nearest(name, [*kinds])
            hint = f"did you mean '{near}'?" if near else f"known: {', '.join(kinds)}"
            wrong.append(f"{excerpt(name)}: unknown option of {method}; {hint}")
            continue
        try:
            read[name] = from_json(value, kinds[name][0], error=RaceError, path=name)
        except RaceError as error:
            wrong += error.messages
    if wrong:
        raise RaceError(*wrong)
    return replace(default, **read)
