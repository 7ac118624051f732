"""The labels of ground sensors: the colours that the robots of a mission distinguish on its floor."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats
from mercator_design.config.colours import COLOURS, LABELS, RGB, ColourName
from mercator_design.jit import compiled
from mercator_design.missions.floor import Floor
from mercator_design.modules.perception import nearest_label
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import Gaussian, Ground

_READINGS = 2_000
"""Number of readings drawn for each colour, to estimate the effect of noise."""


def simulated_labels(floor: Floor, model: RobotModel) -> tuple[ColourName, ...]:
    """The labels in the order of COLOURS; none if robots use ground readings as measured."""
    return robot_labels(floor, model) if model.ground is not None and model.ground.labels is not None else ()


def robot_labels(floor: Floor, model: RobotModel) -> tuple[ColourName, ...]:
    """The labels of a robot on the floor, in the order of COLOURS: those of its model, or of the floor."""
    chosen = model.ground.labels if model.ground is not None else None
    return _in_order(chosen) if isinstance(chosen, tuple) else floor_labels(floor)


def floor_labels(floor: Floor) -> tuple[ColourName, ...]:
    """The named colours that a floor may show, in the order of COLOURS.

    Levels and pixels of an image count as the nearest of LABELS.
    """
    written = floor.colours()
    names: set[ColourName] = {colour for colour in written.values() if isinstance(colour, str)}
    levels = np.array([rgb for rgb, colour in written.items() if not isinstance(colour, str)]).reshape(-1, 3)
    names |= _nearest(levels)
    if floor.image is not None:
        names |= _nearest(floor.pixels.reshape(-1, 3))
    return _in_order(names)


def _in_order(names: Collection[ColourName]) -> tuple[ColourName, ...]:
    return tuple(name for name in COLOURS if name in names)


def label_of(labels: tuple[ColourName, ...], levels: RGB) -> ColourName:
    """The label that a reading counts as."""
    return labels[nearest_label(level_row(labels), *levels)]


def misread(labels: tuple[ColourName, ...], device: Ground, colours: NDArray[np.generic]) -> dict[ColourName, float]:
    """The share of readings that count as a wrong label because of noise.

    Args:
        labels: The labels of the device.
        device: The ground sensors of a robot; all see the same colour at a time.
        colours: (n, 3) red, green and blue of the colours, which are equally frequent; n is at most 2000.

    Returns:
        Each wrong label with its share of all readings, in descending order.
    """
    if device.noise is None:
        return {}
    noise, seen = device.noise, np.resize(colours, (_READINGS, 3)).astype(np.float64)
    shape, rng = (_READINGS, len(device.positions), 3), np.random.default_rng(0)
    draws = (
        rng.normal(0.0, noise.sd, shape)
        if isinstance(noise, Gaussian)
        else rng.uniform(-noise.half_width, noise.half_width, shape)
    )
    measured = np.clip(np.floor(seen[:, np.newaxis] + noise.mean + draws + 0.5), 0.0, 255.0).mean(axis=1)
    table = level_row(labels).reshape(-1, 3)
    exact, found = (np.sum((each[:, np.newaxis] - table) ** 2, axis=2).argmin(axis=1) for each in (seen, measured))
    counts = np.bincount(found[found != exact], minlength=len(labels))
    return {labels[k]: float(counts[k]) / _READINGS for k in np.argsort(-counts, kind="stable") if counts[k]}


def level_row(names: tuple[ColourName, ...]) -> Floats:
    """Red, green and blue of each name (3 * names,), for `nearest_label`."""
    return np.array([COLOURS[name] for name in names]).ravel()


def _nearest(levels: NDArray[np.generic]) -> set[ColourName]:
    """Those of LABELS that are nearest to at least one of the colours (n, 3)."""
    found = np.zeros(len(LABELS), dtype=np.bool_)
    if len(levels):
        compiled(_mark_nearest)(level_row(LABELS), levels, found)
    return {LABELS[k] for k in np.flatnonzero(found)}


def _mark_nearest(labels: Floats, levels: NDArray[np.generic], found: Flags) -> None:
    for i in range(len(levels)):
        red, green, blue = float(levels[i, 0]), float(levels[i, 1]), float(levels[i, 2])
        found[nearest_label(labels, red, green, blue)] = True
