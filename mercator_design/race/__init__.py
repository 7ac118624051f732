"""Races: find good configurations of anything by running more and more experiments of those that look good.

A racing library that does not depend on robots: `ask` gives experiments, `tell` takes their costs, and the race finds
the configurations with the lowest mean cost.

    Halving        the default method as ask and tell, with HalvingOptions: generations by successive halving
    IteratedRace   iterated F-race, irace's method (Lopez-Ibanez et al. 2016, The irace package, Operations Research
                   Perspectives 3:43-58), with RaceOptions
    Space          the parameters of the configurations; `parse_space` reads irace's parameters.txt
    Experiment     one configuration on one instance, both counted from 0
    RaceRun        a running race with its tests: an iterator of events; an executor runs its experiments
    Event          such an event: ExperimentDone, IterationEnded, ...

The rooms, from the bottom up:

    space/       parameters, their domains and conditions
    irace/       irace's files, and a race of any program that irace's scenario.txt describes
    racing/      one race: statistical tests, budget, options
    candidates/  new configurations: samples, moves, proposals
    methods/     the optimizers by name
    executors/   threads, processes or a cluster that run experiments
    running/     runner, journal and task: for races with folders and workers
    analysis/    importance of parameters, ablation

>>> from mercator_design.race import Halving, parse_space
>>> space = parse_space('''
... x    "--x "    r (-5, 5)
... rule "--rule " c (slow, fast)
... ''')
>>> race = Halving(space, budget=500, seed=1)
>>> while batch := race.ask():
...     chosen = [race.configurations[experiment.configuration] for experiment in batch]
...     race.tell([(c["x"] - 1.5) ** 2 + (c["rule"] == "slow") for c in chosen])
>>> best = race.configurations[race.best.configuration]
>>> abs(best["x"] - 1.5) < 0.1, best["rule"], race.used <= 500
(True, 'fast', True)
"""

from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.elimination.race import EliminationRace, Experiment, RaceRules
from mercator_design.race.elimination.summary import Elite, IterationSummary, Progress
from mercator_design.race.irace.parameters import parse_space
from mercator_design.race.methods.halving import Halving, HalvingOptions
from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.session.events import (
    BudgetExtended,
    ConfigurationAdded,
    Event,
    ExperimentDone,
    IterationEnded,
    RaceEnded,
    ScoreRevised,
    SessionStarted,
    SessionStopped,
    SpeculativeDone,
    TestDone,
)
from mercator_design.race.session.runner import RaceRun
from mercator_design.race.space.parameter import Configuration, Parameter, Value, categorical, integer, ordered, real
from mercator_design.race.space.space import Space

__all__ = [
    "BudgetExtended",
    "Configuration",
    "ConfigurationAdded",
    "EliminationRace",
    "Elite",
    "Event",
    "Experiment",
    "ExperimentDone",
    "Halving",
    "HalvingOptions",
    "IteratedRace",
    "IterationEnded",
    "IterationSummary",
    "Parameter",
    "Progress",
    "RaceEnded",
    "RaceOptions",
    "RaceRules",
    "RaceRun",
    "ScoreRevised",
    "SessionStarted",
    "SessionStopped",
    "Space",
    "SpeculativeDone",
    "TestDone",
    "Value",
    "categorical",
    "integer",
    "ordered",
    "parse_space",
    "real",
]
