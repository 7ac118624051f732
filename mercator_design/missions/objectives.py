"""What counts: objectives are pure functions of a `Trace`, and OBJECTIVES is their only list.

An objective is a function `f(trace, *, parameters...) -> float`, marked `@objective`. Its keyword-only
parameters are what a mission file may say beside `name` and `direction`; their annotations are checked when
the file is read. The order of the robots must not matter, and positions are those of the robots' centres. The
same functions score robots in the arena, from tracked positions.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np

from mercator_design.loading import Length, Range
from mercator_design.missions.floor import ColourName, rgb
from mercator_design.missions.floor_kernels import colours_at
from mercator_design.missions.trace import Trace

ObjectiveFunction: TypeAlias = Callable[..., float]

OBJECTIVES: dict[str, ObjectiveFunction] = {}


def objective(function: ObjectiveFunction) -> ObjectiveFunction:
    """Enter a function in OBJECTIVES under its name."""
    OBJECTIVES[function.__name__] = function
    return function


class _ZoneReference:
    """Marks a parameter that names zones of the floor; a mission refuses names its floor does not have."""


Zones: TypeAlias = Annotated[tuple[str, ...], Length(1), _ZoneReference()]
When: TypeAlias = Literal["end", "always"]
Value: TypeAlias = Annotated[float, Range(-1e6, 1e6)]


def zone_parameters(function: ObjectiveFunction) -> list[str]:
    """The parameters of an objective that name zones."""
    annotations: dict[str, Any] = function.__annotations__
    return [
        name
        for name, kind in annotations.items()
        if any(isinstance(extra, _ZoneReference) for extra in getattr(kind, "__metadata__", ()))
    ]


@objective
def robots_in_zone(trace: Trace, *, zones: Zones, when: When = "end") -> float:
    """Robots in any of the zones: at the end, or summed over all cycles."""
    positions = trace.final_positions if when == "end" else trace.positions
    return float(np.sum(trace.inside(zones, positions)))


@objective
def color_value(trace: Trace, *, values: Annotated[Mapping[ColourName, Value], Length(1)], when: When = "end") -> float:
    """The value of the floor's colour under each robot, summed; a colour without value counts 0."""
    positions = trace.final_positions if when == "end" else trace.positions
    colors = colours_at(trace.floor, positions)
    return float(sum(value * np.sum(np.all(colors == rgb(name), axis=-1)) for name, value in values.items()))


@objective
def cell_age(
    trace: Trace, *, side: Annotated[float, Range(0.01, 1000.0)], cells: Annotated[int, Range(1, 500)]
) -> float:
    """How long the cells of a grid stay unvisited: the mean cell's age, summed over cycles; a cost.

    `cells` x `cells` of them cover a square of `side` metres around the origin. In each cycle the ages of
    visited cells become 0, ages are added up, and then each grows by 1 (GridExplorationLoopFunc in ARGoS).

    Between two visits g cycles apart a cell costs 0 + 1 + ... + (g - 1), so the times of visits are enough.
    """
    x = cells * (trace.positions[..., 0] / side + 0.5)
    y = cells * (trace.positions[..., 1] / side + 0.5)
    on_grid = (x > -1.0) & (x < cells) & (y > -1.0) & (y < cells)  # truncated: up to a cell beyond is cell 0
    cell = np.trunc(y[on_grid]) * cells + np.trunc(x[on_grid])
    cycle = np.nonzero(on_grid)[0]
    length = trace.cycles + 1
    starts = np.arange(0, cells * cells * length, length)  # ages begin at 0, as after a visit,
    ends = starts + trace.cycles  # and the last gap ends with the experiment
    visits = cell.astype(np.int64) * length + cycle
    gaps = np.diff(np.sort(np.concatenate([starts, visits, ends])))  # 1 from a cell's end to the next's start
    return float(np.sum(gaps * (gaps - 1) // 2) / (cells * cells))


@objective
def trips(trace: Trace, *, sources: Zones, nests: Zones) -> float:
    """Foraging: how often a robot that was on a source came to a nest; it carries one thing at a time.

    A robot on both at once is on the source.
    """
    source, nest, start = 1, 2, 3
    places = np.where(trace.inside(sources, trace.positions), source, 0)
    places[(places == 0) & trace.inside(nests, trace.positions)] = nest
    histories = np.vstack([np.full(trace.robots, start), places]).T.ravel()  # one robot's after another's
    visits = histories[histories > 0]
    return float(np.sum((visits[:-1] == source) & (visits[1:] == nest)))
