"""The folder that a race writes: what is in it, in which order it appears, and how a race goes on from it.

journal.jsonl      what has happened so far (see race/journal.py), written as it happens; it claims the folder
robot_model.yaml   the robot model as it was raced with
mission.yaml       the mission as it was raced, every default and override filled in
plugins/           the plugins it was raced with, if there were any
provenance.json    versions, seed, budget, platform, what makes the race
failed/            the control software of experiments that failed, if there were any
fsm.txt            the winner
results.csv        every configuration that was raced, the elites first

A run that came to its end has "finished" in its provenance, which is written anew after all else.
"""

import contextlib
import json
import os
import platform
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from mercator_design import __version__
from mercator_design.design import Design, Designer, Experimenter
from mercator_design.errors import RaceError, excerpt
from mercator_design.files import Unreadable, read_small, write_bytes, write_text
from mercator_design.fsm.grammar import to_pfsm
from mercator_design.fsm.text import fsm_file_text, read_fsm, to_text
from mercator_design.loading import dump
from mercator_design.missions.mission import load_mission
from mercator_design.missions.plugins import load_plugin, loaded_plugins, plugin_files
from mercator_design.race.executors import Executor, in_order
from mercator_design.race.journal import Finished, Journal, Record, read
from mercator_design.sim.simulate import Simulator

if TYPE_CHECKING:
    import pandas as pd

JOURNAL = "journal.jsonl"
_LIBRARIES = ("numpy", "scipy", "numba", "pymunk", "joblib")
_LARGEST_PROVENANCE = 1024 * 1024  # bytes


