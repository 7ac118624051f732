"""Studies: comparisons of design methods over missions and repetitions, of which a design is the unit.

The package can be called, because `mercator_design.study(...)` runs a study and would else be this package.
"""

import importlib
import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    def __call__(self, *arguments: Any, **given: Any) -> Any:  # noqa: ANN401 - those of the function
        """As `api.study`."""
        return importlib.import_module("mercator_design.api").study(*arguments, **given)  # a floor above


sys.modules[__name__].__class__ = _Callable
