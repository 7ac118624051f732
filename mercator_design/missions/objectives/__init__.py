"""What counts: pure functions of a `Trace`; one file a family, found by being there.

The order of the robots must not matter, and positions are those of the robots' centres, after each control cycle. The
same functions score robots in the arena, from tracked positions.
"""

import importlib
import pkgutil

from mercator_design.missions.plugins import OBJECTIVES

__all__ = ["OBJECTIVES"]

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)
