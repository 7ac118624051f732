"""Analyses a finished race: which parameters or modules matter, and which parts its winner needs.

The statistics (race/analysis/) do not depend on robots; this module applies them to run folders and PFSMs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from mercator_design.analysis.pruning import Element, elements, max_modules, module_counts, removed, without
from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.space.grammar import from_pfsm, to_pfsm
from mercator_design.race import Configuration, Experiment, Space, integer
from mercator_design.race.analysis.ablation import Flips, Step, ablate
from mercator_design.race.analysis.importance import Explanation, explain
from mercator_design.race.running.executors import Executor, in_order
from mercator_design.race.running.task import Task
from mercator_design.runs.files import check_configurations, read_journal, task_of

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ablation:
    """A path of changes.

    start: what it begins with, in words.
    steps: see `race.ablation.ablate`.
    configurations: at each step.
    simplifies: whether each step leaves less of a PFSM.
    """

    task: Task[Any]
    start: str
    steps: tuple[Step[Any], ...]
    configurations: tuple[Configuration, ...]
    simplifies: bool


def importance(path: Path, *, modules: bool | None = None, seed: int = 1) -> tuple[Task[Any], Explanation]:
    """Which parameters of the configurations explain their scores in a race, or how often each module is in a PFSM.

    Args:
        path: Of the run folder.
        modules: Whether to ask for modules; by default if PFSMs were raced.
        seed: Of folds and shuffles.

    Raises:
        RaceError: There is no such race, or too little to learn from; see also `runs.files.task_of`.
    """
    task, record = task_of(path), read_journal(path).record
    check_configurations(path, record, task.race.space)
    numbers = sorted(record.configurations)
    configurations = [record.configurations[number] for number in numbers]
    costs: dict[int, dict[int, float]] = {number: {} for number in numbers}
    for one in record.experiments.values():
        costs[one.configuration][one.instance] = float("inf") if one.score is None else task.cost(one.score)
    space = task.race.space
    if modules is None:
        modules = isinstance(task, Designer)
    if modules:
        if not isinstance(task, Designer):
            raise RaceError(f"{path}: expected a race of PFSMs, whose modules can be counted, found another")
        most = max_modules(task.flavour)
        space = Space([integer(name, 0, number) for name, number in most.items()])
        configurations = [dict(module_counts(to_pfsm(one, task.flavour))) for one in configurations]
    return task, explain(space, configurations, [costs[number] for number in numbers], seed=seed)


def ablation(
    path: Path,
    task: Task[Any],
    executor: Executor,
    *,
    start: int | None = None,
    first: bool = False,
    runs: int,
    announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
    watch: Callable[[int, int], None] = lambda step, done: None,  # noqa: ARG005
    stopped: Callable[[], bool] = lambda: False,
) -> Ablation:
    """The path to the winner of a race from another configuration, or from a winning PFSM to its initial state alone.

    Args:
        path: The path of the run folder.
        task: The task, from `runs.files.restored`.
        executor: Runs experiments.
        start: The number of the configuration to begin with.
        first: Begin with the best of the first iteration.
        runs: Number of test instances to choose changes on, and of others to measure the path on.
        announce: Called with a message if there is something to compile.
        watch: Called with the numbers of measurements and experiments done.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        RaceError: There is no such race or configuration, or it has not ended.
        ExecutorStopped: see `stopped`; running experiments have finished.
    """
    record = read_journal(path).record
    if not record.ends:
        raise RaceError(f"{path}: expected a race that has ended, found one that has no winner yet")
    check_configurations(path, record, task.race.space)
    winner = record.configurations[record.ends[-1].winner]
    if first:
        if not record.iterations:
            raise RaceError(f"{path}: expected a race with iterations, found none in its journal")
        start = record.iterations[min(record.iterations)].elites[0]
    if start is not None and start not in record.configurations:
        raise RaceError(f"{path}: expected a configuration that was raced, found {start}")
    if start is None and not isinstance(task, Designer):
        raise RaceError(f"{path}: its winner is no PFSM to take apart: give --from CONFIGURATION or --from-first")
    task.prepare(announce)
    measured = _Measuring(task, executor, watch, stopped)
    if start is not None:
        flips = Flips(task.race.space, winner)
        key = task.race.space.key(record.configurations[start])
        path_of_keys = ablate(key, flips.changes, measured.of(flips.configuration), runs)
        return _ablation(task, f"configuration {start}", path_of_keys, flips.configuration, simplifies=False)
    assert isinstance(task, Designer)  # noqa: S101 - as was checked
    simpler = _Simpler(to_pfsm(winner, task.flavour))
    start_of = removed(simpler.pfsm, frozenset())
    steps = ablate(start_of, simpler.changes, measured.of(simpler.configuration), runs)
    return _ablation(task, "the winner", steps, simpler.configuration, simplifies=True)


class _Simpler:
    """A PFSM without some of its elements."""

    def __init__(self, pfsm: Pfsm) -> None:
        self.pfsm = pfsm

    def changes(self, out: frozenset[Element]) -> dict[frozenset[Element], str]:
        """As `ablate` wants them: one more element out, and what cannot be reached without it."""
        found: dict[frozenset[Element], str] = {}
        for element, words in elements(self.pfsm).items():
            if element not in out:
                found.setdefault(removed(self.pfsm, out | {element}), f"without {words}")
        return found

    def configuration(self, out: frozenset[Element]) -> Configuration:
        """The reduced PFSM as a configuration of the grammar."""
        return from_pfsm(without(self.pfsm, out))


def _ablation(
    task: Task[Any],
    start: str,
    steps: Sequence[Step[T]],
    configuration: Callable[[T], Configuration],
    *,
    simplifies: bool,
) -> Ablation:
    configurations = tuple(configuration(one.variant) for one in steps)
    return Ablation(task=task, start=start, steps=tuple(steps), configurations=configurations, simplifies=simplifies)


class _Measuring:
    """Measures configurations on test instances, all at once."""

    def __init__(
        self, task: Task[Any], executor: Executor, watch: Callable[[int, int], None], stopped: Callable[[], bool]
    ) -> None:
        if task.evaluate is not None:
            expected = "a targetRunner that gives the costs, as a targetEvaluator compares configurations of a race"
            raise RaceError(f"{task.name}: expected {expected}, found a targetEvaluator: it cannot be ablated")
        self._task = task
        self._executor = executor
        self._watch = watch
        self._stopped = stopped
        self._numbers = count(10**9)  # not the number of a configuration
        self._calls = 0
        self._done = 0

    def of(self, configuration: Callable[[T], Configuration]) -> Callable[[Sequence[T], range], list[list[float]]]:
        """The function that `ablate` measures with."""

        def measure(several: Sequence[T], instances: range) -> list[list[float]]:
            items = []
            for one in several:
                number, chosen = next(self._numbers), configuration(one)
                items += [self._task.item(Experiment(number, k), chosen, test=True) for k in instances]
            before = self._done

            def watch(done: int) -> None:
                self._done = before + done
                self._watch(self._calls, self._done)

            found = in_order(self._executor, self._task.function, items, watch, self._stopped)
            self._calls += 1
            costs = [self._task.cost(one.score) for one in found]
            return [costs[k : k + len(instances)] for k in range(0, len(costs), len(instances))]

        return measure
