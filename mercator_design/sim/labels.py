"""Which colours the robots of a mission tell apart on its floor: the labels of their ground sensors."""

import itertools

import numpy as np
from numpy.typing import NDArray

from mercator_design.colours import COLOURS, LABELS, RGB, ColourName
from mercator_design.fsm.perception import nearest_label
from mercator_design.jit import compiled
from mercator_design.missions.floor import Floor
from mercator_design.sim.robot_model import RobotModel


def simulated_labels(floor: Floor, model: RobotModel) -> tuple[ColourName, ...]:
    """The labels in the order of COLOURS; none if readings of the ground count as measured."""
    return robot_labels(floor, model) if model.ground is not None and model.ground.labels else ()


def robot_labels(floor: Floor, model: RobotModel) -> tuple[ColourName, ...]:
    """The labels that a robot on the floor has, in the order of COLOURS: those of its model, or of the floor."""
    chosen = model.ground.labels if model.ground is not None else None
    names = chosen if isinstance(chosen, tuple) and chosen else _shown(floor)
    return tuple(name for name in COLOURS if name in names)


def _shown(floor: Floor) -> set[ColourName]:
    """The named colours that a floor may show; levels and pixels of an image count as the nearest of LABELS."""
    written = floor.colours()
    names: set[ColourName] = {colour for colour in written.values() if isinstance(colour, str)}
    levels = np.array([rgb for rgb, colour in written.items() if not isinstance(colour, str)]).reshape(-1, 3)
    names |= _nearest(levels)
    if floor.image is not None:
        names |= _nearest(floor.image.pixels.reshape(-1, 3))
    return names


def as_labelled(labels: tuple[ColourName, ...], levels: RGB) -> RGB:
    """The colour that a reading counts as; itself without labels."""
    return COLOURS[labels[nearest_label(level_row(labels), *levels)]] if labels else levels


def level_row(names: tuple[ColourName, ...]) -> NDArray[np.float64]:
    """Red, green and blue of each name (3 * names,), as `nearest_label` wants them."""
    return np.array(list(itertools.chain.from_iterable(COLOURS[name] for name in names)))


def _nearest(levels: NDArray[np.generic]) -> set[ColourName]:
    """Those of LABELS that are the nearest to at least one of the colours (n, 3)."""
    found = np.zeros(len(LABELS), dtype=np.bool_)
    if len(levels):
        compiled(_mark_nearest)(level_row(LABELS), levels, found)
    return {LABELS[k] for k in np.flatnonzero(found)}


def _mark_nearest(labels: NDArray[np.float64], levels: NDArray[np.generic], found: NDArray[np.bool_]) -> None:
    for i in range(len(levels)):
        red, green, blue = float(levels[i, 0]), float(levels[i, 1]), float(levels[i, 2])
        found[nearest_label(labels, red, green, blue)] = True
