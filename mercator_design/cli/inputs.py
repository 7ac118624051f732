"""What verbs are given: a controller's file, the mission that it is for, a robot model."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import click

from mercator_design.command import warn
from mercator_design.errors import FsmError, MissionError, excerpt

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from mercator_design.fsm.text import FsmFile
    from mercator_design.missions.mission import Mission
    from mercator_design.sim.simulate import Simulator


def new_simulator(mission: "Mission", robot_model: str | None) -> "Simulator":
    """The simulator of a mission, with its own robot model if no other is given."""
    from mercator_design.sim.robot_model import load_robot_model
    from mercator_design.sim.simulate import Simulator

    return Simulator(mission, load_robot_model(robot_model) if robot_model is not None else None)


class Given(TypedDict):
    """What a user names beside a controller's file."""

    mission: str | None
    robot_model: str | None
    overrides: tuple[str, ...]


def simulator_of(
    fsm: Path, file: "FsmFile", given: Given, *, warn: "Callable[[Iterable[str]], None]" = warn
) -> "Simulator":
    """The simulator for a controller: of the mission and robot model that the user gives, or that its header names.

    The header has digests of what was raced. What the user does not give must have these digests; of what they do
    give, `warn` is told if it goes by the raced one's name, or comes with the mission, and is another.

    Raises:
        MissionError: Something that the user did not give is not what was raced.
    """
    from mercator_design.loading import digest_of

    header = file.header
    mission = _mission_of(fsm, file, given["mission"], given["overrides"])
    simulator = new_simulator(mission, given["robot_model"])
    is_raced = header.get("mission digest") in {None, mission.digest}
    if given["mission"] is not None and not given["overrides"] and header.get("mission") == mission.name:
        warn([] if is_raced else [f"{fsm}: was designed for another mission of the name {excerpt(mission.name)}"])
    chosen = given["robot_model"] is not None or "robot_model" in map(_key, given["overrides"])
    if chosen or header.get("robot model digest") in {None, digest_of(simulator.robot_model)}:
        return simulator
    name = excerpt(simulator.robot_model.name)
    if given["mission"] is None:
        what = f"the robot model {name} is not what it was when this was designed"
        raise MissionError(f"{fsm}: {what}; to use it as it is now, give --robot-model {mission.robot_model}")
    designed = excerpt(header.get("robot model", "another"))
    warn([f"{fsm}: was designed for the robot model {designed} as it was then; the robot model {name} of now differs"])
    return simulator


def _key(assignment: str) -> str:
    """What an override assigns to."""
    return assignment.partition("=")[0].strip()


def _mission_of(fsm: Path, file: "FsmFile", given: str | None, overrides: tuple[str, ...]) -> "Mission":
    """The mission to measure a controller on: the one given, the one raced beside it, the one its header names.

    If the header has the digest of the mission that was raced, the last two must have it too.
    """
    from mercator_design.loading import dump
    from mercator_design.missions.mission import load_mission, parse_mission

    if given is not None:
        return load_mission(given, overrides)
    _check_plugins(fsm, file)
    named, digest = file.header.get("mission"), file.header.get("mission digest")
    if named is None:
        raise click.UsageError(f"{fsm} does not say which mission it is for; give --mission")
    beside = fsm.parent / "mission.yaml"
    if digest and beside.exists() and load_mission(beside).digest == digest:
        return load_mission(beside, overrides)
    changed = ""
    if digest and beside.exists():
        changed = f"{beside} is not what it was when this was designed; to use it as it is now, give --mission {beside}"
    raced_with = _overrides_of(fsm, file)
    try:
        mission = load_mission(named, raced_with)
    except MissionError as error:
        told = [f"the mission of its header: {message}; give --mission" for message in error.messages]
        raise MissionError(*(f"{fsm}: {each}" for each in ([changed] if changed else told))) from None
    if digest and mission.digest != digest:
        what = changed or f"{excerpt(named)} is not what it was when this was designed; give --mission"
        raise MissionError(f"{fsm}: {what}")
    return parse_mission(dump(mission), name=named, overrides=overrides) if overrides else mission


def _overrides_of(fsm: Path, file: "FsmFile") -> list[str]:
    """The overrides that the header says the mission was raced with."""
    text = file.header.get("set", "[]")
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
        raise FsmError(f"{fsm}: set in the header: expected a JSON list of texts, found {excerpt(text)}")
    return found


def _check_plugins(fsm: Path, file: "FsmFile") -> None:
    """Make sure that the plugins that a controller was designed with are loaded, and are what they were."""
    from mercator_design.missions.plugins import loaded_plugins

    loaded = loaded_plugins()
    for word in file.header.get("plugins", "").split(", "):
        name, _, digest = word.rpartition(" ")
        if name and name not in loaded:
            name = excerpt(name)
            raise MissionError(f"{fsm}: was designed with the plugin {name}; give --plugin {name}, or --mission")
        if name and loaded[name] != digest:
            raise MissionError(f"{fsm}: {name} is not what it was when this was designed; give --mission")
