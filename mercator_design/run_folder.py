"""The folder that a race writes: what is in it, and in which order it appears.

journal.jsonl      every experiment, a line each, written as it finishes; it claims the folder
robot_model.yaml   the robot model as it was raced with
mission.yaml       the mission as it was raced, every default and override filled in
provenance.json    versions, seed, budget, platform, fingerprint of the kernels
fsm.txt            the winner
results.csv        every configuration that was raced, the elites first

A run that came to its end has "finished" in its provenance, which is written anew after all else.
"""

import contextlib
import errno
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mercator_design import __version__
from mercator_design.design import Design, Designer, Finished
from mercator_design.errors import RaceError
from mercator_design.files import write_text
from mercator_design.fsm.text import fsm_file_text, to_text
from mercator_design.jit import kernels_digest
from mercator_design.loading import dump
from mercator_design.missions.plugins import loaded_plugins

_LIBRARIES = ("numpy", "scipy", "numba", "pymunk", "joblib")


class RunFolder:
    """Writes the folder of one race; a context manager that closes the journal.

    Raises:
        RaceError: if the folder has files in it already, or cannot be written.
    """

    def __init__(self, path: Path, designer: Designer, *, request: Mapping[str, Any]) -> None:
        self.path = path
        self._designer = designer
        mission, robot_model = designer.simulator.mission, designer.simulator.robot_model
        self._provenance: dict[str, Any] = {
            "mercator_design": __version__,
            "request": dict(request),
            "mission": mission.name,
            "budget": designer.race.budget,
            "seed": designer.race.seed,
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "plugins": loaded_plugins(),
            "kernels": kernels_digest(),
            "python": sys.version.split()[0],
            "libraries": {name: version(name) for name in _LIBRARIES},
            "platform": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
        }
        with self._naming_the_folder():
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RaceError(f"{path}: expected a new or empty folder for the results, found files in it")
            # Claims the folder: of two races that got here at once, one fails, and writes nothing.
            self._journal = (path / "journal.jsonl").open("xb", buffering=0)
        self._length = 0  # of the journal [bytes]
        with self._naming_the_folder():
            write_text(path / "robot_model.yaml", dump(robot_model))
            write_text(path / "mission.yaml", dump(replace(mission, robot_model="robot_model.yaml")))
            self._write_provenance()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._journal.close()

    def note(self, finished: Sequence[Finished]) -> None:
        """Append experiments to the journal, whole or not at all.

        Raises:
            RaceError: if it cannot be written.
        """
        lines = [{name: getattr(one, name) for name in Finished.__slots__} for one in finished]
        text = "".join(json.dumps(line) + "\n" for line in lines).encode()
        with self._naming_the_folder():
            try:
                if self._journal.write(text) != len(text):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # noqa: TRY301 - as if write() had
            except OSError:
                self._journal.truncate(self._length)
                raise
        self._length += len(text)

    def finish(self, design: Design, **figures: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write what the race came to: the winner first, that it is not lost where there is no room for all.

        Raises:
            RaceError: if it cannot be written.
        """
        simulator, scores = self._designer.simulator, design.scores
        header = {
            "mission": simulator.mission.name,
            "set": json.dumps(self._provenance["request"]["set"]),
            "mission digest": simulator.mission.digest,
            "robot model": simulator.robot_model.name,
            "score": f"{scores.mean:.6g} (mean of {len(scores.values)} experiments in the race)",
            "spread": f"{scores.standard_deviation or 0.0:.6g} (standard deviation)",
            "budget": str(self._provenance["budget"]),
            "seed": str(self._provenance["seed"]),
            "mercator_design": __version__,
            "kernels": self._provenance["kernels"][:16],
        }
        if plugins := self._provenance["plugins"]:
            header["plugins"] = ", ".join(f"{name} {digest}" for name, digest in plugins.items())
        with self._naming_the_folder():
            write_text(self.path / "fsm.txt", fsm_file_text(design.winner, header))
            write_text(self.path / "results.csv", _results(self._designer, design))
            self._provenance |= {"finished": datetime.now(UTC).isoformat(timespec="seconds"), **figures}
            self._write_provenance()

    @contextlib.contextmanager
    def _naming_the_folder(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RaceError(f"{self.path}: cannot write results there: {error.strerror or error}") from None

    def _write_provenance(self) -> None:
        write_text(self.path / "provenance.json", json.dumps(self._provenance, indent=2) + "\n")


def _results(designer: Designer, design: Design) -> str:
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
    ranks = {elite.configuration: rank for rank, elite in enumerate(designer.race.elites, start=1)}
    results.insert(0, "elite_rank", pd.Series(ranks, dtype="Int64").reindex(results.index))
    results["fsm"] = [to_text(designer.pfsm(configuration)) for configuration in results.index]
    return str(results.sort_values(["elite_rank", "configuration"], na_position="last").to_csv())
