"""Reads what a plan names (missions, robot models, flavours, control software), and finds all mistakes at once.

Its plugins are run first, as all else may be of them.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mercator_design.config.writing import digest_of, plain
from mercator_design.designer import Designer
from mercator_design.errors import FsmError, MercatorError, StudyError
from mercator_design.jit import kernels_digest
from mercator_design.mission_sampler import sample_mission
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of, load_flavour
from mercator_design.plugins.loading import load_plugin, loaded_plugins
from mercator_design.scores import ScoreRange
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import text_of
from mercator_design.software.files import read_fsm, read_header
from mercator_design.studies.layout import Cell, MissionRow, ObjectiveRow, StudyLayout, alike_on_disk
from mercator_design.studies.plan import SampledRealities, StudyMethod, StudyMission, StudyPlan
from mercator_design.studies.sampling import sampled_reality
from mercator_design.studies.table import DESIGN_MODEL

T = TypeVar("T")
Realities = Callable[[RobotModel], list[RobotModel]]
"""Makes the robot models of a reality, given that of the design."""
_RENAME = "give one a name of its own"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudiedMission:
    """A mission with the robot model that is designed for, and the realities that designs are assessed in.

    realities: The simulators of each, by name; instance k is run by that with number k mod their number.
    """

    name: str
    simulator: Simulator
    realities: Mapping[str, tuple[Simulator, ...]]

    @property
    def facts(self) -> MissionRow:
        """What tables say of it."""
        mission = self.simulator.mission
        return MissionRow(
            name=self.name,
            robot_model=self.simulator.robot_model.name,
            **_range_data(mission.possible_scores()),
            objectives=tuple(
                ObjectiveRow(name=name, **_range_data(possible))
                for name, possible in mission.compared_by().items()
                if name
            ),
        )


def _range_data(possible: ScoreRange) -> dict[str, Any]:
    low, high = (limit if math.isfinite(limit) else None for limit in (possible.low, possible.high))
    return {"maximise": possible.maximise, "low": low, "high": high}


@dataclass(frozen=True, slots=True, kw_only=True)
class StudiedMethod:
    """A method: races with a flavour, or control software that exists.

    made: The control software; empty if the method races.
    """

    given: StudyMethod
    flavour: str
    made: tuple[Software, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A plan with all that it names.

    missions: By label: the name, and the robot model if it is not the mission's own.
    methods: By name.
    """

    plan: StudyPlan
    missions: Mapping[str, StudiedMission]
    methods: Mapping[str, StudiedMethod]

    @property
    def layout(self) -> StudyLayout:
        """Its cells by names."""
        realities = next(iter(self.missions.values())).realities
        return StudyLayout(
            missions={label: mission.facts for label, mission in self.missions.items()},
            methods={name: len(method.made) or None for name, method in self.methods.items()},
            flavours={name: method.flavour for name, method in self.methods.items()},
            budgets=self.plan.budgets,
            repetitions=self.plan.repetitions or 0,
            realities=tuple(realities),
            seed=self.plan.seed,
            runs=self.plan.assess.runs,
        )

    def designer(self, cell: Cell) -> Designer:
        """The task of a cell's race.

        Raises:
            MercatorError: as `Designer`.
        """
        method = self.methods[cell.method]
        return Designer(
            self.missions[cell.mission].simulator,
            budget=cell.budget,
            seed=self.layout.race_seed(cell),
            flavour=method.flavour,
            method=method.given.race,
            options=method.given.options,
        )

    @property
    def definition(self) -> dict[str, Any]:
        """All that results depend on, as plain data: maps by names, which may grow, of values, which may not change."""
        named = {model.name: plain(model) for model in map(load_robot_model, _named(self.plan))}
        sampled = {one.label: plain(one) | {"name": one.label} for one in _sampled(self.plan)}
        return {
            "missions": {label: _mission_data(mission.simulator) for label, mission in self.missions.items()},
            "methods": {name: _method_data(method) for name, method in self.methods.items()},
            "realities": named | sampled,
        }

    @property
    def program(self) -> dict[str, Any]:
        """The simulator and plugins, as plain data: all cells of a folder have the same."""
        return {"kernels": kernels_digest(), "plugins": loaded_plugins()}


def resolve(plan: StudyPlan) -> Study:
    """Read what a plan names, after running its plugins.

    Raises:
        StudyError: with the place of each mistake.
    """
    wrong = _Wrong()
    for index, name in enumerate(plan.plugins):
        wrong.attempt(plan.where(f"plugins[{index}]"), load_plugin, name)
    if wrong:
        raise StudyError(*wrong)
    missions = _missions(plan, wrong)
    models: list[RobotModel | None] = [
        wrong.attempt(plan.where(f"robot_models[{index}]"), load_robot_model, name)
        for index, name in enumerate(plan.robot_models)
    ]
    realities = _realities(plan, wrong)
    tried = {name: wrong.attempt(plan.where(f"methods.{name}"), _method, given) for name, given in plan.methods.items()}
    methods = {name: method for name, method in tried.items() if method is not None}
    studied: dict[str, StudiedMission] = {}
    for where, mission_name, mission in missions:
        for model in models or [None]:
            if (found := wrong.attempt(where, _studied, mission_name, mission, model, realities)) is not None:
                if (label := _label(found)) in studied:
                    wrong.append(f"{where}: expected robot models of different names, found {label} twice")
                studied[label] = found
    if what := alike_on_disk(studied):
        wrong.append(f"{plan.where('robot_models')}: {what}")
    for label, one in studied.items():
        for name, method in methods.items():
            wrong.attempt(f"{plan.where(f'methods.{name}')}: on {label}", _check_senses, method, one)
    if wrong:
        raise StudyError(*wrong)
    study = Study(plan=plan, missions=studied, methods=methods)
    for cell in study.layout.cells:
        if cell.repetition == 1 and cell.budget:
            wrong.attempt(f"{plan.where(f'methods.{cell.method}')}: on {cell.mission}", study.designer, cell)
    if wrong:
        raise StudyError(*wrong)
    return study


