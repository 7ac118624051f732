"""Designs: FSMs that users keep under a name, with the mission that they are for. Their files are the truth.

DATA/.service/designs/ID/    design.json, fsm.txt, mission.yaml
"""

import json
import logging
import shutil
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, Literal

from mercator_design.config.json_data import read_json
from mercator_design.config.schema import Length, Name, Range
from mercator_design.config.writing import plain
from mercator_design.race.running.journal import now
from mercator_design.serve.jobs.operations import LimitReached
from mercator_design.serve.jobs.store import MISSION, new_id
from mercator_design.serve.settings import Limits, ServiceError
from mercator_design.system.files import Unreadable, read_small, sync_folder, write_text

_log = logging.getLogger(__name__)

FSM = "fsm.txt"
_FILE = "design.json"
_MAX_SIZE = 1024 * 1024  # bytes of a file of a design


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
        """The mean score; None if it is not known."""
        return fmean(self.scores) if self.scores else None


class Designs:
    """The designs of a data folder; safe for several threads.

    Args:
        folder: Where they are; it is made if need be. A design that cannot be read is left out, and logged.
        limits: Of the service.

    Raises:
        OSError: The folder cannot be used.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._folder, self._limits = folder, limits
        self._lock = threading.RLock()
        self._known: dict[str, Design] = {}
        folder.mkdir(parents=True, exist_ok=True)
        for file in sorted(folder.glob(f"*/{_FILE}")):
            try:
                design = self._read(file)
            except ServiceError as error:
                _log.error("%s", error)
            else:
                self._known[design.id] = design

    def get(self, identity: str) -> Design | None:
        """A design."""
        return self._known.get(identity)

    def find(self, viewer: str | None, *, owner: str = "", text: str = "", shared: bool = False) -> list[Design]:
        """The designs that a user may see, the newest first.

        Args:
            viewer: Who sees own and shared ones; None: an administrator, who sees all.
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
        """Keep a new design; it gets an id and a time.

        Args:
            design: The facts.
            fsm: The text of its fsm.txt.
            mission: The text of its mission.yaml.

        Raises:
            LimitReached: The user has too many.
            OSError: It cannot be written.
        """
        with self._lock:
            self.check_number(design.owner)
            design = replace(design, id=new_id(design.name), created=now())
            folder = self._folder / design.id
            folder.mkdir()
            try:
                write_text(folder / FSM, fsm)
                write_text(folder / MISSION, mission)
                self._write(design)
                sync_folder(self._folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            self._known[design.id] = design
            return design

    def check_number(self, owner: str) -> None:
        """Check that a user may keep one more.

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
            OSError: It cannot be written; it is as before.
        """
        with self._lock:
            design = replace(self._known[identity], **changes)
            self._write(design)
            self._known[identity] = design
            return design

    def delete(self, identity: str) -> None:
        """Delete a design.

        Raises:
            KeyError: There is none.
            OSError: It cannot be deleted.
        """
        with self._lock:
            (self._folder / identity / _FILE).unlink(missing_ok=True)  # first: without it, there is no design
            shutil.rmtree(self._folder / identity, ignore_errors=True)
            del self._known[identity]

    def fsm(self, identity: str) -> str:
        """The text of its fsm.txt.

        Raises:
            ServiceError: It is missing.
        """
        return self._text(identity, FSM)

    def mission(self, identity: str) -> str:
        """The text of its mission.yaml.

        Raises:
            ServiceError: It is missing.
        """
        return self._text(identity, MISSION)

    def _text(self, identity: str, name: str) -> str:
        file = self._folder / identity / name
        try:
            return read_small(file, _MAX_SIZE).decode()
        except (Unreadable, UnicodeDecodeError) as error:
            raise ServiceError(f"{file}: {error}") from None

    def _read(self, file: Path) -> Design:
        design: Design = read_json(file, Design, error=ServiceError)
        if design.id != file.parent.name:
            raise ServiceError(f"{file}: id: expected {file.parent.name}, as its folder, found another")
        return design

    def _write(self, design: Design) -> None:
        write_text(self._folder / design.id / _FILE, json.dumps(plain(design), indent=1) + "\n")
