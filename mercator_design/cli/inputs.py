"""Inputs of several verbs: a controller's file, its mission, a robot model."""

import json
from collections.abc import Callable, Container, Iterable, Mapping
from pathlib import Path
from typing import Any, TypedDict

import click

from mercator_design.cli.origin import Origin, origin_of
from mercator_design.command import check_modules, software_files, warn
from mercator_design.config.writing import dump
from mercator_design.errors import FsmError, MissionError, excerpt
from mercator_design.missions.mission import Mission, load_mission, parse_mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.plugins.loading import run_plugin
from mercator_design.plugins.sources import read_plugin
from mercator_design.results.files import read_provenance
from mercator_design.sim.checks.no_effect import no_effect_warnings
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import FsmFile, read_header
from mercator_design.software.needed import module_plugins


def new_simulator(mission: Mission, robot_model: str | None) -> Simulator:
    """The simulator of a mission, with the mission's robot model if no other is given."""
    return Simulator(mission, load_robot_model(robot_model) if robot_model is not None else None)


def check_apart(output: Path, inputs: Iterable[Path]) -> None:
    """Check that the output file is none of the input files."""
    for path in inputs:
        if output.exists() and path.exists() and output.samefile(path):
            raise click.UsageError(f"{output}: expected another file than the one that is read")


def warn_of_no_effect(simulator: Simulator, flavour: str, software: Software | None = None) -> None:
    """Warn of parts without effect when a mission's robots run a PFSM, or any PFSM of a flavour."""
    warn(*no_effect_warnings(simulator.mission, simulator.robot_model, flavour, software))


def warn_of_mission(simulator: Simulator, *, refuse: bool) -> None:
    """Warn of impossible parts of a mission, and of probable mistakes.

    Raises:
        MissionError: A part is impossible, and `refuse` is true.
    """
    warn(*(warning.message for warning in simulator.warnings if not (refuse and warning.is_impossible)))
    if refuse:
        simulator.refuse_impossible()


class Given(TypedDict):
    """The mission, robot model and overrides that a user gives with a controller's file."""

    mission: str | None
    robot_model: str | None
    overrides: tuple[str, ...]


def simulator_of(fsm: Path, file: FsmFile, given: Given, *, warn: Callable[[str], None] = warn) -> Simulator:
    """The simulator for a controller, with the mission and robot model that the user gives or that its header names.

    The header has digests of the raced mission and robot model. Those that the header names must have these digests.
    There is a warning if a given mission has the same name but another digest, or comes with another robot model. There
    is no warning for a given robot model, because messages recommend to give one.

    Raises:
        MissionError: The mission or robot model that the header names has changed since the race.
    """
    header, origin = file.header, origin_of(fsm, file.header)
    modules = {plugin.name for plugin in module_plugins(flavour_of(file.software.flavour))}
    mission = _mission_of(origin, given["mission"], given["overrides"], modules, warn)
    simulator = new_simulator(mission, given["robot_model"])
    is_other = header.get("mission") == mission.name and header.get("mission digest") not in {None, mission.digest}
    if is_other and given["mission"] is not None and not given["overrides"]:
        warn(f"{fsm}: was designed for another mission of the name {excerpt(mission.name)}")
    sets_model = any(each.partition("=")[0].strip() == "robot_model" for each in given["overrides"])
    if sets_model or given["robot_model"] is not None:
        return simulator
    name = excerpt(simulator.robot_model.name)
    has_changed = origin.has_changed(simulator.robot_model)
    if has_changed is None:
        warn(f"{fsm}: has no digest of its robot model: it cannot be checked whether {name} has changed")
    if not has_changed:
        return simulator
    if given["mission"] is None:
        what = f"the robot model {name} has changed since this was designed"
        raise MissionError(f"{fsm}: {what}; to use it as it is now, give --robot-model {mission.robot_model}")
    designed = excerpt(header.get("robot model", "another"))
    warn(f"{fsm}: was designed for another version of the robot model {designed} than the present {name}")
    return simulator


def load_plugins(given: Iterable[Path], arguments: Mapping[str, Any]) -> None:
    """Run plugins, after comparing their digests with those of the controller and the run folder of a verb's arguments.

    A plugin must not have changed since the controller was designed, unless the option is given that says what it is
    for now: --flavour, if the controller has modules of it, else --mission.

    Raises:
        MissionError: A plugin has another digest, or cannot be run.
        MercatorError: The controller or the folder cannot be read.
    """
    folder = arguments.get("directory") or arguments.get("resume")
    found = [(file, read_plugin(file)) for file in given]
    for controller in software_files(arguments) if found else ():
        origin = origin_of(controller, read_header(controller))
        for _, plugin in found:
            if plugin.name in origin.module_plugins:
                check_modules(controller, origin.header, plugin, arguments)
            else:
                origin.check_plugin(plugin.name, plugin.digest, refuse=arguments.get("mission") is None)
    if found and folder is not None:
        raced: Any = read_provenance(folder).race.get("plugins", {})
        for file, plugin in found:
            if raced.get(plugin.name, plugin.digest) != plugin.digest:
                raise MissionError(
                    f"{file}: expected a plugin of digest {raced[plugin.name]}, as in the race of {folder}, found "
                    f"{plugin.digest}; it was not run"
                )
    for file, plugin in found:
        run_plugin(plugin, str(file))


def ignore(_: object) -> None:
    """Ignore a warning."""


def _mission_of(
    origin: Origin,
    given: str | None,
    overrides: tuple[str, ...],
    of_modules: Container[str],
    warn: Callable[[str], None],
) -> Mission:
    """The mission of a controller: the given one, the one in its run folder, or the one that its header names.

    If the header has the digest of the mission, the last two must have it, too.
    """
    if given is not None:
        return load_mission(given, overrides)
    origin.check_loaded(of_modules)
    fsm, header = origin.file, origin.header
    named, digest = header.get("mission"), header.get("mission digest")
    if named is None:
        raise click.UsageError(f"{fsm}: names no mission; give --mission")
    beside, changed = fsm.parent / "mission.yaml", ""
    if digest and beside.exists():
        if load_mission(beside).digest == digest:
            return load_mission(beside, overrides)
        changed = f"{beside} has changed since this was designed; to use it, give --mission {beside}"
    raced_with = _overrides_of(fsm, header)
    try:
        mission = load_mission(named, raced_with)
    except MissionError as error:
        messages = [f"the mission of its header: {message}; give --mission" for message in error.messages]
        raise MissionError(*(f"{fsm}: {each}" for each in ([changed] if changed else messages))) from None
    if digest and mission.digest != digest:
        what = changed or f"{excerpt(named)} has changed since this was designed; give --mission"
        raise MissionError(f"{fsm}: {what}")
    if changed:
        warn(f"{changed}; {excerpt(named)} is used")
    return parse_mission(dump(mission), name=named, overrides=overrides) if overrides else mission


def _overrides_of(fsm: Path, header: Mapping[str, str]) -> list[str]:
    """The overrides of the raced mission, by the header."""
    text = header.get("set", "[]")
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
        raise FsmError(f"{fsm}: set in the header: expected a JSON list of texts, found {excerpt(text)}")
    return found
