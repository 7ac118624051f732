"""Copies a race into an Optuna storage while it runs, for optuna-dashboard and Optuna's other tools.

Each configuration is the trial of the same number; its score on an instance is the trial's intermediate value at that
step. A trial is running while its configuration may run again. Then it is completed with the mean of its scores if the
configuration survived an iteration, failed if an experiment failed, and pruned otherwise. The study's attribute
`winner` is the number of the winner. Its mean may not be the best: a configuration with fewer results may be lucky.

Optuna does not influence the race: a separate thread writes. It lags behind if the storage is slow, and stops at the
first error.
"""

import contextlib
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Self

from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.session.events import Event, ExperimentDone, IterationEnded, ScoreRevised
from mercator_design.race.session.view import RaceView
from mercator_design.race.space.parameter import Parameter

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import BaseStorage

MAX_WAIT = 120.0
"""Seconds to wait for the writer at the end of a race."""
MAX_WAIT_INTERRUPTED = 5.0
"""Seconds to wait for the writer when a race was interrupted."""


class OptunaMirror:
    """Writes a race into a study; a context manager.

    Args:
        storage: URL of an Optuna storage, such as sqlite:///race.db.
        name: Name of the study; an existing study of this name is continued.
        race: The race.
        view: The state of the race; it takes each event before `note`.
        maximise: Whether higher scores are better.
        warn: Called with a sentence when something goes wrong.
    """

    def __init__(
        self,
        storage: str,
        name: str,
        race: Optimizer,
        view: RaceView,
        *,
        maximise: bool,
        warn: Callable[[str], None],
    ) -> None:
        self._race = race
        self._view = view
        self._warn = warn
        self._running: set[int] = set()  # configurations that were copied, and may run again
        self._events: queue.SimpleQueue[Callable[[_Study], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, args=(storage, name, maximise), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._events.put(None)
        self._thread.join(MAX_WAIT if kind is None else MAX_WAIT_INTERRUPTED)
        if self._thread.is_alive():
            self._warn("the Optuna storage is slow: it does not have the whole race")

    def note(self, event: Event) -> None:
        """Copy an event; experiments come in any order, and some come twice."""
        match event:
            case ExperimentDone() | ScoreRevised():
                self._running.add(event.configuration)
                self._events.put(lambda study: study.report(event))
            case IterationEnded():
                done = self._running - self._race.may_run_again
                self._running -= done
                means = self._means(done)
                self._events.put(lambda study: study.close(done, means))

    def finish(self, winner: int) -> None:
        """Record the end of the race and its winner."""
        means = self._means(range(len(self._race.configurations)))
        self._events.put(lambda study: study.finish(winner, means))

    def _means(self, configurations: Iterable[int]) -> dict[int, float]:
        """The mean scores of those that have survived an iteration, or were an elite."""
        elites = {elite for ended in self._view.iterations for elite in ended.elites}
        survivors = elites.union(*(summary.survivors for summary in self._race.iterations))
        scores = {number: self._view.scores(number).values() for number in survivors.intersection(configurations)}
        return {number: sum(few) / len(few) for number, few in scores.items() if few}

    def _write(self, storage: str, name: str, maximise: bool) -> None:
        try:
            with _connected(storage) as database:
                study = _Study(database, name, self._race, maximise=maximise)
                while (event := self._events.get()) is not None:
                    event(study)
        except Exception as error:  # noqa: BLE001 - a mirror must never stop a race
            self._warn(f"the race is no longer copied to the Optuna storage: {type(error).__name__}: {error!s:.300}")


@contextlib.contextmanager
def _connected(url: str) -> "Iterator[BaseStorage]":
    """A storage whose connections are closed at the end: Python 3.13 warns of those that are left open."""
    from optuna.storages import RDBStorage

    database = RDBStorage(url)
    try:
        yield database
    finally:
        database.remove_session()
        database.engine.dispose()


class _Study:
    """The study, used only by the writing thread."""

    def __init__(self, storage: "BaseStorage", name: str, race: Optimizer, *, maximise: bool) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(
            storage=storage,
            study_name=name,
            direction="maximize" if maximise else "minimize",
            load_if_exists=True,
        )
        self._race = race
        self._id = study._study_id  # noqa: SLF001 - Optuna has no public way to it
        self._storage: BaseStorage = study._storage  # noqa: SLF001
        self._state = optuna.trial.TrialState
        self._create: Callable[..., Any] = optuna.trial.create_trial
        self._study = study
        self._open: dict[int, int] = {}  # configuration -> its trial, if it is running
        self._scores: dict[int, dict[int, float]] = {}  # configuration with a trial -> instance -> score
        self._n_checked = 0  # configurations below this number have a trial
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

    def report(self, one: ExperimentDone | ScoreRevised) -> None:
        if one.configuration not in self._scores:
            for number in range(self._n_checked, one.configuration + 1):
                if number not in self._scores:
                    self._add(number)
            self._n_checked = one.configuration + 1
        trial, scores = self._open.get(one.configuration), self._scores[one.configuration]
        is_known = one.instance in scores and isinstance(one, ExperimentDone)
        if trial is None or is_known:  # from before the race was resumed
            return
        if one.score is not None:
            scores[one.instance] = one.score
            self._storage.set_trial_intermediate_value(trial, one.instance, one.score)
        elif one.configuration not in self._failed:
            self._failed.add(one.configuration)
            self._storage.set_trial_user_attr(trial, "failure", one.failure)

    def close(self, configurations: Iterable[int], means: Mapping[int, float]) -> None:
        """End the trials of configurations that will not run again, with the mean scores of those that survived."""
        for number in sorted(self._open.keys() & set(configurations)):
            trial = self._open.pop(number)
            if number in self._failed:
                self._storage.set_trial_state_values(trial, self._state.FAIL)
            elif number in means:
                self._storage.set_trial_state_values(trial, self._state.COMPLETE, [means[number]])
            else:
                self._storage.set_trial_state_values(trial, self._state.PRUNED)

    def finish(self, winner: int, means: Mapping[int, float]) -> None:
        self.close(self._open.keys(), means)
        self._study.set_user_attr("winner", winner)

    def _add(self, number: int) -> None:
        """Make a trial for a configuration, in the order of their numbers, so that both have the same number."""
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
