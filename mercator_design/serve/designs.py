"""Designs: FSMs that users saved under a name, with their missions, as files.

DATA/.service/designs/ID/    design.json, fsm.txt, mission.yaml
"""

import logging
import shutil
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, Literal

from mercator_design.config.schema import Length, Name, Range
from mercator_design.race.session.journal import now
from mercator_design.serve.jobs.operations import LimitReached
from mercator_design.serve.jobs.store import MISSION
from mercator_design.serve.records import Records, new_id
from mercator_design.serve.settings import ServiceError, UserLimits

_log = logging.getLogger(__name__)

FSM = "fsm.txt"


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The contents of a design's file."""

    format: Literal[1] = 1
    id: Annotated[str, Length(1, 120)]
    owner: str
    name: Name
    mission: str  # its name
    direction: str  # of the score: maximise or minimise
    scores: tuple[Annotated[float, Range(-1e100, 1e100)], ...] = ()  # on the first instances of `mdesign evaluate`
    created: str  # time
    shared: bool = False  # whether all users may see it

    @property
    def mean(self) -> float | None:
        """Mean score; None if unknown."""
        return fmean(self.scores) if self.scores else None


class Designs(Records[Design]):
    """The designs of a data folder; safe for several threads. One that cannot be read is left out, and logged.

    Raises:
        OSError: The folder cannot be used.
    """

    def __init__(self, folder: Path, limits: UserLimits) -> None:
        super().__init__(folder, Design, "design.json")
        self._limits = limits
        self._lock = threading.RLock()
        self._known: dict[str, Design] = {}
        for identity in self.ids():
            try:
                self._known[identity] = self.read(identity)
            except ServiceError as error:
                _log.error("%s", error)

    def get(self, identity: str) -> Design | None:
        return self._known.get(identity)

    def find(self, viewer: str | None, *, owner: str = "", text: str = "", shared: bool = False) -> list[Design]:
        """The designs that a user may see, the newest first.

        Args:
            viewer: Sees own designs and shared ones; None: an administrator, who sees all.
            owner: Only of this user.
            text: Only with this text in the name, or in that of the mission.
            shared: Only shared ones.
        """
        with self._lock:
            found = [one for one in self._known.values() if viewer is None or one.shared or one.owner == viewer]
        text = text.lower()
        return sorted(
            (
                one
                for one in found
                if (not owner or one.owner == owner)
                and (not shared or one.shared)
                and (text in one.name.lower() or text in one.mission.lower())
            ),
            key=lambda one: (one.created, one.id),
            reverse=True,
        )

    def create(self, design: Design, fsm: str, mission: str) -> Design:
        """Save a new design with the texts of its files; return it with its id and time.

        Raises:
            LimitReached: The user has too many.
            ServiceError: A value of it is not valid.
            OSError: It cannot be written.
        """
        with self._lock:
            self.check_number(design.owner)
            design = replace(design, id=new_id(design.name), created=now())
            self.add(design, {FSM: fsm, MISSION: mission})
            self._known[design.id] = design
            return design

    def check_number(self, owner: str) -> None:
        """Check that a user may save one more design.

        Raises:
            LimitReached: The user has too many.
        """
        n = len(self.find(None, owner=owner))
        if n >= self._limits.designs:
            raise LimitReached(f"expected at most {self._limits.designs} designs of {owner}, found {n}; delete some")

    def update(self, identity: str, **changes: Any) -> Design:  # noqa: ANN401 - the fields of Design
        """Change fields of a design.

        Raises:
            KeyError: There is none.
            ServiceError: A value is not valid; it is as before.
            OSError: It cannot be written; it is as before.
        """
        with self._lock:
            before = self._known[identity]
            self.write(replace(before, **changes))
            try:
                self._known[identity] = self.read(identity)
            except ServiceError:
                self.write(before)
                raise
            return self._known[identity]

    def delete(self, identity: str) -> None:
        """Delete a design.

        Raises:
            KeyError: There is none.
            OSError: It cannot be deleted.
        """
        with self._lock:
            self.file(identity).unlink(missing_ok=True)  # first: without it, there is no design
            shutil.rmtree(self.folder(identity), ignore_errors=True)
            del self._known[identity]
