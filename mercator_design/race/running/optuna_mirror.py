"""A copy of a race in an Optuna storage, as it goes on, for optuna-dashboard and for Optuna's own tools.

A configuration is one trial, with its number; its score on an instance is the trial's intermediate value at that step.
The trial runs as long as its configuration may run again. Then it is completed with the mean of its scores if the
configuration survived an iteration, failed if an experiment failed, else pruned. The study's attribute `winner` is the
number of the winner, whose mean need not be the best: others that ran less may have been lucky.

Optuna decides nothing here, and cannot stop the race: a thread of its own writes, behind the race if the storage is
slow, and gives up when something goes wrong.
"""

import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.running.events import Event, ExperimentDone, IterationEnded
from mercator_design.race.space.parameter import Parameter

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import BaseStorage

PATIENCE = 120.0
"""Seconds to wait at the end for what is not yet written ..."""
HURRY = 5.0
"""... and when the race was stopped."""


class OptunaMirror:
    """Writes a race into a study; a context manager.

    Args:
        storage: URL as Optuna takes it, such as sqlite:///race.db.
        name: Of the study; one of that name is continued.
        race: What is raced.
        maximise: Whether higher scores are better.
        complain: Called with a sentence when something goes wrong.
    """

    def __init__(
        self, storage: str, name: str, race: Optimizer, *, maximise: bool, complain: Callable[[str], None]
    ) -> None:
        self._race = race
        self._complain = complain
        self._raced: set[int] = set()  # so far: a storage may have more, from before the race was resumed
        self._events: queue.SimpleQueue[Callable[[_Study], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, args=(storage, name, maximise), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._events.put(None)
        self._thread.join(PATIENCE if kind is None else HURRY)
        if self._thread.is_alive():
            self._complain("the Optuna storage is slow: not all of the race is in it")

    def note(self, event: Event) -> None:
        """Take in what has happened in the race; experiments come in any order, and some for the second time."""
        match event:
            case ExperimentDone():
                self._raced.add(event.configuration)
                self._events.put(lambda study: study.report(event))
            case IterationEnded():
                survivors, done = self._survivors(), self._raced - self._race.returning
                self._events.put(lambda study: study.close(done, survivors))

    def finish(self, winner: int) -> None:
        """Take in that the race has ended, and who won."""
        self._events.put(lambda study: study.finish(winner, self._survivors()))

    def _survivors(self) -> set[int]:
        """Of all iterations, with the elites."""
        ended = self._race.iterations
        elites = {elite.configuration for summary in ended for elite in summary.elites}
        return elites.union(*(summary.survivors for summary in ended))

    def _write(self, storage: str, name: str, maximise: bool) -> None:
        try:
            study = _Study(storage, name, self._race, maximise=maximise)
            while (event := self._events.get()) is not None:
                event(study)
        except Exception as error:  # noqa: BLE001 - a mirror must never stop a race
            self._complain(f"no more of the race goes into the Optuna storage: {type(error).__name__}: {error!s:.300}")


class _Study:
    """The study, as the thread sees it that writes it."""

    def __init__(self, storage: str, name: str, race: Optimizer, *, maximise: bool) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(
            storage=storage,
            study_name=name,
            direction="maximize" if maximise else "minimize",
            load_if_exists=True,
        )
        self._race = race
        self._id = study._study_id  # noqa: SLF001 - Optuna's storages want it, and offer no other way to it
        self._storage: BaseStorage = study._storage  # noqa: SLF001
        self._state = optuna.trial.TrialState
        self._create: Callable[..., Any] = optuna.trial.create_trial
        self._study = study
        self._open: dict[int, int] = {}  # configuration -> its trial, if that is running
        self._scores: dict[int, dict[int, float]] = {}  # configuration with a trial -> instance -> score
        self._failed: set[int] = set()  # configurations with an experiment that failed
        for trial in study.get_trials(deepcopy=False):
            configuration = trial.user_attrs.get("configuration")
            if configuration is None:
                continue
            self._scores[configuration] = dict(trial.intermediate_values)
            if "failure" in trial.user_attrs:
                self._failed.add(configuration)
            if not trial.state.is_finished():
                self._open[configuration] = trial._trial_id  # noqa: SLF001 - as above

    def report(self, one: ExperimentDone) -> None:
        if one.configuration not in self._scores:
            for number in range(one.configuration + 1):
                if number not in self._scores:
                    self._add(number)
        trial, scores = self._open.get(one.configuration), self._scores[one.configuration]
        if trial is None or one.instance in scores:  # known, from before the race was resumed
            return
        if one.score is not None:
            scores[one.instance] = one.score
            self._storage.set_trial_intermediate_value(trial, one.instance, one.score)
        elif one.configuration not in self._failed:
            self._failed.add(one.configuration)
            self._storage.set_trial_user_attr(trial, "failure", one.failure)

    def close(self, configurations: Iterable[int], survivors: set[int]) -> None:
        """End the trials of configurations that do not run again."""
        for number in sorted(self._open.keys() & set(configurations)):
            trial, scores = self._open.pop(number), list(self._scores[number].values())
            if number in self._failed:
                self._storage.set_trial_state_values(trial, self._state.FAIL)
            elif number in survivors and scores:
                self._storage.set_trial_state_values(trial, self._state.COMPLETE, [sum(scores) / len(scores)])
            else:
                self._storage.set_trial_state_values(trial, self._state.PRUNED)

    def finish(self, winner: int, survivors: set[int]) -> None:
        self.close(self._open.keys(), survivors)
        self._study.set_user_attr("winner", winner)

    def _add(self, number: int) -> None:
        """A trial for a configuration: in the order of their numbers, so that these are the trials' own."""
        values = self._race.configurations[number]
        template = self._create(
            state=self._state.RUNNING,
            params=dict(values),
            distributions={name: _distribution(self._race.space[name], values) for name in values},
            user_attrs={"configuration": number, "parent": self._race.parents[number]},
        )
        self._open[number] = self._storage.create_new_trial(self._id, template_trial=template)
        self._scores[number] = {}


def _distribution(parameter: Parameter, values: Mapping[str, Any]) -> "BaseDistribution":
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    bounds = parameter.bounds(values)
    if not parameter.is_numeric or bounds is None:
        return CategoricalDistribution(parameter.values)
    low, high = bounds
    if parameter.kind == "integer":
        return IntDistribution(int(low), int(high), log=parameter.log)
    return FloatDistribution(low, high, log=parameter.log)
