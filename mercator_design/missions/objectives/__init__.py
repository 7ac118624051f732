"""Objectives: pure functions of a `Trace`; all modules of this package are imported.

The order of the robots must not matter. Positions are those of the robots' centres, after each control cycle. The same
functions score real robots, from tracked positions.
"""

import importlib
import pkgutil

from mercator_design.missions.plugins import OBJECTIVES

__all__ = ["OBJECTIVES"]

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)
