"""The winners of several races for one mission, to be measured on the same instances."""

from collections.abc import Sequence
from pathlib import Path

from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.modules.architecture import Software
from mercator_design.results.files import check_configurations, read_journal, task_of
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import decoded

_MISSION = ("mission_digest", "robot_model_digest")
"""The keys of a start that are equal in races for the same mission and robots."""


def winners(folders: Sequence[Path]) -> tuple[dict[str, Software], Simulator]:
    """The winner of each race by the name of its run folder, and the simulator of their mission.

    Raises:
        RaceError: A race has not ended or is not of a mission, or they are of different missions or robot models.
        MissionError: The mission, robot model or plugins cannot be read.
    """
    first: Designer | None = None
    found: dict[str, Software] = {}
    for folder in folders:
        record = read_journal(folder).record
        if (winner := record.view.winner) is None:
            raise RaceError(f"{folder}: expected a race that has ended, found one that has no winner yet")
        task = task_of(folder)
        if not isinstance(task, Designer):
            raise RaceError(f"{folder}: expected the race of a mission, found that of a {record.start['task']}")
        first = first or task
        here, there = ([of.start()[key] for key in _MISSION] for of in (task, first))
        if here != there:
            raise RaceError(
                f"{folder}: expected the mission and robot model of {folders[0]}, as their winners run on the same "
                "instances, found others"
            )
        check_configurations(folder, record, task.optimizer.space)
        found[str(folder)] = decoded(record.configurations[winner], task.flavour)
    if first is None:
        raise RaceError("expected races, found none")
    return found, first.simulator


def elites(folder: Path, most: int) -> tuple[dict[int, Software], Simulator]:
    """The elites of a race's last iteration by their numbers, the winner or best first, and the simulator.

    Args:
        folder: The run folder; its race may be running or interrupted.
        most: How many.

    Raises:
        RaceError: The race has no elites yet, or is not of a mission.
        MissionError: The mission, robot model or plugins cannot be read.
    """
    record = read_journal(folder).record
    task = task_of(folder)
    if not isinstance(task, Designer):
        raise RaceError(f"{folder}: expected the race of a mission, found that of a {record.start['task']}")
    check_configurations(folder, record, task.optimizer.space)
    view = record.view
    last = view.iterations[-1].elites if view.incumbents else ()
    numbers = list(dict.fromkeys([*([] if view.leader is None else [view.leader]), *last]))[:most]
    if not numbers:
        raise RaceError(f"{folder}: expected a race with elites, found one whose first iteration has not ended")
    return {number: decoded(record.configurations[number], task.flavour) for number in numbers}, task.simulator
