"""irace's scenario.txt as a value; race/irace/scenario_options.py has its options.

Paths in the file are relative to the file; paths on the command line are relative to the current folder.
"""

import math
import os
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from mercator_design.config.yaml_tree import is_text
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.elimination.statistics import TestName
from mercator_design.race.irace.configurations import read_configurations, to_text
from mercator_design.race.irace.parameters import parse_space
from mercator_design.race.irace.scenario_options import EXPECTED, OPTIONS, TESTS, in_names_of_irace, unknown
from mercator_design.race.irace.scenario_text import Assignment, Setting, read_assignments, read_text
from mercator_design.race.irace.target_runner import REQUIRED, Target
from mercator_design.race.space.parameter import Configuration
from mercator_design.race.space.r_operators import MAX_INTEGER, number, number_text
from mercator_design.race.space.space import Space

_MAX_JOBS = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """The contents of a scenario.txt and of the files that it names.

    path: The file.
    name: The name in reports.
    space: The parameters as a space.
    parameters: The text of the file of parameters.
    instances: The instances, as target runners get them.
    test_instances: The instances of tests after the race; may be empty.
    test_elites: Number of elites to test.
    test_iterations: Whether to test elites of each iteration, too.
    initial: The first configurations.
    target: The target runner.
    jobs: Number of experiments that run at the same time.
    budget: Maximum number of experiments.
    seed: Seed of all random draws; 1 if the file has none.
    options: The options of the race.
    settings: All values that the file sets, by irace's names, with absolute paths.
    notes: Notes for the user.
    """

    path: Path
    name: str
    space: Space
    parameters: str
    instances: tuple[str, ...]
    test_instances: tuple[str, ...]
    test_elites: int
    test_iterations: bool
    initial: tuple[Configuration, ...]
    target: Target
    jobs: int
    budget: int
    seed: int
    options: RaceOptions
    settings: Mapping[str, Setting]
    notes: tuple[str, ...]


def read_scenario(path: Path, given: Sequence[Assignment] = (), *, name: str | None = None) -> Scenario:
    """Read a scenario.

    Args:
        path: The file.
        given: Assignments that replace those of the file.
        name: The name of the scenario; by default that of the file or its folder.

    Raises:
        RaceError: with file and line, what was expected and what was found.
    """
    return _ScenarioReader(path, given).scenario(name)


