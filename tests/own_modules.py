"""Modules of tests, and a flavour that has them."""

import contextlib
from typing import Annotated

from mercator_design.config.schema import Range
from mercator_design.modules import flavour, module
from mercator_design.modules.reference import Actions
from mercator_design.plugins import registries


@contextlib.contextmanager
def entered(function, name="tested", **marks):
    """A flavour of two behaviours, a function (0) and one that stands still (1), and of fixed probabilities (0)."""
    restore = registries.snapshot()
    try:
        module.behaviour(**marks)(function)
        known = {"behaviours": {[*module.BEHAVIOURS][-1]: 0, "stop": 1}, "conditions": {"fixed probability": 0}}
        yield flavour.enter_flavour(flavour.Flavour(name=name, **known))
    finally:
        restore()


def blink(
    model,
    readings,
    memory,
    u,
    led: Annotated[float, Range(-9, 9)],  # the colour, from the third cycle on
    call: Annotated[float, Range(-9, 9)],  # the signal, in the third cycle
):
    """Drive, set the LEDs in the third cycle, and send a signal then."""
    memory[0] += 1.0
    if memory[0] == 3.0:
        return Actions(0.5, 0.5, led, call)
    return Actions(0.5, 0.5, -1.0, 0.0)


BLINKS = {"sets": {"wheels", "led_colour", "signal"}, "memory": 1}
