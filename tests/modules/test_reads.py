"""Each module declares the senses it reads: the simulator computes no others, and a robot would have them."""

import random

import pytest

from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, FAILURE_CALLS
from mercator_design.modules.reference import SENSES, ReferenceModel, sense_of
from mercator_design.sim.checks.trial import random_readings


class Watched:
    """Readings that note which of their fields are read."""

    def __init__(self, readings, seen):
        self._readings, self._seen = readings, seen

    def __getattr__(self, name):
        self._seen.add(sense_of(name))
        return getattr(self._readings, name)


def read_by(module, call):
    """The senses whose fields a module reads in 200 calls."""
    rng, seen = random.Random(1), set()
    for _ in range(200):
        values = [rng.uniform(p.low, p.high) for p in module.parameters]
        parameters = [round(v) if p.integer else v for v, p in zip(values, module.parameters, strict=True)]
        call(module.function, ReferenceModel(), Watched(random_readings(rng), seen), parameters, rng)
    assert seen <= set(SENSES)
    return seen


@pytest.mark.parametrize("module", BEHAVIOURS.values(), ids=lambda module: module.name)
def test_a_behaviour_reads_what_it_declares(module):
    """By itself or, in a tree, to tell whether it fails."""

    def call(function, model, readings, parameters, rng):
        function(model, readings, [0.0] * 4, rng.random(), *parameters)
        if module.failure >= 0:
            FAILURE_CALLS[module.failure](model, readings, parameters, [0.0])

    assert read_by(module, call) == module.reads


@pytest.mark.parametrize("module", CONDITIONS.values(), ids=lambda module: module.name)
def test_a_condition_reads_what_it_declares(module):
    def call(function, model, readings, parameters, _):
        function(model, readings, [0.0] * 4, *parameters)

    assert read_by(module, call) == module.reads
