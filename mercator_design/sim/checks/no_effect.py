"""Warnings of settings, conditions and colours that have no effect on the robots.

Nothing is refused, because the user may want it.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from mercator_design.config.colours import COLOURS, RGB, Colour, ColourName
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.drawing import kinds_of
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, flavour_of
from mercator_design.modules.module import Module
from mercator_design.modules.perception import gray_level, ground_by_vote
from mercator_design.modules.reference import Readings
from mercator_design.sim.labels import floor_labels, label_of, misread, simulated_labels
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import Neighbours

_MISREAD = 0.01
"""Share of wrong readings of a colour or an image from which on there is a warning."""
_PIXELS = 2_000
"""Number of pixels of an image to check."""


def no_effect_warnings(
    mission: Mission, model: RobotModel, flavour: str, software: Software | None = None
) -> Iterator[str]:
    """A sentence for each part of a mission, a robot model or control software that has no effect.

    Without control software, all conditions of the flavour are checked.
    """
    model = model.with_flavour(flavour)
    yield from model_warnings(model)
    if software is None:
        places = [(flavour, module) for module in flavour_of(flavour).numbered("condition").values()]
    else:
        places = [(place, one.module) for place, one in software.nodes]
    for place, module in places:
        if module.needs_colours and not model.sees_colours:
            yield f"{place}: {module.name} never fires: robot {model.name} sees only how bright the ground is"
    if software is not None and (dead := _dead_places(mission, model, software)):
        yield f"never fires on {mission.name}, whose robots see {seen_colours(mission, model)}: {', '.join(dead)}"
    yield from swarm_warnings(mission, model)
    yield from floor_warnings(mission, model, flavour_of(flavour).numbered("condition").values())


def dead_conditions(mission: Mission, model: RobotModel, flavour: str) -> list[str]:
    """The conditions of a flavour that never fire on a mission, each with its labels if only some of them do not."""
    dead = []
    model = model.with_flavour(flavour)
    for condition in flavour_of(flavour).numbered("condition").values():
        kinds = [*kinds_of([condition])]
        found = [kind for kind in kinds if not can_fire(mission, model, condition, kind.strongest)]
        if found:
            labels = ", ".join(condition.parameters[-1].labels[int(kind.label)] for kind in found if condition.labelled)
            dead.append(condition.name + f" {labels}" * (len(found) < len(kinds)))
    return dead


def _dead_places(mission: Mission, model: RobotModel, software: Software) -> list[str]:
    """The conditions that never fire on the floor of a mission, behind their places."""
    return [
        f"{place} ({one.module.name})"
        for place, one in software.nodes
        if one.module.kind == "condition" and not can_fire(mission, model, one.module, one.parameters)
    ]


def dead_transitions(mission: Mission, model: RobotModel, pfsm: Pfsm) -> list[tuple[int, int]]:
    """State and number of each transition that never fires on the floor of a mission."""
    model = model.with_flavour(pfsm.flavour)
    return [
        (i, j)
        for i, state in enumerate(pfsm.states)
        for j, transition in enumerate(state.transitions)
        if not can_fire(mission, model, transition.module, transition.parameters)
    ]


def is_of_use(mission: Mission, model: RobotModel, module: Module, parameters: Sequence[float]) -> bool:
    """Whether a module can make a difference: there is something to sense, and a condition can fire."""
    if ("light" in module.reads and not mission.lights) or ("neighbours" in module.reads and mission.robots == 1):
        return False
    return module.kind == "behaviour" or can_fire(mission, model, module, parameters)


def can_fire(mission: Mission, model: RobotModel, condition: Module, parameters: Sequence[float]) -> bool:
    """Whether a condition can fire on the floor of a mission; True if that, or its parameters, are not known."""
    levels = ground_levels(mission, model)
    are_known = len(parameters) == len(condition.parameters)
    if condition.reads != {"ground"} or condition.memory > 0 or levels is None or not are_known:
        return True
    probability, constants = condition.probability, model.reference_model
    return any(probability(constants, readings_on(model, one), parameters) != 0.0 for one in levels)


def ground_levels(mission: Mission, model: RobotModel) -> list[RGB] | None:
    """All possible readings of the ground; None if noise, a mean or votes make others possible."""
    if labels := simulated_labels(mission.floor, model):
        return [COLOURS[name] for name in labels]
    device = model.ground
    is_exact = device is not None and device.noise is None and len(device.positions) == 1
    if not is_exact or model.reference_model.ground_vote_cycles > 0.0 or mission.floor.image is not None:
        return None
    return list(mission.floor.colours())


def seen_colours(mission: Mission, model: RobotModel) -> str:
    """The colours of the floor as the robots see them."""
    named: Iterable[Colour] = simulated_labels(mission.floor, model) or mission.floor.colours().values()
    return ", ".join(str(colour) if isinstance(colour, str) else str(list(colour)) for colour in named)


def swarm_warnings(mission: Mission, model: RobotModel) -> Iterator[str]:
    """Warn if robots cannot have neighbours."""
    if mission.robots == 1 and model.neighbours is not None:
        yield f"{mission.where('robots')}: one robot has no neighbours: what its modules read of them is always nothing"


def model_warnings(model: RobotModel) -> Iterator[str]:
    """Warn of settings of a robot model that have no effect."""
    camera, near = model.neighbours, model.reference_model.neighbour_range
    if isinstance(camera, Neighbours) and camera.noise is None and camera.range is not None and camera.range > near:
        yield (
            f"{model.where('neighbours.range')}: {camera.range:g} m changes nothing, as robots count as "
            f"neighbours within {near:g} m (reference_model.neighbour_range)"
        )


def floor_warnings(mission: Mission, model: RobotModel, conditions: Iterable[Module] | None = None) -> Iterator[str]:
    """Warn if the labels are not those of the floor, and of colours that robots confuse."""
    if model.ground is None:
        return
    labels, place = simulated_labels(mission.floor, model), mission.where("floor")
    if labels and labels != (expected := floor_labels(mission.floor)):
        yield _label_warning(mission, model, labels, expected)
        labels = expected  # what else is wrong with the floor
    if conditions is None:
        conditions = flavour_of(DEFAULT_FLAVOUR).numbered("condition").values()
    kinds = kinds_of(one for one in conditions if one.reads == {"ground"} and one.memory == 0)
    readers = [kind for kind in kinds if len(kind.strongest) == len(kind.module.parameters)]
    alike: dict[tuple[float, ...], list[str]] = {}
    for levels, colour in mission.floor.colours().items():
        written = colour if isinstance(colour, str) else str(list(colour))
        wrong = misread(labels, model.ground, np.array([levels])) if labels else {}
        if sum(wrong.values()) >= _MISREAD:
            shares = ", ".join(f"{label} in {100.0 * share:.1f} %" for label, share in wrong.items())
            noise = f"because of the noise of robot {model.name}"
            yield f"{place}: {written} counts as {label_of(labels, levels)}, but as {shares} of readings, {noise}"
            continue
        readings = readings_on(model, COLOURS[label_of(labels, levels)] if labels else levels)
        holds = tuple(
            reader.module.probability(model.reference_model, readings, reader.strongest) for reader in readers
        )
        alike.setdefault(holds, []).append(written)
    for colours in alike.values():
        if readers and len(colours) > 1:  # a network, for example, has no conditions
            yield f"{place}: no condition of robot {model.name} distinguishes {', '.join(colours)}"
    yield from _image_warnings(mission, model, labels)


def _label_warning(
    mission: Mission, model: RobotModel, labels: tuple[ColourName, ...], expected: tuple[ColourName, ...]
) -> str:
    """Compare the colours of the floor with the labels of a robot model."""
    missing = [name for name in expected if name not in labels]
    absent = [name for name in labels if name not in expected]
    facts = [f"{name} counts as {label_of(labels, COLOURS[name])}" for name in missing]
    facts += [f"{', '.join(absent)} {'is' if len(absent) == 1 else 'are'} not on the floor"] if absent else []
    floor = f"the floor of {mission.name} has {', '.join(expected)}"
    return f"{model.where('ground.labels')}: {floor}, the labels are {', '.join(labels)}: {'; '.join(facts)}"


def _image_warnings(mission: Mission, model: RobotModel, labels: tuple[ColourName, ...]) -> Iterator[str]:
    """Warn if many pixels of a floor's image are between two labels."""
    image = mission.floor.image
    if image is None or model.ground is None or not labels:
        return
    pixels = np.random.default_rng(0).choice(mission.floor.pixels.reshape(-1, 3), _PIXELS)
    share = sum(misread(labels, model.ground, pixels).values())
    if share >= _MISREAD:
        counts = f"{100.0 * share:.1f} % of the readings of the image count as another colour than they should"
        yield f"{mission.where('floor.image')}: {counts}, because of the noise of robot {model.name}"


def readings_on(model: RobotModel, levels: RGB) -> Readings:
    """The readings of a robot that has been on a floor of one colour for some time."""
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