class RunFolder:
    """The folder of one race; a context manager that closes the journal.

    Attributes:
        path: Of the folder.
        designer: Of the race, which has not begun.
        journal: Of the race so far, which this process has to itself.
    """

    def __init__(self, path: Path, designer: Designer, journal: Journal, provenance: dict[str, Any]) -> None:
        self.path = path
        self.designer = designer
        self.journal = journal
        self._provenance = provenance

    @classmethod
    def create(cls, path: Path, designer: Designer, *, request: Mapping[str, Any]) -> Self:
        """A new one.

        Raises:
            RaceError: if the folder has files in it already, or cannot be written.
        """
        mission, start = designer.simulator.mission, designer.start()
        provenance: dict[str, Any] = {
            "race": start,
            "request": dict(request),
            "started": _now(),
            "python": sys.version.split()[0],
            "libraries": {name: version(name) for name in _LIBRARIES},
            "platform": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
        }
        with _naming(path):
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RaceError(f"{path}: expected a new or empty folder for the results, found files in it")
            # Claims the folder: of two races that got here at once, one fails, and writes nothing.
            journal = Journal(path / JOURNAL, new=True)
        folder = cls(path, designer, journal, provenance)
        try:
            with _naming(path):
                write_text(path / "robot_model.yaml", dump(designer.simulator.robot_model))
                write_text(path / "mission.yaml", dump(replace(mission, robot_model="robot_model.yaml")))
                for file in plugin_files():
                    (path / "plugins").mkdir(exist_ok=True)
                    write_bytes(path / "plugins" / file.name, file.read_bytes())
                folder._write_provenance()
            journal.begin(start)
            journal.sync()
        except BaseException:
            folder.__exit__(None, None, None)
            raise
        return folder

    @classmethod
    def reopen(cls, path: Path) -> Self:
        """That of a race which has begun.

        Raises:
            RaceError: if there is none, if it is not the race that this program would run, if another process runs it,
                or if its journal is corrupt.
            MissionError: if its mission, robot model or plugins cannot be read.
        """
        provenance = read_provenance(path)
        start = provenance["race"]
        designer = _designer(path, start)
        with _naming(path):
            journal = Journal(path / JOURNAL, new=False)
        folder = cls(path, designer, journal, provenance)
        try:
            if not journal.start:
                journal.begin(start)
            _check_start(path, journal, start)
        except BaseException:
            folder.__exit__(None, None, None)
            raise
        return folder

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.journal.__exit__(kind, error, traceback)

    def extend(self, budget: int) -> None:
        """Let the race go on to a larger budget when it has ended under the one it has.

        Raises:
            RaceError: if the budget is smaller than that.
        """
        if budget < self.journal.budget:
            raise RaceError(
                f"{self.path}: expected a budget of {self.journal.budget}, as before, or more, found {budget}"
            )
        if budget > self.journal.budget:
            self.journal.note([{"event": "extend", "budget": budget}])

    def keep_failed(self, finished: Finished) -> str:
        """Write the control software of an experiment that failed; gives the command that runs it alone.

        Raises:
            RaceError: if it cannot be written.
        """
        file = self.path / "failed" / f"{finished.configuration}.txt"
        with _naming(self.path):
            file.parent.mkdir(exist_ok=True)
            header = {**self._header(), "configuration": str(finished.configuration)}
            write_text(file, fsm_file_text(self.designer.pfsm(finished.configuration), header))
        mission = shlex.quote(str(self.path / "mission.yaml"))
        plugins = "".join(
            f" --plugin {shlex.quote(str(self.path / 'plugins' / name))}"
            for name in self._provenance["race"]["plugins"]
        )
        return f"mdesign evaluate {shlex.quote(str(file))} --mission {mission}{plugins} --instance {finished.seed}"

    def finish(self, design: Design, **figures: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write what the race came to: the winner first, that it is not lost where there is no room for all.

        Raises:
            RaceError: if it cannot be written.
        """
        scores, race = design.scores, self.designer.race
        header = self._header() | {
            "score": f"{scores.mean:.6g} (mean of {len(scores.values)} experiments in the race)",
            "spread": f"{scores.standard_deviation or 0.0:.6g} (standard deviation)",
            "budget": str(race.budget),
            "journal": self.journal.ends[-1].digest[:16],
        }
        with _naming(self.path):
            write_text(self.path / "fsm.txt", fsm_file_text(design.winner, header))
            results = _by_configuration(self.journal)
            ranks = {elite.configuration: rank for rank, elite in enumerate(race.elites, start=1)}
            results.insert(0, "elite_rank", results.index.map(ranks.get).astype("Int64"))
            in_order = results.sort_values(["elite_rank", "configuration"], na_position="last")
            write_text(self.path / "results.csv", in_order.to_csv())
            self._provenance |= {
                "finished": _now(),
                "budget": race.budget,
                "experiments": race.used,
                "winner": design.configuration,
                "journal": self.journal.ends[-1].digest,
                **figures,
            }
            self._write_provenance()

    def _header(self) -> dict[str, str]:
        """What a controller's file says of where it comes from."""
        simulator, start = self.designer.simulator, self._provenance["race"]
        header = {
            "mission": simulator.mission.name,
            "set": json.dumps(self._provenance["request"]["set"]),
            "mission digest": simulator.mission.digest,
            "robot model": simulator.robot_model.name,
            "seed": str(start["seed"]),
            "mercator_design": __version__,
            "kernels": start["kernels"][:16],
        }
        if plugins := start["plugins"]:
            header["plugins"] = ", ".join(f"{name} {digest}" for name, digest in plugins.items())
        return header

    def _write_provenance(self) -> None:
        write_text(self.path / "provenance.json", json.dumps(self._provenance, indent=2) + "\n")


def _check_start(path: Path, journal: Journal, start: Mapping[str, Any]) -> None:
    if {key: journal.start.get(key) for key in start} != start:
        raise RaceError(f"{path}: expected {JOURNAL} to be of the race in provenance.json, found another race")


def verify(
    path: Path,
    number: int,
    executor: Executor,
    announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
) -> list[str]:
    """Check a run folder, and run a sample of its experiments again; gives what was checked, in sentences.

    Args:
        path: The folder.
        number: Experiments to run again, evenly spread over the race.
        executor: Runs them.
        announce: Called with a sentence if there is something to compile.

    Raises:
        RaceError: if something is not as it was, or this program is not the one that ran the race.
        MissionError: as `RunFolder.reopen`.
    """
    reading = read(path / JOURNAL)
    record = reading.record
    designer = _designer(path, read_provenance(path)["race"])
    checked = [
        f"{JOURNAL}: {reading.lines} lines are whole" + (f"; {reading.torn}, as if torn" if reading.torn else "")
    ]
    for place, end in enumerate(record.ends, start=1):
        if record.digest(place) != end.digest:
            found = f"expected {end.digest}, found {record.digest(place)}"
            raise RaceError(f"{path / JOURNAL}: digest of the first {end.experiments} experiments: {found}")
        checked.append(f"{JOURNAL}: digest of the first {end.experiments} experiments is {end.digest[:16]}")
    if record.is_complete:
        winner = to_pfsm(record.configurations[record.ends[-1].winner], designer.flavour)
        if read_fsm(path / "fsm.txt").pfsm != winner:
            raise RaceError(f"{path / 'fsm.txt'}: expected configuration {record.ends[-1].winner}, found another")
        checked.append(f"fsm.txt: is configuration {record.ends[-1].winner}, the winner")
    finished = [one for _, one in sorted(record.experiments.items()) if one.score is not None]
    n = min(number, len(finished))
    sample = [finished[k * len(finished) // n] for k in range(n)]
    designer.simulator.rehearse(announce=announce)
    items = [(to_pfsm(record.configurations[one.configuration], designer.flavour), one.seed) for one in sample]
    for one, (score, outcome) in zip(sample, in_order(executor, Experimenter(designer.simulator), items), strict=True):
        if (score, outcome) != (one.score, one.outcome):
            raise RaceError(
                f"{path}: experiment {one.experiment}: expected score {one.score!r} and digest {one.outcome}, found "
                f"{score!r} and {outcome}: figures may differ in their last digits on another kind of machine"
            )
    return [*checked, f"{n} of {len(finished)} experiments were run again: all as they were"]


def _designer(path: Path, start: Mapping[str, Any]) -> Designer:
    """The designer of a race that has begun.

    Raises:
        RaceError: if it is not the race that this program would run.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    loaded = loaded_plugins()
    for name, digest in start["plugins"].items():
        if loaded.get(name) != digest:
            load_plugin(path / "plugins" / name)
    simulator = Simulator(load_mission(path / "mission.yaml"))
    designer = Designer(
        simulator, budget=start["budget"], seed=start["seed"], flavour=start["flavour"], method=start["method"]
    )
    here = json.loads(json.dumps(designer.start()))
    for key in here:
        if key != "mercator_design" and here[key] != start.get(key):  # another version may do all the same
            raise RaceError(
                f"{path}: {key}: raced with {excerpt(str(start.get(key)))} by mercator_design "
                f"{start['mercator_design']}, found {excerpt(str(here[key]))} in mercator_design {__version__}: "
                "the race cannot be continued or verified by this"
            )
    return designer


def read_provenance(path: Path) -> dict[str, Any]:
    """What a run folder says of where it comes from.

    Raises:
        RaceError: if it is none.
    """
    file = path / "provenance.json"
    try:
        provenance = json.loads(read_small(file, _LARGEST_PROVENANCE))
        race = provenance["race"]
        _ = (
            race["plugins"].items(),
            race["budget"],
            race["seed"],
            race["flavour"],
            race["method"],
            race["mercator_design"],
            race["mission"],
        )
        _ = provenance["request"]["set"]
    except Unreadable as error:
        raise RaceError(f"{path}: expected the folder of a race, found that {file.name}: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise RaceError(f"{file}: expected what mdesign race writes, found something else") from None
    found: dict[str, Any] = provenance
    return found


def experiments_table(path: Path) -> "pd.DataFrame":
    """The experiments of a run folder so far, a row each in order of their numbers.

    Columns: experiment, iteration, configuration, instance, seed, score (NaN if it failed), failure (why, or empty).

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    return _experiments(read(path / JOURNAL).record)


def configurations_table(path: Path) -> "pd.DataFrame":
    """The configurations of a run folder that were raced so far, a row each, by number.

    Columns: first_iteration, experiments, failed (how many of these), mean, standard_deviation (of the scores), parent
    (the elite it was sampled from), fsm.

    Raises:
        RaceError: if there is no journal, or it is corrupt.
    """
    return _by_configuration(read(path / JOURNAL).record)


def _experiments(record: Record) -> "pd.DataFrame":
    import pandas as pd

    finished = [record.experiments[number] for number in sorted(record.experiments)]
    names = ("experiment", "iteration", "configuration", "instance", "seed", "score", "failure")
    table = pd.DataFrame({name: [getattr(one, name) for one in finished] for name in names})
    return table.astype({"score": float})


def _by_configuration(record: Record) -> "pd.DataFrame":
    table = _experiments(record)
    results = table.groupby("configuration").agg(
        first_iteration=("iteration", "min"),
        experiments=("score", "size"),
        failed=("score", lambda scores: int(scores.isna().sum())),
        mean=("score", "mean"),
        standard_deviation=("score", "std"),
    )
    flavour = record.start["flavour"]
    results["parent"] = [record.parents[number] for number in results.index]
    results["parent"] = results["parent"].astype("Int64")
    results["fsm"] = [to_text(to_pfsm(record.configurations[number], flavour)) for number in results.index]
    return results


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RaceError(f"{path}: cannot write results there: {error.strerror or error}") from None


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
