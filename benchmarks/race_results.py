"""Races of methods on problems, and their results in a file that several processes may share.

Methods are those of `mdesign race --method`, `default`, `NAME=VALUE`, which is the default with another value of its
option NAME, and `no-NAME`, with its option NAME at zero. `no-structure` has no simple configurations and no canonical
form, either; `no-moves` has both, and only lacks the moves in the structure: its neighbours change a few parameters.
METHOD@CODE has the results that the file has of another version of the code.
"""

import contextlib
import fcntl
import hashlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

import mercator_design
from mercator_design.errors import RaceError
from mercator_design.jit import kernels_digest
from mercator_design.race import Configuration, Halving, HalvingOptions, Space
from mercator_design.race.methods.table import METHODS
from mercator_design.race.proposals.moves import Moves
from mercator_design.race.space.encoding import Encoding
from mercator_design.race.space.space import Structure

Row = dict[str, Any]
NO_MOVES = "no-moves"
_CLAIMS_FROM = 2**40
"""Bytes from here on, behind the end of the file, stand for races: who has one locked runs that race."""


class Problem(Protocol):
    """What a race needs to know of a problem."""

    space: Space

    def start(self, seed: int) -> None:
        """Begin a race: its instances depend on its seed."""
        ...

    def cost(self, configuration: Configuration, instance: int) -> float:
        """The cost of one experiment."""
        ...

    def measure(self, configuration: Configuration) -> Row:
        """What is to be known of a winner."""
        ...


class Race(NamedTuple):
    """A race of the benchmark."""

    problem: str
    method: str  # with @CODE if it is known from another version
    budget: int
    seed: int

    @property
    def key(self) -> tuple[str, str, int, int, str]:
        """What its row in the file is found by; the last is the version of the code."""
        method, _, code = self.method.partition("@")
        return self.problem, method, self.budget, self.seed, code or fingerprint()


class Unmoved:
    """A structure without its moves: neighbours change a few parameters, as in a space without structure."""

    def __init__(self, structure: Structure, encoding: Encoding) -> None:
        self.canonical, self.simple = structure.canonical, structure.simple
        self._encoding = encoding

    def neighbour(self, configuration: Configuration, draws: np.random.Generator) -> Configuration:
        rows = self._encoding.rows([configuration])
        moved = self._encoding.settled(Moves(self._encoding, draws).mutated(rows, rows))
        return self.canonical(self._encoding.configuration(moved[0]))


def space_for(method: str, space: Space) -> Space:
    """The space that a method searches: for `no-moves` the same with another structure."""
    if method != NO_MOVES or space.structure is None:
        return space
    structure = Unmoved(space.structure, Encoding(space))
    return Space(space.parameters, forbidden=space.forbidden, notes=space.notes, structure=structure)


def options_of(method: str) -> HalvingOptions:
    """Those of `default`, `NAME=VALUE` or `no-NAME`."""
    default = HalvingOptions()
    if method in ("default", NO_MOVES):
        return default
    name, _, value = (f"{method[3:]}=0" if method.startswith("no-") else method).partition("=")
    try:
        return replace(default, **{name: type(getattr(default, name))(float(value))})
    except (AttributeError, ValueError, OverflowError, RaceError):
        known = f"default, NAME=VALUE or no-NAME of an option or {', '.join(METHODS)}"
        sys.exit(f"--methods: expected {known}, found {method}")


@cache
def fingerprint() -> str:
    """Of the source of races, of what they know of PFSMs, and of the simulator, which all decide results."""
    folder = Path(mercator_design.__file__).parent
    files = sorted(file for room in ("race", "modules", "fsm") for file in folder.glob(f"{room}/**/*.py"))
    digest = hashlib.sha256(kernels_digest().encode())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def run(problem: Problem, race: Race) -> Row:
    """One race to its end, and what its winner is worth; times are CPU seconds."""
    problem.start(race.seed)
    make = METHODS.get(race.method) or partial(Halving, options=options_of(race.method))
    evaluating, began = 0.0, time.process_time()
    optimizer = make(space_for(race.method, problem.space), budget=race.budget, seed=race.seed)
    while batch := optimizer.ask():
        started = time.process_time()
        costs = [problem.cost(optimizer.configurations[e.configuration], e.instance) for e in batch]
        evaluating += time.process_time() - started
        optimizer.tell(costs)
    overhead = time.process_time() - began - evaluating
    winner = optimizer.configurations[optimizer.best.configuration]
    return {
        **race._asdict(),
        "code": fingerprint(),
        **problem.measure(winner),
        "used": optimizer.used,
        "experiment": evaluating / optimizer.used,
        "overhead": overhead / optimizer.used,
    }


