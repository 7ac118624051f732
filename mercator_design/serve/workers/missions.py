"""Functions on missions that workers compute: checks, facts, pictures."""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal

from mercator_design.config.json_schema import json_schema
from mercator_design.config.writing import dump
from mercator_design.designer import Designer
from mercator_design.errors import MercatorError
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers.findings import MissionFinding, findings, without_folders
from mercator_design.serve.workers.sources import MissionSource, text_without_files
from mercator_design.show.text.missions import facts_of
from mercator_design.sim.checks.no_effect import dead_conditions, no_effect_warnings
from mercator_design.sim.simulate import Simulator, robot_model_of

_BUDGET = 10_000
"""A budget that suffices for any method."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedMission:
    """Facts and warnings of a job's mission that was checked."""

    name: str
    direction: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFacts:
    """Facts of a valid mission."""

    name: str
    description: str
    source: str
    digest: str
    robots: int
    robot_model: str
    duration: float  # [s] of an experiment
    control_period: float  # [s]
    objective: str
    direction: str
    never_fires: tuple[str, ...]  # conditions of the flavour


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionReview:
    """All mistakes and warnings in a mission, and its facts if it can be read."""

    errors: tuple[MissionFinding, ...]
    warnings: tuple[MissionFinding, ...] = ()
    facts: MissionFacts | None = None


def warm_up() -> None:
    """Load the simulator, and compile it if need be, before the first user waits for it."""
    Simulator(load_mission("aggregation")).rehearse(announce=lambda _: None)


def check_request(request: RaceRequest, limits: UserLimits) -> CheckedMission:
    """Check the mission of a job, and that a race of it can begin.

    Raises:
        MercatorError: It cannot; with each mistake.
    """
    mission = MissionSource.of(request).read(limits)
    simulator = Simulator(mission)
    simulator.check_placement()
    Designer(simulator, budget=request.budget, seed=request.seed, flavour=request.flavour, method=request.method)
    return CheckedMission(
        name=mission.name,
        direction=mission.direction,
        warnings=tuple(map(without_folders, mission_warnings(simulator, request.flavour))),
    )


def review(source: MissionSource, flavour: str, limits: UserLimits) -> MissionReview:
    """Mistakes, warnings and facts of a mission.

    Raises:
        MissionError: There is no shipped mission of the name.
    """
    label, text = source.label_and_text()
    try:
        mission = source.read(limits)
        simulator = Simulator(mission)
    except MercatorError as error:
        return MissionReview(errors=tuple(findings(error.messages, label, text)))
    errors: list[str] = []
    for attempt in (simulator.check_placement, partial(Designer, simulator, budget=_BUDGET, seed=1, flavour=flavour)):
        try:
            attempt()
        except MercatorError as error:
            errors += error.messages
    return MissionReview(
        errors=tuple(findings(errors, label, text)),
        warnings=tuple(findings(mission_warnings(simulator, flavour), label, text)),
        facts=MissionFacts(
            **facts_of(mission),
            digest=mission.digest,
            control_period=mission.control_period,
            never_fires=tuple(dead_conditions(mission, simulator.robot_model, flavour)),
        ),
    )


@lru_cache(maxsize=32)
def picture(source: MissionSource, limits: UserLimits, seed: int, kind: Literal["png", "svg"]) -> bytes:
    """Picture of a user's mission from above; cached, because the page of a new job shows the same one often.

    Raises:
        MercatorError: It is not valid, or the robots do not fit.
    """
    from mercator_design.results.experiments.preview import preview_of
    from mercator_design.show.pictures.preview import picture_of

    return picture_of(preview_of(Simulator(source.read(limits)), seed=seed), suffix=f".{kind}")


def mission_text(source: MissionSource, limits: UserLimits) -> str:
    """The text of a mission, which names no files; if it has overrides or is of a run folder, without its comments.

    Raises:
        MissionError: It is not valid, or it has files of its own.
    """
    if source.folder is not None:
        mission = source.read(limits)
        return text_without_files(mission, robot_model_of(mission))
    return dump(source.read(limits)) if source.overrides else source.label_and_text()[1]


def mission_schema() -> dict[str, Any]:
    """The JSON Schema of mission files, with the objectives of the service's plugins."""
    return json_schema(Mission, title="A mission", given=("name",))


def mission_warnings(simulator: Simulator, flavour: str) -> list[str]:
    """Warnings on a mission, without those for which it is refused."""
    found = [one.message for one in simulator.warnings if not one.is_impossible]
    return [*found, *no_effect_warnings(simulator.mission, simulator.robot_model, flavour)]
