"""Work on missions for the desk: checks."""

from dataclasses import dataclass

from mercator_design.config import shipped
from mercator_design.config.loading import text_of
from mercator_design.errors import MissionError, excerpt
from mercator_design.missions.mission import Mission, parse_mission
from mercator_design.serve.jobs.job import Request
from mercator_design.serve.settings import Limits
from mercator_design.sim.checks.no_effect import no_effect_warnings
from mercator_design.sim.simulate import Simulator

NAME = "mission.yaml"
"""The name of a user's text in messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedMission:
    """What a check of a mission has found."""

    name: str
    direction: str
    robots: int
    duration: float  # [s]
    warnings: tuple[str, ...]


def user_mission(name: str, text: str | None, overrides: tuple[str, ...], limits: Limits) -> Mission:
    """The mission of a user: a shipped one or a text, which may not name files of the service.

    Raises:
        MissionError: It is not valid, or beyond a limit.
    """
    if text is not None:
        name = NAME
    elif name in shipped.missions():
        text = text_of(shipped.missions()[name], error=MissionError)
    else:
        raise MissionError(f"mission: expected the name of a shipped mission, found {excerpt(name)}")
    mission = parse_mission(text, name=name, overrides=overrides, files=False)
    if mission.robot_model not in shipped.robot_models():
        raise MissionError(f"robot_model: expected the name of a shipped one, found {excerpt(mission.robot_model)}")
    for key, most in (("robots", limits.robots), ("duration", limits.duration)):
        if (found := getattr(mission, key)) > most:
            raise MissionError(f"{key}: expected at most {most:g}, the limit of this service, found {found:g}")
    return mission


def checked_request(request: Request, text: str | None, limits: Limits) -> CheckedMission:
    """Check the mission of a job, and that a race of it can begin.

    Raises:
        MercatorError: It cannot; with each mistake.
    """
    from mercator_design.designer import Designer

    mission = user_mission(request.mission, text, request.set, limits)
    simulator = Simulator(mission)
    simulator.refuse_impossible()
    Designer(simulator, budget=request.budget, seed=request.seed, flavour=request.flavour, method=request.method)
    warnings = [one.message for one in simulator.warnings]
    warnings += no_effect_warnings(mission, simulator.robot_model, request.flavour)
    return CheckedMission(
        name=mission.name,
        direction=mission.objective.direction,
        robots=mission.robots,
        duration=mission.duration,
        warnings=tuple(warnings),
    )
