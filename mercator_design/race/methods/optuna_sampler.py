"""Optuna's samplers as samplers of a search.

A configuration is a trial of a study in memory; its mean cost completes the trial. Pruned configurations are completed
with their mean, too, as Optuna's documentation of its WilcoxonPruner recommends. A configuration that is forbidden or
rejected is a failed trial, which samplers ignore. So the estimator would propose such configurations again and again:
once it has a cost, it gets up to _MAX_WORST of them as the worst of all.

In Optuna a parameter has one distribution. So a parameter with bounds that depend on others, or with rounded values, is
suggested as a place in [0, 1]; an integer or ordered one as an integer.
"""

import math
import warnings
from functools import partial
from typing import TYPE_CHECKING, Literal

from threadpoolctl import ThreadpoolController

from mercator_design.errors import RaceError
from mercator_design.race.methods.search import Proposal
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space
from mercator_design.seeds import generator

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler
    from optuna.trial import Trial

_MAX_WORST = 500
"""Maximum number of forbidden and rejected configurations to learn from: each makes later proposals slower."""


class OptunaSampler:
    """A sampler from Optuna.

    Args:
        space: What to configure.
        seed: Of the sampler.
        generation: The population of CMA-ES.
        name: Tree-structured Parzen estimator, each parameter by itself; or CMA-ES on all numeric and ordered
            parameters, with the estimator for the categorical ones. CMA-ES has no conditions: it also draws inactive
            parameters, which have no effect.

    Raises:
        RaceError: CMA-ES has fewer than two parameters.
    """

    def __init__(self, space: Space, *, seed: int, generation: int, name: Literal["tpe", "cma-es"]) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._space = space
        self._always = [p for p in space.variable if p.kind != "categorical"] if name == "cma-es" else []
        own_seed = int(generator(seed, f"search, {name}").integers(2**31))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            sampler: BaseSampler = optuna.samplers.TPESampler(seed=own_seed, multivariate=False, constant_liar=True)
            if name == "cma-es":
                if len(self._always) < 2:
                    raise RaceError(
                        f"method cma-es: expected at least two numeric or ordered parameters, found {len(self._always)}"
                    )
                sampler = optuna.samplers.CmaEsSampler(
                    seed=own_seed,
                    popsize=generation,
                    independent_sampler=sampler,
                    warn_independent_sampling=False,
                )
        self._study = optuna.create_study(sampler=sampler)
        self._has_costs = False
        self._n_worst = _MAX_WORST if name == "tpe" else 0
        self._threads = ThreadpoolController()

    def __call__(self, given: Configuration | None = None) -> Proposal:
        """The next proposal; the given configuration if there is one."""
        if given is not None:
            self._study.enqueue_trial(
                {
                    name: _internal(parameter, value, bounds)
                    for name, value in given.items()
                    if not (parameter := self._space[name]).is_fixed and (bounds := parameter.bounds(given))
                }
            )
        with self._threads.limit(limits=1, user_api="blas"):  # as in proposals.py: more threads would mostly wait
            trial = self._study.ask()
            for parameter in self._always:
                _suggest(trial, parameter)
            configuration = self._space.build(
                lambda parameter, bounds: _external(parameter, _suggest(trial, parameter), bounds)
            )
        return Proposal(configuration, partial(self._finish, trial))

    def _finish(self, trial: "Trial", cost: float | None) -> None:
        from optuna.trial import TrialState

        if cost is not None:
            self._has_costs = True
        elif self._has_costs and self._n_worst > 0:
            self._n_worst -= 1
            cost = math.inf
        self._study.tell(trial, cost, state=TrialState.FAIL if cost is None else TrialState.COMPLETE)


def _suggest(trial: "Trial", parameter: Parameter) -> Value:
    name = parameter.name
    if parameter.kind == "categorical":
        return trial.suggest_categorical(name, parameter.values)
    if parameter.kind == "ordered" or (parameter.kind == "integer" and not parameter.is_dependent):
        low, high = map(int, parameter.bounds({}) or (0, 0))
        return trial.suggest_int(name, low, high, log=parameter.log)
    return trial.suggest_float(name, 0.0, 1.0)


def _external(parameter: Parameter, suggested: Value, bounds: Bounds) -> Value:
    """The value for a suggestion."""
    if isinstance(suggested, float):
        return parameter.quantile(suggested, bounds)
    return parameter.values[int(suggested) - 1] if parameter.kind == "ordered" else suggested


def _internal(parameter: Parameter, value: Value, bounds: Bounds) -> Value:
    """The suggestion for a value."""
    if parameter.kind == "ordered":
        return 1 + parameter.values.index(str(value))
    if parameter.kind == "real" or parameter.is_dependent:
        return parameter.position(value, bounds)
    return value
