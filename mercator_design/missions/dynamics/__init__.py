"""Dynamics, which change a floor during an experiment; all modules of this package are imported.

The simulator calls `change_floor` once in each control cycle, and so do objectives that need the floor at a time: a
trace keeps the floor of the start and the robots' poses, from which all changes follow.
"""

import importlib
import pkgutil

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.jit import jittable, open_dispatcher
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.plugins import CHANGES

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)

_ROWS = np.zeros((0, 1))
_FLOOR = FloorTable(
    zones=_ROWS,
    background=np.zeros(3),
    image=np.zeros((1, 1, 3), dtype=np.uint8),
    extent=np.zeros(4),
    vertices=_ROWS,
    changes=np.zeros((0, 3), dtype=np.int64),
    numbers=_ROWS,
)
_POSES = np.broadcast_to(_ROWS, _ROWS.shape)  # only to read
_change = open_dispatcher("dynamics", CHANGES, like=(_FLOOR, _ROWS, _POSES, 0.0))  # plugins add theirs


@jittable
def change_floor(floor: FloorTable, poses: Floats, time: float) -> None:
    """Update a floor, in place.

    Args:
        floor: Its zones change, and the numbers that its dynamics keep.
        poses: (robots, 3) x, y [m], heading [rad], now.
        time: Since the start [s].
    """
    for k in range(len(floor.changes)):
        table = floor.numbers[floor.changes[k, 1] : floor.changes[k, 2]]
        _change(floor.changes[k, 0], floor, table, poses, float(time))
