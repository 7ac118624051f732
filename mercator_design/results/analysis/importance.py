"""Which parameters of a finished race, or modules of its PFSMs, explain its scores.

The statistics (race/analysis/importance.py) do not depend on robots; this module applies them to a run folder.
"""

from pathlib import Path
from typing import Any

from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.modules.flavour import flavour_of
from mercator_design.race import Space, integer
from mercator_design.race.analysis.importance import Explanation, explain, learnt_from
from mercator_design.race.session.record import Record
from mercator_design.race.session.task import Task
from mercator_design.results.analysis.pruning import max_modules, module_counts
from mercator_design.results.files import check_configurations, read_journal, task_of


def race_importance(path: Path, *, modules: bool | None = None, seed: int = 1) -> tuple[Task[Any], Explanation]:
    """Find how much parameters, or the numbers of modules in a PFSM, explain the scores of a race.

    Args:
        path: The path of the run folder.
        modules: Whether to explain scores by modules; by default if PFSMs were raced.
        seed: Seed of folds and shuffles.

    Raises:
        RaceError: There is no such race, or too little to learn from; see also `results.files.task_of`.
    """
    task, record = task_of(path), read_journal(path).record
    check_configurations(path, record, task.optimizer.space)
    if modules and not _has_modules(task):
        raise RaceError(f"{path}: expected a race of PFSMs, whose modules can be counted, found another")
    return task, importance_of(task, record, modules=modules, seed=seed)


def importance_of(task: Task[Any], record: Record, *, modules: bool | None = None, seed: int = 1) -> Explanation:
    """As `race_importance`, of a task and its record; `modules` may be True only if PFSMs were raced.

    Raises:
        RaceError: There is too little to learn from.
    """
    experiments = record.experiments
    failed = {experiments[number].configuration for number in experiments.numbers if experiments.score(number) is None}
    numbers = learnt_from(sorted({*experiments.configurations} - failed))
    configurations = [record.configurations[number] for number in numbers]
    own = ([experiments[place] for place in experiments.numbers_of(number)] for number in numbers)
    costs = [{one.instance: task.cost(one.score) for one in few if one.score is not None} for few in own]
    space = task.optimizer.space
    if isinstance(task, Designer) and _has_modules(task) and modules is not False:
        space = Space([integer(name, 0, number) for name, number in max_modules(task.flavour).items()])
        configurations = [dict(module_counts(to_pfsm(one, task.flavour))) for one in configurations]
    return explain(space, configurations, costs, seed=seed)


def _has_modules(task: Task[Any]) -> bool:
    """Whether PFSMs were raced, whose modules are counted."""
    return isinstance(task, Designer) and flavour_of(task.flavour).architecture == "pfsm"
