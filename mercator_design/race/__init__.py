"""Iterated F-race: find good configurations of anything by racing them on more and more instances.

A racing library that knows no robots: it says which experiments to run, is told their costs, and finds the
configurations of least mean cost. It follows irace (Lopez-Ibanez et al. 2016, The irace package, Operations
Research Perspectives 3:43-58), but that a surrogate proposes most of what is raced; `RaceOptions.irace()` is irace.

    Space, Parameter       what may be configured; `Space.from_text` reads irace's parameters.txt
    IteratedRace           the whole algorithm as ask and tell, with RaceOptions
    methods.METHODS        others, and this one, by name
    Experiment             one configuration on one instance, both counted from 0
    tuner.Tuner            a race of any program that irace's scenario.txt describes
    task.Task              what is raced, for races with journals, executors and folders

>>> from mercator_design.race import IteratedRace, Space
>>> space = Space.from_text('''
... x    "--x "    r (-5, 5)
... rule "--rule " c (slow, fast)
... ''')
>>> race = IteratedRace(space, budget=500, seed=1)
>>> while batch := race.ask():
...     chosen = [race.configurations[experiment.configuration] for experiment in batch]
...     race.tell([(c["x"] - 1.5) ** 2 + (c["rule"] == "slow") for c in chosen])
>>> best = race.configurations[race.best.configuration]
>>> abs(best["x"] - 1.5) < 0.1, best["rule"], race.used <= 500
(True, 'fast', True)
"""

from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.racing.options import RaceOptions
from mercator_design.race.racing.race import Experiment, Race, RaceRules
from mercator_design.race.racing.summary import Elite, IterationSummary, Progress
from mercator_design.race.space.parameter import Configuration, Parameter, Value, categorical, integer, ordered, real
from mercator_design.race.space.space import Space

__all__ = [
    "Configuration",
    "Elite",
    "Experiment",
    "IteratedRace",
    "IterationSummary",
    "Parameter",
    "Progress",
    "Race",
    "RaceOptions",
    "RaceRules",
    "Space",
    "Value",
    "categorical",
    "integer",
    "ordered",
    "real",
]