class _ScenarioReader:
    def __init__(self, path: Path, given: Sequence[Assignment]) -> None:
        self.path = path
        assigned = [*read_assignments(read_text(path), str(path)), *given]
        self.found: dict[str, Assignment] = {}
        self.notes: list[str] = []
        for one in assigned:
            if one.name not in OPTIONS:
                raise RaceError(f"{one.place}: {unknown(one.name)}")
            self.found[one.name] = one
        for one in self.found.values():
            option = OPTIONS[one.name]
            if self.value(one.name) == self.read(one.name, option.default):
                continue
            if option.refused:
                raise self.wrong(one.name, "its default", f"{excerpt(repr(one.value))}: {option.refused}")
            if option.ignored:
                self.notes.append(f"{one.place}: {one.name} has no effect: {option.ignored}")

    def scenario(self, name: str | None) -> Scenario:
        parameters = self.file("parameterFile")
        text = read_text(parameters, f"{self.place('parameterFile')}: parameterFile")
        space = parse_space(text, str(parameters))
        try:
            to_text(space, [{one.name: value} for one in space.parameters for value in one.values])
        except RaceError as error:
            raise RaceError(f"{parameters}: {error}") from None
        self.notes += space.notes
        instances = self.instances("instances", "trainInstances")
        if not instances:
            raise RaceError(
                f"{self.path}: expected instances: trainInstancesDir, trainInstancesFile or instances, found none"
            )
        options = self.options(len(instances))
        if len(instances) % options.block_size:
            expected = f"the number of instances ({len(instances)}) to be a multiple of it"
            raise self.wrong("blockSize", expected, options.block_size)
        initial: list[Configuration] = []
        if self.value("configurationsFile"):
            initial, notes = read_configurations(self.file("configurationsFile"), space)
            self.notes += notes
        folder = self.path.resolve().parent
        return Scenario(
            path=self.path,
            name=name or (folder.name if self.path.stem == "scenario" and folder.name else self.path.stem),
            space=space,
            parameters=text,
            instances=instances,
            test_instances=self.instances("testInstances", "testInstances"),
            test_elites=self.count("testNbElites"),
            test_iterations=bool(self.value("testIterationElites")),
            initial=tuple(initial),
            target=self.target(),
            jobs=self.jobs(),
            budget=self.budget(space, options),
            seed=1 if self.value("seed") is None else self.count("seed"),
            options=options,
            settings={one: self.value(one) for one in self.found if not OPTIONS[one].ignored},
            notes=tuple(self.notes),
        )

    def place(self, name: str) -> str:
        return self.found[name].place if name in self.found else str(self.path)

    def wrong(self, name: str, expected: str, found: object) -> RaceError:
        return RaceError(f"{self.place(name)}: {name}: expected {expected}, found {found}")

    def value(self, name: str) -> Setting:
        """The value of an option, or else its default; a path is absolute."""
        if name not in self.found:
            return self.read(name, OPTIONS[name].default)
        return self.read(name, self.found[name].value)

    def read(self, name: str, given: Setting) -> Setting:
        option = OPTIONS[name]
        if option.kind == "object":
            return None if given in ("", ()) else given
        value = given[0] if isinstance(given, tuple) and len(given) == 1 else given
        if value is None or (value == "" and option.kind != "text"):
            value = option.default
        if value is None:
            return None
        if name == "batchmode" and value in ("", 0):
            return "0"
        figure = _figure(value)
        valid = isinstance(value, str)
        if option.kind in {"flag", "count", "part", "share"}:
            largest, is_whole = MAX_INTEGER if option.kind == "count" else 1, option.kind in {"flag", "count"}
            valid = figure is not None and 0 <= figure <= largest and not (is_whole and figure != int(figure))
        if not valid:
            raise self.wrong(name, EXPECTED[option.kind], excerpt(repr(given)))
        match option.kind:
            case "path":
                return os.path.normpath(self.path.resolve().parent / os.path.expanduser(str(value)))  # noqa: PTH111 - without a home, Path raises
            case "flag":
                return bool(figure)
            case "count":
                return int(figure or 0)
            case "part":
                return figure
            case "share":
                return bool(figure) if figure in (0, 1) else figure
        return value

    def count(self, name: str) -> int:
        value = self.value(name)
        return int(value) if isinstance(value, (int, float)) else 0

    def file(self, name: str) -> Path:
        return Path(str(self.value(name)))

    def options(self, n_instances: int) -> RaceOptions:
        """The options of the race."""
        usual, changes = RaceOptions(), dict[str, object]()
        for name in self.found:
            option, value = OPTIONS[name], self.value(name)
            if option.ours:
                changes[option.ours] = None if value == option.default == 0 else value
        if self.value("deterministic"):
            changes["instances"] = n_instances
        if not isinstance(share := self.value("postselection"), bool) and self.value("elitist"):
            kept = f"{share} of the budget is kept for the race among the best of all iterations"
            self.notes.append(
                f"{self.place('postselection')}: postselection: {kept}, as in irace 3; irace 4 takes it for 0"
            )
        if "eachTest" in self.found and "firstTest" not in self.found and (each := self.count("eachTest")):
            changes["first_test"] = first = math.ceil(usual.first_test / each) * each
            if first != usual.first_test:
                self.notes.append(f"{self.place('eachTest')}: eachTest: firstTest is {first}, a multiple of it")
        if "testType" in self.found:
            test = str(self.value("testType")).lower()
            changes["test"] = TESTS.get(test, test)
            if changes["test"] not in get_args(TestName):
                raise self.wrong("testType", " or ".join(filter(None, TESTS)), excerpt(test))
        try:
            return replace(usual, **changes)  # type: ignore[arg-type]
        except RaceError as error:
            message = in_names_of_irace(error)
            raise RaceError(f"{self.place(message.partition(':')[0])}: {message}") from None

    def jobs(self) -> int:
        jobs = self.count("parallel")
        if jobs > _MAX_JOBS:
            raise self.wrong("parallel", f"0 to {_MAX_JOBS}", jobs)
        return max(jobs, 1)

    def budget(self, space: Space, options: RaceOptions) -> int:
        budget = self.count("maxExperiments")
        if self.value("minExperiments") is not None:
            budget = max(budget, self.count("minExperiments"), options.minimum_budget(max(space.n_variable, 1)))
        if not budget:
            raise RaceError(f"{self.path}: expected a budget, maxExperiments = N, found none")
        return budget

    def instances(self, name: str, files: str) -> tuple[str, ...]:
        """The training or test instances; they can be arguments of programs."""
        instances = self.listed(name, files)
        for one in instances:
            if "\0" in one or not is_text(one):
                raise RaceError(f"{self.path}: {name}: expected text without NUL bytes, found {one!r}")
        return instances

    def listed(self, name: str, files: str) -> tuple[str, ...]:
        """The instances of the scenario's file, of another file, or all files of a folder."""
        given = self.value(name)
        if given is not None:
            return tuple(self.instance(name, one) for one in (given if isinstance(given, tuple) else (given,)))
        folder = self.value(f"{files}Dir")
        if self.value(f"{files}File") is not None:
            file = self.existing(f"{files}File")
            lines = [line for whole in read_text(file).splitlines() if (line := whole.partition("#")[0].strip())]
            if not lines:
                raise RaceError(f"{file}: expected an instance a line, found none")
            return tuple(line if folder is None else f"{_one_word(str(folder))}/{line}" for line in lines)
        if folder is None:
            return ()
        within = Path(str(folder))
        if not within.is_dir():
            raise self.wrong(f"{files}Dir", "a folder", f"none at {folder}")
        found = sorted(
            str(one)
            for one in within.rglob("*")
            if one.is_file() and not any(part.startswith(".") for part in one.relative_to(within).parts)
        )
        if not found:
            raise self.wrong(f"{files}Dir", f"files in {folder}", "none")
        return tuple(map(_one_word, found))

    def instance(self, name: str, given: object) -> str:
        if isinstance(given, str):
            return given
        if isinstance(given, bool) or not isinstance(given, (int, float)):
            raise self.wrong(name, EXPECTED["object"], excerpt(repr(given)))
        return number_text(given)

    def target(self) -> Target:
        cmdline = str(self.value("targetCmdline"))
        for word in REQUIRED:
            if f"{{{word}}}" not in cmdline:
                raise self.wrong("targetCmdline", f"{{{word}}} in it", repr(cmdline))
        folder = self.file("execDir")
        if not folder.is_dir():
            raise self.wrong("execDir", "a folder", f"none at {folder}")
        launcher = self.program("targetRunnerLauncher")
        runner = self.program("targetRunner") if launcher is None else self.existing("targetRunner")
        if runner is None:
            raise self.wrong("targetRunner", "a program", "none")
        return Target(
            runner=runner,
            launcher=launcher,
            cmdline=cmdline,
            evaluator=self.program("targetEvaluator"),
            folder=folder,
            timeout=self.count("targetRunnerTimeout"),
            retries=self.count("targetRunnerRetries"),
        )

    def on_path(self, name: str) -> Path | None:
        """The command of this name, as a shell finds it; a file has precedence, except for a launcher, as in irace."""
        given = self.found[name].value if name in self.found else None
        if not isinstance(given, str) or "/" in given or given.startswith((".", "~")):
            return None
        if name != "targetRunnerLauncher" and self.file(name).exists():
            return None
        found = shutil.which(given)
        return None if found is None else Path(found).absolute()

    def program(self, name: str) -> Path | None:
        """The program that an option names; None if it names none."""
        if self.value(name) is None:
            return None
        file = self.on_path(name) or self.existing(name)
        if not os.access(file, os.X_OK):
            raise RaceError(f"{self.place(name)}: {name}: {file} is not executable; run chmod +x")
        return file

    def existing(self, name: str) -> Path:
        """The file that an option names."""
        file = self.file(name)
        if not file.is_file():
            raise self.wrong(name, "a file", f"{'a folder' if file.is_dir() else 'none'} at {file}")
        return file


def _one_word(path: str) -> str:
    """A path as one argument of a program, in quotes if need be: instances may have several arguments."""
    try:
        is_one = shlex.split(path) == [path]
    except ValueError:  # a quote
        is_one = False
    return path if is_one else shlex.quote(path)


def _figure(value: Setting) -> float | None:
    if isinstance(value, (bool, int, float)):
        return None if math.isnan(value) else value
    try:
        return number(value) if isinstance(value, str) else None
    except ValueError:
        return None
