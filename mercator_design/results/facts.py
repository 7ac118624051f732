"""The facts that the page of a race shows, read from its run folder; the race may be running or stopped."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from mercator_design.designer import Designer
from mercator_design.errors import MercatorError, RaceError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_names
from mercator_design.race.elimination.summary import Headline, Scores
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import OtherVersion, Record
from mercator_design.race.session.task import Task
from mercator_design.race.session.view import RaceView
from mercator_design.results.experiments.preview import MissionPreview, preview_of
from mercator_design.results.files import (
    JOURNAL,
    TASKS,
    check_configurations,
    check_same,
    read_journal,
    read_provenance,
    task_of,
)
from mercator_design.results.listing import run_of
from mercator_design.results.provenance import Provenance
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.architectures import decoded
from mercator_design.software.needed import PLUGINS

MAX_ELITES = 8
"""Maximum number of elites that are compared."""


@dataclass(frozen=True, kw_only=True)
class Facts:
    """The journal and the files of a run folder.

    named: The name of the folder in the commands on the page.
    record: The record in the journal.
    provenance: None if it is missing or damaged.
    task: None if this program cannot restore it.
    notes: Problems of the folder, for the user.
    """

    folder: Path
    named: Path
    record: Record
    provenance: Provenance | None
    task: Task[Any] | None
    state: str
    notes: tuple[str, ...]

    @classmethod
    def read(cls, folder: Path, *, task: Task[Any] | None = None, record: Record | None = None) -> Self:
        """Read a run folder.

        Args:
            folder: Its path.
            task: Its task, if this process has run the race.
            record: Its record, if this process has it.

        Raises:
            RaceError: There is no race, or its journal is corrupt.
        """
        reading = read_journal(folder) if record is None else Reading(folder / JOURNAL, record)
        if not reading.record.start:
            raise RaceError(f"{folder}: no race has begun here yet")
        record, run, notes, provenance = reading.record, run_of(folder, reading), [], None
        is_own = task is not None and record.is_complete
        try:
            provenance = read_provenance(folder)
            check_same(folder, record, provenance)
            task = task or task_of(folder)
        except OtherVersion:
            raise
        except MercatorError as error:
            notes = [*error.messages]
        if task is not None:
            check_configurations(folder, record, task.optimizer.space)
        else:
            notes += _checked(folder, record)
        return cls(
            folder=folder,
            named=folder,
            record=record,
            provenance=provenance,
            task=task,
            state="finished" if is_own else str(run["state"]),
            notes=tuple(dict.fromkeys([*run["notes"], *notes])),
        )

    @property
    def start(self) -> Mapping[str, Any]:
        return self.record.start

    @property
    def view(self) -> RaceView:
        """The state of the race."""
        return self.record.view

    @property
    def designer(self) -> Designer | None:
        """The task, if it designs control software."""
        return self.task if isinstance(self.task, Designer) else None

    @property
    def mission(self) -> Mission | None:
        return None if self.designer is None else self.designer.simulator.mission

    @property
    def robot_model(self) -> RobotModel | None:
        return None if self.designer is None else self.designer.simulator.robot_model

    @cached_property
    def preview(self) -> MissionPreview | None:
        """The mission with the start of the race's first instance; None if its robots find no place."""
        if self.designer is None:
            return None
        try:
            return preview_of(self.designer.simulator, seed=self.designer.seed(0))
        except MercatorError:
            return None

    @cached_property
    def best(self) -> int | None:
        """The winner, or the best configuration so far."""
        return self.view.leader

    @cached_property
    def elites(self) -> list[int]:
        """The winner, and the other elites of the last iteration."""
        last = self.view.iterations[-1].elites if self.view.incumbents else ()
        return list(dict.fromkeys([*([] if self.best is None else [self.best]), *last]))[:MAX_ELITES]

    @cached_property
    def former_elites(self) -> list[int]:
        """The elites of all iterations, the latest first."""
        return list(dict.fromkeys(number for one in reversed(self.view.iterations) for number in one.elites))

    @property
    def possible_scores(self) -> ScoreRange:
        """The range of the scores of the task."""
        return ANY_SCORE if self.provenance is None else self.provenance.possible_scores

    @cached_property
    def headline(self) -> Headline | None:
        """The score of the winner, or of the best so far."""
        return self.view.headline(self.possible_scores)

    def scores(self, configuration: int) -> Scores:
        """The scores of a configuration in the race."""
        return Scores(tuple(self.view.scores(configuration).values()), self.possible_scores)

    def software(self, configuration: int) -> Software | None:
        """The control software of a configuration, if control software was raced and its flavour is loaded."""
        if self.start["task"] != "mission" or self.start["flavour"] not in flavour_names():
            return None
        return decoded(self.record.configurations[configuration], self.start["flavour"])

    def pfsm(self, configuration: int) -> Pfsm | None:
        """The PFSM of a configuration, if PFSMs were raced."""
        software = self.software(configuration)
        return software if isinstance(software, Pfsm) else None

    @property
    def winner_file(self) -> str:
        """The name of the winner's file."""
        return TASKS[str(self.start["task"])].WINNER

    @property
    def parts(self) -> str:
        """The word for the parts of a configuration: modules or parameters."""
        is_of_pfsms = self.best is not None and self.pfsm(self.best) is not None
        return "modules" if is_of_pfsms else "parameters"

    @property
    def score_name(self) -> str:
        """The name of the axis of scores."""
        if self.mission is not None:
            return self.mission.score_name
        return "cost (lower is better)" if self.start["task"] == "scenario" else "score"

    def called(self, configuration: int) -> str:
        """The name of a configuration on the page."""
        is_winner = configuration == self.best and self.view.is_complete
        return f"{configuration} (winner)" if is_winner else str(configuration)

    def command(self, *verb: str, file: str = "", options: Sequence[str] = ()) -> str:
        """The command that runs a verb of mdesign on the folder or a file of it; by default the one for the page."""
        names = self.start.get("plugins", ()) if file else ()  # a run folder knows its own
        loaded = [word for name in names for word in ("--plugin", str(self.named / PLUGINS / name))]
        return shlex.join(["mdesign", *(verb or ["report"]), str(self.named / file), *options, *loaded])


def _checked(folder: Path, record: Record) -> tuple[str, ...]:
    """Check the configurations of a race without its task; returns why that cannot be done, if it cannot.

    Raises:
        RaceError: A configuration is not of the race's space.
    """
    task = TASKS[str(record.start["task"])]
    try:
        task.recall(folder, record.start)
    except MercatorError as error:
        return error.messages
    task.check(record.start, list(record.configurations.values()))
    return ()
