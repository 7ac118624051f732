"""The provenance of a run folder: start of the race, request, versions and machine."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mercator_design.config.json_data import read_json
from mercator_design.config.writing import plain
from mercator_design.errors import RaceError
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import Number
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.system.files import write_text

PROVENANCE = "provenance.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """The request of the user, in the terms of the command line."""

    mission: str | None = None
    scenario: str | None = None
    set: tuple[str, ...] | None = None
    flavour: str | None = None
    method: str
    executor: str | None = None
    jobs: Number | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """The contents of provenance.json; keys from `finished` on are those of a race that has ended."""

    race: Mapping[str, object]  # its start, as in its journal
    request: Request
    testing: Testing | None = None
    score_low: float | None = None  # the least possible score of its task; None if there is none
    score_high: float | None = None  # the largest
    maximise: bool = False  # whether a higher score is better
    started: str
    python: str
    libraries: Mapping[str, str]
    platform: str
    machine: str
    cores: Number | None = None
    finished: str | None = None
    budget: Number | None = None
    experiments: Number | None = None
    winner: Number | None = None
    journal: str | None = None  # digest of its journal
    seconds: float | None = None

    @property
    def possible_scores(self) -> ScoreRange:
        """The range of the scores of the task."""
        low, high = self.score_low, self.score_high
        return ScoreRange(
            low=ANY_SCORE.low if low is None else low,
            high=ANY_SCORE.high if high is None else high,
            maximise=self.maximise,
        )


def not_a_run_folder(folder: Path) -> RaceError:
    """The error for a folder without provenance."""
    return RaceError(f"{folder}: not a run folder: {PROVENANCE} is missing")


def read(folder: Path) -> Provenance:
    """Read the provenance of a run folder.

    Raises:
        RaceError: There is none, or it is not valid; with the key.
    """
    file = folder / PROVENANCE
    if not file.exists():
        raise not_a_run_folder(folder)
    provenance: Provenance = read_json(file, Provenance, error=RaceError)
    return provenance


def write(folder: Path, provenance: Provenance) -> None:
    """Write the provenance of a run folder, without keys that are None."""
    data = _given(plain(provenance)) | {"race": provenance.race}
    write_text(folder / PROVENANCE, json.dumps(data | {"request": _given(data["request"])}, indent=2) + "\n")


def _given(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if value is not None}
