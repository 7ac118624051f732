"""Which parts of the winner of a finished race matter: a path of changes to it, measured step by step.

The statistics (race/analysis/ablation.py) do not depend on robots; this module applies them to a run folder.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.fsm.space.grammar import from_pfsm, to_pfsm
from mercator_design.modules.flavour import flavour_of
from mercator_design.race import Configuration, Experiment
from mercator_design.race.analysis.ablation import Flips, Step, ablate
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.race.session.task import Task
from mercator_design.race.space.parameter import key_of
from mercator_design.results.analysis.pruning import one_less, removed, without
from mercator_design.results.files import check_configurations, read_journal


@dataclass(frozen=True, slots=True, kw_only=True)
class Ablation:
    """A path of changes.

    task: The task of the race.
    start: A description of the first configuration.
    steps: The steps, see `race.analysis.ablation.ablate`.
    configurations: The configuration after each step.
    simplifies: Whether each step removes a part of a PFSM.
    """

    task: Task[Any]
    start: str
    steps: tuple[Step[Any], ...]
    configurations: tuple[Configuration, ...]
    simplifies: bool


def race_ablation(
    path: Path,
    task: Task[Any],
    executor: Executor,
    *,
    start: int | None,
    first: bool,
    runs: int,
    announce: Callable[[str], None],
    watch: Callable[[int, int], None],
    stopped: Callable[[], bool],
) -> Ablation:
    """Find the path to the winner of a race from another configuration, or from a winning PFSM to its initial state.

    Args:
        path: The path of the run folder.
        task: The task, from `results.files.restored`.
        executor: Runs experiments.
        start: The number of the first configuration.
        first: Whether to start with the best configuration of the first iteration.
        runs: Number of test instances to choose changes on, and of others to measure the path on.
        announce: Called with a message if there is something to compile.
        watch: Called with the numbers of measurements and experiments done.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        RaceError: There is no such race or configuration, or it has not ended.
        ExecutorStopped: see `stopped`; running experiments have finished.
    """
    task.need_one_cost("an ablation")
    record = read_journal(path).record
    if (number := record.view.winner) is None:
        raise RaceError(f"{path}: expected a race that has ended, found one that has no winner yet")
    check_configurations(path, record, task.optimizer.space)
    winner = record.configurations[number]
    if first:
        if not record.view.incumbents:
            raise RaceError(f"{path}: expected a race with iterations, found none in its journal")
        start = record.view.iterations[0].elites[0]
    if start is not None and start not in record.configurations:
        raise RaceError(f"{path}: expected a configuration that was raced, found {start}")
    if start is None and not (isinstance(task, Designer) and flavour_of(task.flavour).architecture == "pfsm"):
        raise RaceError(f"{path}: the winner is not a PFSM: give --from CONFIGURATION or --from-first")
    task.prepare(announce)
    if task.evaluate is not None:
        expected = "a targetRunner that prints costs, as a targetEvaluator compares configurations of a race"
        raise RaceError(f"{task.name}: expected {expected}, found a targetEvaluator: it cannot be ablated")
    changes: Callable[[Any], Mapping[Any, str]]
    configuration_of: Callable[[Any], Configuration]
    first_variant: Any
    if start is not None:
        flips = Flips(task.optimizer.space, winner)
        changes, configuration_of = flips.changes, flips.configuration
        first_variant = key_of(record.configurations[start])
    else:  # a variant is the set of the removed elements
        assert isinstance(task, Designer)  # noqa: S101 - checked above
        pfsm = to_pfsm(winner, task.flavour)
        changes, configuration_of = partial(one_less, pfsm), lambda out: from_pfsm(without(pfsm, out))
        first_variant = removed(pfsm, frozenset())
    numbers = count(10**9)  # above all numbers of configurations
    n_calls = n_done = 0

    def measure(several: Sequence[Any], instances: range) -> list[list[float]]:
        nonlocal n_calls, n_done
        items = [
            task.item(Experiment(number, instance), configuration, test=True)
            for configuration, number in zip(map(configuration_of, several), numbers, strict=False)
            for instance in instances
        ]
        found = in_order(executor, task.function, items, lambda done: watch(n_calls, n_done + done), stopped)
        n_calls, n_done = n_calls + 1, n_done + len(items)
        costs = [task.cost(one.score) for one in found]
        return [costs[k : k + len(instances)] for k in range(0, len(costs), len(instances))]

    steps = ablate(first_variant, changes, measure, runs)
    return Ablation(
        task=task,
        start="the winner" if start is None else f"configuration {start}",
        steps=tuple(steps),
        configurations=tuple(configuration_of(step.variant) for step in steps),
        simplifies=start is None,
    )