class ResultFile:
    """A line of JSON for each race; new ones are appended in one write. Without a path, rows are kept in memory only.

    A process claims a race before it runs it, by a lock of a byte that ends with the process.
    """

    def __init__(self, path: Path | None) -> None:
        self._file = None if path is None else os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        self._read = 0  # bytes
        self.rows: dict[tuple[str, str, int, int, str], Row] = {}
        self.refresh()

    def refresh(self) -> None:
        """Read what others have appended, but not an unfinished last line."""
        if self._file is None:
            return
        size = os.fstat(self._file).st_size
        text = os.pread(self._file, size - self._read, self._read)
        whole = text.rfind(b"\n") + 1
        self._read += whole
        for line in text[:whole].splitlines():
            with contextlib.suppress(json.JSONDecodeError):  # what was left of a write
                self._take(json.loads(line))

    def append(self, row: Row) -> None:
        self._take(row)
        if self._file is not None:
            size = os.fstat(self._file).st_size
            is_whole = size == 0 or os.pread(self._file, 1, size - 1) == b"\n"
            os.write(self._file, f"{'' if is_whole else chr(10)}{json.dumps(row)}\n".encode())

    def claims(self, race: Race) -> bool:
        """Whether this process is now the only one to run a race that has no result yet."""
        if self._file is not None:
            place = int.from_bytes(hashlib.blake2b(repr(race.key).encode(), digest_size=4).digest())
            try:
                fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _CLAIMS_FROM + place)
            except OSError:
                return False
            self.refresh()
        return race.key not in self.rows

    def _take(self, row: Row) -> None:
        self.rows[row["problem"], row["method"], row["budget"], row["seed"], row["code"]] = row


@cache
def result_file(path: Path | None) -> ResultFile:
    """Opened once: to close one of two openings would give up the claims of both."""
    return ResultFile(path)


def results(
    races: Sequence[Race], problem: Callable[[str], Problem], *, path: Path | None = None, jobs: int = 1
) -> list[Row]:
    """The rows of all races, in their order; those that the file does not have are run.

    A race that another process runs at the same time is left to it: its row is missing. Processes are forked, and keep
    the problems they have read.
    """
    file = result_file(path)
    file.refresh()
    missing = [race for race in races if race.key not in file.rows]
    if unknown := next((race for race in missing if "@" in race.method), None):
        sys.exit(f"{path}: expected a row of {' '.join(map(str, unknown))}, found none")
    one = partial(_claimed, problem=problem, path=path)
    if jobs == 1:
        _show(map(one, missing), len(missing))
    else:
        with multiprocessing.get_context("fork").Pool(jobs) as pool:
            for row in _show(pool.imap_unordered(one, missing), len(missing)):
                if path is None:
                    file.append(row)
        file.refresh()
    return [{**file.rows[race.key], "method": race.method} for race in races if race.key in file.rows]


def _claimed(race: Race, problem: Callable[[str], Problem], path: Path | None) -> Row | None:
    file = result_file(path)
    if not file.claims(race):
        return None
    row = run(problem(race.problem), race)
    file.append(row)
    return row


def _show(rows: Iterable[Row | None], n: int) -> list[Row]:
    """All rows that were made here; on a terminal, how many there are so far."""
    found = []
    for done, row in enumerate(rows, start=1):
        if row is not None:
            found.append(row)
        if sys.stderr.isatty():
            print(f"\r{done}/{n}", end="", file=sys.stderr)
    return found
