"""What is valid, and hardly meant: settings, conditions and colours that make no difference to the robots.

A user is told of them; nothing is refused, because what is left may be what is wanted.
"""

from collections.abc import Iterable, Iterator

from mercator_design.colours import RGB
from mercator_design.fsm.conditions import COLOUR_LABELS, CONDITIONS
from mercator_design.fsm.modules import Module, numbered
from mercator_design.fsm.perception import gray_level, ground_by_vote
from mercator_design.fsm.reference import Readings
from mercator_design.missions.mission import Mission
from mercator_design.sim.robot_model import Neighbours, RobotModel


def doubts(mission: Mission, model: RobotModel, flavour: str, modules: Iterable[tuple[str, Module]]) -> Iterator[str]:
    """A sentence for each doubt about robots on a mission.

    Args:
        mission: With the floor.
        model: Of the robots.
        flavour: Whose conditions there are.
        modules: That the robots may run, each with its place in words.
    """
    yield from doubts_of_model(model)
    for place, module in modules:
        if module.colours and not model.sees_colours:
            yield f"{place}: {module.name} never holds: robot {model.name} sees only how bright the ground is"
    yield from doubts_of_floor(mission, model, numbered(CONDITIONS, flavour).values())


def doubts_of_model(model: RobotModel) -> Iterator[str]:
    """Whether a robot model says what makes no difference."""
    camera, near = model.neighbours, model.reference_model.neighbour_range
    if isinstance(camera, Neighbours) and camera.noise is None and camera.range is not None and camera.range > near:
        yield (
            f"robot model {model.name}: neighbours.range: {camera.range:g} m changes nothing, as robots count as "
            f"neighbours within {near:g} m (reference_model.neighbour_range)"
        )


def doubts_of_floor(mission: Mission, model: RobotModel, conditions: Iterable[Module] = CONDITIONS) -> Iterator[str]:
    """Which colours of a floor (but for its image) are one to some conditions of a robot without noise."""
    if model.ground is None:
        return
    readers = [condition for condition in conditions if "ground" in condition.reads]
    alike: dict[tuple[float, ...], list[str]] = {}
    for levels, written in mission.floor.colours().items():
        readings = _readings(model, levels)
        holds = tuple(
            reader.function(model.reference_model, readings, (1.0, float(label)))
            for reader in readers
            for label in range(len(COLOUR_LABELS))
        )
        alike.setdefault(holds, []).append(written if isinstance(written, str) else str(list(written)))
    for colours in alike.values():
        if len(colours) > 1:
            yield f"{mission.name}: floor: no condition of robot {model.name} tells {', '.join(colours)} apart"


def _readings(model: RobotModel, levels: RGB) -> Readings:
    """What a robot reads, after a while, on a floor of one colour."""
    reference = model.reference_model
    red, green, blue = levels
    level = gray_level(red, green, blue)
    if reference.ground_vote_cycles > 0.0:
        votes = reference.ground_vote_cycles * len(model.ground.positions if model.ground else ())
        blacks, whites = level < reference.ground_vote_black, level > reference.ground_vote_white
        level = ground_by_vote(reference, votes * blacks, votes * whites)
    if not model.sees_colours:
        red = green = blue = level
    return Readings(ground_red=red, ground_green=green, ground_blue=blue)
