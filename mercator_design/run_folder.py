"""The folder that a race writes: what is in it, and in which order it appears.

mission.yaml      the mission as it was raced, every default and override filled in
provenance.json   versions, seed, budget, platform, fingerprint of the kernels
journal.jsonl     every experiment, a line each, as it finishes
results.csv       every configuration that was raced, the elites first
fsm.txt           the winner; it is written last, so a folder with it is complete
"""

import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from statistics import mean, stdev
from types import TracebackType
from typing import Any, Self

from mercator_design import __version__
from mercator_design.design import Design, Finished
from mercator_design.errors import RaceError
from mercator_design.files import write_text
from mercator_design.fsm.grammar import to_pfsm
from mercator_design.fsm.text import fsm_file_text, to_text
from mercator_design.jit import fingerprint, kernel_files
from mercator_design.loading import dump
from mercator_design.missions.mission import Mission

_LIBRARIES = ("numpy", "scipy", "numba", "pymunk", "joblib")


class RunFolder:
    """Writes the folder of one race; a context manager that closes the journal.

    Raises:
        RaceError: if the folder has files in it already, or cannot be written.
    """

    def __init__(self, path: Path, mission: Mission, *, budget: int, seed: int, request: Mapping[str, Any]) -> None:
        try:
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RaceError(f"{path}: expected a new or empty folder for the results, found files in it")
            self.path = path
            self._mission = mission
            self._provenance: dict[str, Any] = {
                "mercator_design": __version__,
                "request": dict(request),
                "mission": mission.name,
                "budget": budget,
                "seed": seed,
                "started": datetime.now(UTC).isoformat(timespec="seconds"),
                "kernels": fingerprint(kernel_files()),
                "python": sys.version.split()[0],
                "libraries": {name: version(name) for name in _LIBRARIES},
                "platform": platform.platform(),
                "machine": platform.machine(),
                "cores": os.cpu_count(),
            }
            write_text(path / "mission.yaml", dump(mission))
            self._write_provenance()
            self._journal = (path / "journal.jsonl").open("x", encoding="utf-8")
        except OSError as error:
            raise RaceError(f"{path}: cannot write results there: {error.strerror or error}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._journal.close()

    def note(self, finished: Sequence[Finished]) -> None:
        """Append experiments to the journal."""
        for experiment in finished:
            line = {name: getattr(experiment, name) for name in Finished.__slots__}
            self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()

    def finish(self, design: Design, **figures: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write what the race came to."""
        self._provenance |= {"finished": datetime.now(UTC).isoformat(timespec="seconds"), **figures}
        self._write_provenance()
        write_text(self.path / "results.csv", _results(design))
        header = {
            "mission": self._mission.name,
            "robot model": self._mission.robot_model,
            "score": f"{mean(design.scores):.6g} (mean of {len(design.scores)} experiments in the race)",
            "spread": f"{stdev(design.scores) if len(design.scores) > 1 else 0:.6g} (standard deviation)",
            "budget": str(self._provenance["budget"]),
            "seed": str(self._provenance["seed"]),
            "mercator_design": __version__,
            "kernels": self._provenance["kernels"][:16],
        }
        write_text(self.path / "fsm.txt", fsm_file_text(design.winner, header))

    def _write_provenance(self) -> None:
        write_text(self.path / "provenance.json", json.dumps(self._provenance, indent=2) + "\n")


def _results(design: Design) -> str:
    """The table of configurations as CSV: elites by rank, then the others by number."""
    import pandas as pd

    table = pd.DataFrame(
        {
            "configuration": [f.configuration for f in design.finished],
            "iteration": [f.iteration for f in design.finished],
            "score": [f.score for f in design.finished],
        }
    )
    results = table.groupby("configuration").agg(
        first_iteration=("iteration", "min"),
        experiments=("score", "size"),
        mean=("score", "mean"),
        standard_deviation=("score", "std"),
    )
    ranks = {elite.configuration: rank for rank, elite in enumerate(design.race.elites, start=1)}
    results.insert(0, "elite_rank", pd.Series(ranks, dtype="Int64").reindex(results.index))
    flavour = design.winner.flavour
    results["fsm"] = [to_text(to_pfsm(design.race.configurations[c], flavour)) for c in results.index]
    return str(results.sort_values(["elite_rank", "configuration"], na_position="last").to_csv())
