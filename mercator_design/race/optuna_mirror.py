"""A copy of a race in an Optuna storage, as it goes on, for optuna-dashboard and for Optuna's own tools.

A configuration is a trial; its score on an instance is the trial's value at that step. A trial is pruned when its
configuration is no elite at the end of an iteration. The winner's alone is completed, with its mean, so that it is the
study's best. Optuna decides nothing here, and cannot stop the race: a thread of its own writes, behind the race if the
storage is slow, and gives up when something goes wrong.
"""

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mercator_design.race.asking import Asking
from mercator_design.race.events import Finished
from mercator_design.race.parameter import Configuration, Parameter

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
        self, storage: str, name: str, race: Asking, *, maximise: bool, complain: Callable[[str], None]
    ) -> None:
        self._race = race
        self._complain = complain
        self._raced: set[int] = set()  # in the iterations that have not ended yet
        self._ended = len(race.iterations)
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

    def note(self, finished: Sequence[Finished]) -> None:
        """Take in experiments that have finished, in any order, some of them perhaps for the second time."""
        self._note_iterations()
        for one in finished:
            self._raced.add(one.configuration)
            values = self._race.configurations[one.configuration]
            self._events.put(lambda study, one=one, values=values: study.report(one, values))  # type: ignore[misc]

    def finish(self, winner: int) -> None:
        """Take in that the race has ended, and who won."""
        self._note_iterations()
        self._events.put(lambda study: study.finish(winner))

    def _note_iterations(self) -> None:
        if len(self._race.iterations) > self._ended:
            self._ended = len(self._race.iterations)
            elites = {elite.configuration for elite in self._race.elites}
            losers, self._raced = self._raced - elites, self._raced & elites
            self._events.put(lambda study: study.prune(losers))

    def _write(self, storage: str, name: str, maximise: bool) -> None:
        try:
            study = _Study(storage, name, self._race, maximise=maximise)
            while (event := self._events.get()) is not None:
                event(study)
        except Exception as error:  # noqa: BLE001 - a mirror must never stop a race
            self._complain(f"no more of the race goes into the Optuna storage: {type(error).__name__}: {error!s:.300}")


class _Study:
    """The study, as the thread sees it that writes it."""

    def __init__(self, storage: str, name: str, race: Asking, *, maximise: bool) -> None:
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
        self._open: dict[int, int] = {}  # configuration -> its trial that is running
        self._scores: dict[int, dict[int, float]] = {}  # configuration -> instance -> score
        self._failed: set[int] = set()  # configurations that have a failed trial
        self._completed: set[tuple[int, int]] = set()  # winners, each with how many scores it had
        for trial in study.get_trials(deepcopy=False):
            configuration = trial.user_attrs.get("configuration")
            if configuration is None:
                continue
            self._scores.setdefault(configuration, {}).update(trial.intermediate_values)
            if trial.state is self._state.FAIL:
                self._failed.add(configuration)
            elif trial.state is self._state.COMPLETE:
                self._completed.add((configuration, len(trial.intermediate_values)))
            elif not trial.state.is_finished():
                self._open[configuration] = trial._trial_id  # noqa: SLF001 - as above

    def report(self, one: Finished, values: Configuration) -> None:
        scores = self._scores.setdefault(one.configuration, {})
        if one.instance in scores or (one.score is None and one.configuration in self._failed):
            return
        trial = self._trial(one.configuration, values)
        if one.score is None:
            self._storage.set_trial_user_attr(trial, "failure", one.failure)
            self._storage.set_trial_state_values(trial, self._state.FAIL)
            self._failed.add(one.configuration)
            del self._open[one.configuration]
        else:
            scores[one.instance] = one.score
            self._storage.set_trial_intermediate_value(trial, one.instance, one.score)

    def prune(self, configurations: set[int]) -> None:
        for configuration in sorted(configurations & self._open.keys()):
            self._storage.set_trial_state_values(self._open.pop(configuration), self._state.PRUNED)

    def finish(self, winner: int) -> None:
        self.prune(self._open.keys() - {winner})
        scores = list(self._scores[winner].values())
        if (winner, len(scores)) in self._completed:
            return
        trial = self._trial(winner, self._race.configurations[winner])
        self._storage.set_trial_state_values(trial, self._state.COMPLETE, [sum(scores) / len(scores)])

    def _trial(self, configuration: int, values: Configuration) -> int:
        """The running trial of a configuration: another one, if it was pruned and races once more."""
        if configuration not in self._open:
            template = self._create(
                state=self._state.RUNNING,
                params=dict(values),
                distributions={name: _distribution(self._race.space[name], values) for name in values},
                user_attrs={"configuration": configuration, "parent": self._race.parents[configuration]},
                intermediate_values=dict(self._scores[configuration]),
            )
            self._open[configuration] = self._storage.create_new_trial(self._id, template_trial=template)
        return self._open[configuration]


def _distribution(parameter: Parameter, values: Mapping[str, Any]) -> "BaseDistribution":
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    bounds = parameter.bounds(values)
    if not parameter.is_numeric or bounds is None:
        return CategoricalDistribution(parameter.values)
    low, high = bounds
    if parameter.kind == "integer":
        return IntDistribution(int(low), int(high), log=parameter.log)
    return FloatDistribution(low, high, log=parameter.log)
