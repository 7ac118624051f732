"""The file of a study: methods x missions x robot models x budgets x repetitions, and how designs are assessed.

This module defines the keys of the file and checks what one sees without reading the files that it names;
`resolving.py` does the rest.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from mercator_design.config import shipped
from mercator_design.config.building import is_name
from mercator_design.config.loading import parse, read
from mercator_design.config.schema import FieldError, FilePath, Length, Name, OneOf, Range, check
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import RaceError, StudyError
from mercator_design.mission_sampler import MissionClass
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS, options_of
from mercator_design.studies.layout import alike_on_disk

NamedFile = Annotated[str, FilePath(unless_name=True)]
Option = int | float | bool | str | None
Seed = Annotated[int, Range(0, 2**31 - 1)]


def _files_or_race(
    method: str | None, options: Mapping[str, Option] | None, files: tuple[str, ...] | None
) -> Iterator[FieldError]:
    if files is None:
        name = method or DEFAULT_METHOD
        try:
            options_of(name, options or {})
        except RaceError as error:
            yield from (FieldError("options", what) for what in error.messages)
        return
    for key, value in (("method", method), ("options", options)):
        if value is not None:
            yield FieldError(key, "expected nothing beside files, whose control software is made already")
    if len(set(files)) < len(files):
        yield FieldError("files", "expected each file once, found one twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyMethod:
    """A method of a study: races by a method with a flavour, or files of control software that exist."""

    CHECKS: ClassVar = (_files_or_race,)

    method: Annotated[str, OneOf(tuple(METHODS))] | None = None  # method of the races; by default halving
    flavour: NamedFile | None = None  # modules to design with, a name or a file; by default watermelon, or the files'
    options: Mapping[str, Option] | None = None  # options of the method, by name
    files: Annotated[tuple[Annotated[str, FilePath()], ...], Length(1, 1000)] | None = None  # hand-made: each a design

    def __post_init__(self) -> None:
        check(self)

    @property
    def race(self) -> str:
        """The method of its races."""
        return self.method or DEFAULT_METHOD

    @property
    def race_flavour(self) -> str:
        """The flavour of its races, by name or file."""
        return self.flavour or DEFAULT_FLAVOUR


def _mission_or_sample(
    mission: str | None, sample: str | None, seeds: tuple[int, ...] | None, name: str | None
) -> Iterator[FieldError]:
    if (mission is None) == (sample is None):
        yield FieldError("mission" if mission else "sample", "expected either mission or sample")
    if sample is None and seeds is not None:
        yield FieldError("seeds", "expected nothing, as seeds are of sampled missions")
    if sample is not None and not seeds:
        yield FieldError("seeds", "expected the seeds of the sampled missions, one for each, found none")
    if sample is not None and name is not None:
        yield FieldError("name", "expected nothing, as each sampled mission has a name")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyMission:
    """A mission of a study with overrides or another name, or missions that are sampled."""

    CHECKS: ClassVar = (_mission_or_sample,)

    mission: NamedFile | None = None  # name of a shipped mission, or a file
    set: tuple[str, ...] = ()  # overrides of keys, as duration=60
    name: Name | None = None  # in the study; by default the mission's
    sample: MissionClass | None = None  # class of random missions
    seeds: Annotated[tuple[Seed, ...], Length(1, 1000)] | None = None  # a random mission for each

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledRealities:
    """Pseudo-realities that are sampled around the design model: instance k of a design has number k mod `sample`."""

    sample: Annotated[int, Range(1, 10_000)]  # number of robot models
    width: Annotated[float, Range(0.0, 10.0, exclusive_low=True)]  # of the ranges: 1 reaches as far as those by hand
    seed: Seed = 1  # of the samples
    name: Name | None = None  # in the study; by default sampled-WIDTH

    @property
    def label(self) -> str:
        """Its name in the study."""
        return self.name or f"sampled-{self.width:g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessing:
    """How each design is assessed: on the same fresh instances, in the design model and in others."""

    runs: Annotated[int, Range(2, 10**6)] = 100  # instances
    realities: tuple[NamedFile | SampledRealities, ...] = ()  # robot models, or samples, besides the design model


def _methods_named(methods: Mapping[str, StudyMethod]) -> Iterator[FieldError]:
    if not methods:
        yield FieldError("methods", "expected at least one method, found none")
    if wrong := alike_on_disk(methods):
        yield FieldError("methods", wrong)


def _repetitions_of_races(repetitions: int | None, methods: Mapping[str, StudyMethod]) -> Iterator[FieldError]:
    if repetitions is None and any(method.files is None for method in methods.values()):
        yield FieldError("repetitions", "missing key; expected the number of designs of each method that races")


def _budgets_of_races(budgets: tuple[int, ...], methods: Mapping[str, StudyMethod]) -> Iterator[FieldError]:
    if not budgets and any(method.files is None for method in methods.values()):
        yield FieldError("budgets", "missing key; expected the budgets of the races, as [500]")


def _once(budgets: tuple[int, ...], robot_models: tuple[str, ...], plugins: tuple[str, ...]) -> Iterator[FieldError]:
    for key, values in (("budgets", budgets), ("robot_models", robot_models), ("plugins", plugins)):
        if len(set(values)) < len(values):
            yield FieldError(key, "expected each value once, found one twice")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan(FromFile):
    """The contents of a study's file."""

    KIND: ClassVar = "study"
    CHECKS: ClassVar = (_methods_named, _repetitions_of_races, _budgets_of_races, _once)

    schema: Literal[1] = 1  # version of this format
    name: Name  # by default the file's
    description: str = ""  # what the study is for
    plugins: tuple[NamedFile, ...] = ()  # files, folders of packages, or names of installed ones; run before all else
    seed: Annotated[int, Range(0, 2**31 - 10**6)] = 1  # repetition r has race seed `seed` + r - 1 in every method
    budgets: tuple[Annotated[int, Range(1, 10**9)], ...] = ()  # experiments of a race at most
    repetitions: Annotated[int, Range(1, 10_000)] | None = None  # designs of each method on each mission
    methods: Mapping[Name, StudyMethod]  # what is compared, by name
    missions: Annotated[tuple[NamedFile | StudyMission, ...], Length(1, 1000)]  # what is designed for
    robot_models: tuple[NamedFile, ...] = ()  # design models; by default each mission's own
    assess: Assessing = Assessing()

    def __post_init__(self) -> None:
        check(self)

    @property
    def n_designs(self) -> int:
        """The number of designs, of which none is made for it: a plan may ask for any number."""
        raced = len(self.budgets) * (self.repetitions or 0)
        of_mission = sum(raced if one.files is None else len(one.files) for one in self.methods.values())
        entries = sum(len(one.seeds or (None,)) for one in self.mission_entries)
        return of_mission * entries * max(1, len(self.robot_models))

    @property
    def mission_entries(self) -> tuple[StudyMission, ...]:
        """The missions, also those that are given by their names or files alone."""
        return tuple(one if isinstance(one, StudyMission) else StudyMission(mission=one) for one in self.missions)

    @property
    def files(self) -> Mapping[str, str]:
        """The files of missions and of control software, by the paths of their keys."""
        missions = {f"missions[{index}]": one.mission for index, one in enumerate(self.mission_entries)}
        made = {
            f"methods.{name}.files[{index}]": file
            for name, method in self.methods.items()
            for index, file in enumerate(method.files or ())
        }
        return {key: file for key, file in missions.items() if file is not None and not is_name(file)} | made

    @property
    def other_files(self) -> list[str]:
        """The files of plugins, flavours and robot models."""
        flavours = (method.race_flavour for method in self.methods.values())
        named = (*self.plugins, *self.robot_models, *self.assess.realities, *flavours)
        return [one for one in named if isinstance(one, str) and not is_name(one)]

    def seen_from(self, folder: Path, copies: Mapping[str, Path] = MappingProxyType({})) -> "StudyPlan":
        """This plan with paths that start from a folder, and those of copies instead of their originals."""
        start = folder.resolve()

        def moved(given: Any) -> Any:  # noqa: ANN401 - names and paths, and what has them
            if isinstance(given, tuple):
                return tuple(map(moved, given))
            if isinstance(given, StudyMission):
                return replace(given, mission=moved(given.mission))
            if isinstance(given, StudyMethod):
                return replace(given, flavour=moved(given.flavour), files=moved(given.files))
            if not isinstance(given, str) or is_name(given):
                return given
            return os.path.relpath(copies[given].resolve() if given in copies else given, start)

        return replace(
            self,
            plugins=moved(self.plugins),
            missions=moved(self.missions),
            robot_models=moved(self.robot_models),
            assess=replace(self.assess, realities=moved(self.assess.realities)),
            methods={name: moved(method) for name, method in self.methods.items()},
        )


def plan_of(given: "StudyPlan | Mapping[str, Any] | str | Path") -> StudyPlan:
    """The plan that is given: as it is, by its file, or as the contents of one; relative paths start from here.

    Raises:
        StudyError: naming the key of each mistake.
    """
    if isinstance(given, StudyPlan):
        return given
    if isinstance(given, str | Path):
        return load_plan(given)
    found: Any = parse(
        json.dumps(given), StudyPlan, error=StudyError, label="study", lines=False, defaults={"name": "study"}
    )
    plan: StudyPlan = found
    return plan


def load_plan(name_or_path: str | Path, overrides: Sequence[str] = ()) -> StudyPlan:
    """The plan of a study by path, or a shipped one by its name, perhaps with other values of keys.

    Raises:
        StudyError: naming file, line and key of each mistake.
        MissionError: There is no shipped study of that name.
    """
    path = shipped.find(name_or_path, shipped.studies(), "study")
    defaults = {"name": path.resolve().stem}
    given: Any = read(path, StudyPlan, error=StudyError, overrides=overrides, defaults=defaults)
    found: StudyPlan = given
    return found
