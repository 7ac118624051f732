"""What changes a floor during an experiment; one file for each kind, found by being there.

`change_floor` is called once in each control cycle, by the simulator, and by objectives that look at the floor as it
was: a trace keeps the floor of the start and the robots' poses, from which all that happens to a floor follows.
"""

import importlib
import pkgutil

from mercator_design.arrays import Floats
from mercator_design.jit import dispatcher, jittable
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.plugins import CHANGES

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)

_change = dispatcher(CHANGES)


@jittable
def change_floor(floor: FloorTable, poses: Floats, time: float) -> None:
    """Bring a floor up to date, in place.

    Args:
        floor: Its zones change, and the numbers that its dynamics keep.
        poses: (robots, 3) x, y [m], heading [rad], now.
        time: Since the start [s].
    """
    for k in range(len(floor.changes)):
        table = floor.numbers[floor.changes[k, 1] : floor.changes[k, 2]]
        _change(floor.changes[k, 0], floor, table, poses, time)