class _Wrong(list[str]):
    """Mistakes, each with its place."""

    def attempt(self, where: str, make: Callable[..., T], *given: object) -> T | None:
        """What is made; None if that is not possible, with the mistakes noted."""
        try:
            return make(*given)
        except MercatorError as error:
            self.extend(each for message in error.messages if (each := f"{where}: {message}") not in self)
            return None


def _missions(plan: StudyPlan, wrong: _Wrong) -> list[tuple[str, str, Mission]]:
    """The missions of a plan, with their places and names."""
    found: list[tuple[str, str, Mission]] = []
    for index, entry in enumerate(plan.mission_entries):
        where = plan.where(f"missions[{index}]")
        for mission in wrong.attempt(where, _of_entry, entry) or ():
            name = entry.name or mission.name
            others = [other for _, other, _ in found]
            if name in others:
                wrong.append(f"{where}: expected missions of different names, found {name} twice: {_RENAME}")
            elif what := alike_on_disk([*others, name]):
                wrong.append(f"{where}: {what}: {_RENAME}")
            else:
                found.append((where, name, mission))
    return found


def _of_entry(entry: StudyMission) -> list[Mission]:
    if entry.sample is not None:
        return [sample_mission(entry.sample, seed=seed) for seed in entry.seeds or ()]
    return [load_mission(entry.mission or "", entry.set)]


def _realities(plan: StudyPlan, wrong: _Wrong) -> dict[str, Realities]:
    """The realities by name."""
    found: dict[str, Realities] = {DESIGN_MODEL: lambda model: [model]}
    for index, entry in enumerate(plan.assess.realities):
        where = plan.where(f"assess.realities[{index}]")
        if isinstance(entry, SampledRealities):
            name, reality = entry.label, partial(_samples, entry)
        else:
            named = wrong.attempt(where, load_robot_model, entry)
            if named is None:
                continue
            name, reality = named.name, partial(_fixed, named)
        if name in found:
            wrong.append(f"{where}: expected realities of different names, found {name} twice: {_RENAME}")
        found[name] = reality
    return found


def _samples(given: SampledRealities, model: RobotModel) -> list[RobotModel]:
    return [sampled_reality(model, given.width, given.seed + k) for k in range(given.sample)]


def _fixed(named: RobotModel, _: RobotModel) -> list[RobotModel]:
    return [named]


def _method(given: StudyMethod) -> StudiedMethod:
    if given.files is None:
        return StudiedMethod(given=given, flavour=load_flavour(given.race_flavour).name)
    expected = None if given.flavour is None else load_flavour(given.flavour).name
    made, wrong = list[Software](), list[str]()
    for file in map(Path, given.files):
        try:
            own = read_header(file).get("flavour")
            software = read_fsm(file, expected if own is None else None).software
        except FsmError as error:
            wrong += error.messages
            continue
        if software.flavour != (expected := expected or software.flavour):
            wrong.append(
                f"{file}: expected control software of flavour {expected}, as the others, found {software.flavour}"
            )
        made.append(software)
    if wrong:
        raise FsmError(*wrong)
    return StudiedMethod(given=given, flavour=made[0].flavour, made=tuple(made))


def _studied(
    name: str,
    mission: Mission,
    model: RobotModel | None,
    realities: Mapping[str, Realities],
) -> StudiedMission:
    simulator = Simulator(mission, model)
    simulator.refuse_impossible()
    assessed = {
        label: tuple(
            simulator if model is simulator.robot_model else Simulator(mission, model)
            for model in models(simulator.robot_model)
        )
        for label, models in realities.items()
    }
    return StudiedMission(name=name, simulator=simulator, realities=assessed)


def _label(mission: StudiedMission) -> str:
    """The name, and the robot model if it is not the mission's own."""
    given, model = mission.simulator.mission.robot_model, mission.simulator.robot_model
    return mission.name if load_robot_model(given) == model else f"{mission.name}@{model.name}"


def _check_senses(method: StudiedMethod, mission: StudiedMission) -> None:
    """Check that robots have what control software needs, in the design model and in all realities."""
    for name, simulators in mission.realities.items():
        try:
            for module in () if method.made else flavour_of(method.flavour).modules:
                simulators[0].check_module(module, method.flavour)
            for software in method.made:
                simulators[0].check(software)
        except FsmError as error:
            raise FsmError(*(f"{'' if name == DESIGN_MODEL else f'{name}: '}{one}" for one in error.messages)) from None


def _mission_data(simulator: Simulator) -> dict[str, Any]:
    mission = simulator.mission
    image = mission.floor.image.digest if mission.floor.image else ""
    content = mission.with_files(robot_model="", image=image, named=lambda file: file.digest)
    return {"mission": content, "robot_model": plain(simulator.robot_model)}


def _method_data(method: StudiedMethod) -> dict[str, Any]:
    flavour = {"flavour": method.flavour, "flavour_digest": digest_of(flavour_of(method.flavour))}
    if method.made:
        return flavour | {"files": {str(number): text_of(one) for number, one in enumerate(method.made, start=1)}}
    return flavour | {"method": method.given.race, "options": dict(method.given.options or {})}


def _named(plan: StudyPlan) -> list[str]:
    return [one for one in plan.assess.realities if isinstance(one, str)]


def _sampled(plan: StudyPlan) -> list[SampledRealities]:
    return [one for one in plan.assess.realities if isinstance(one, SampledRealities)]
