"""Objectives and dynamics, which missions refer to by name, and how plugins add more.

An objective is a function `f(trace, *, parameters...) -> float` marked `@objective`. A dynamic, which changes a floor,
is a function `f(site, *, parameters...) -> rows of numbers` marked `@dynamic(change=kernel)`. The keyword-only
parameters are keys of a mission file beside `name`; their annotations are checked when the file is read.

The functions in the packages objectives/ and dynamics/ are found automatically; plugins (plugins/) add theirs.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, overload

import numpy as np

from mercator_design import jit
from mercator_design.arrays import Floats
from mercator_design.config.loading import check_parameter
from mercator_design.config.schema import FieldError, Length, parameters_of
from mercator_design.plugins.registries import Registry, is_ours, load_shipped, register

Score: TypeAlias = Callable[..., float]
Rows: TypeAlias = Callable[..., list[tuple[float, ...]]]
Check: TypeAlias = Callable[..., Iterator[FieldError]]
Limits: TypeAlias = Callable[..., tuple[float, float]]
Change: TypeAlias = Callable[[Any, Floats, Floats, float], None]

OBJECTIVES: dict[str, Score] = {}
DYNAMICS: dict[str, Rows] = {}
CHANGES: list[Change] = []
"""The kernels of DYNAMICS."""

OF_A_PLUGIN = "one of a plugin: give it with --plugin FILE.py, or call load_plugin(FILE) first"
"""The last item of a list of objectives or dynamics."""

_PLAIN = inspect.Parameter.POSITIONAL_OR_KEYWORD

_change_of: dict[str, int] = {}  # name in DYNAMICS -> number of its kernel in CHANGES

register(Registry(what="an @objective", table=OBJECTIVES, functions=OBJECTIVES.values))
register(Registry(what="a @dynamic", table=DYNAMICS, others=(CHANGES, _change_of), functions=DYNAMICS.values))


class ZoneReference:
    """Marks a parameter that names a zone; a mission refuses names that its floor does not have."""


Zone: TypeAlias = Annotated[str, ZoneReference()]
Zones: TypeAlias = Annotated[tuple[Zone, ...], Length(1)]
When: TypeAlias = Literal["end", "always"]


class Site(NamedTuple):
    """The inputs of a dynamic when an experiment begins."""

    zones: Floats  # (zones, 9) as in FloorTable
    rows: Mapping[str, tuple[int, ...]]  # name of a zone -> its rows in `zones`
    rng: np.random.Generator  # of this instance

    def of(self, zones: tuple[str, ...]) -> list[int]:
        """The rows of some zones."""
        return [row for zone in zones for row in self.rows[zone]]


@overload
def objective(function: Score) -> Score: ...


@overload
def objective(
    *, checks: tuple[Check, ...] = (), by_zones: bool = False, limits: Limits | None = None
) -> Callable[[Score], Score]: ...


def objective(
    function: Score | None = None,
    *,
    checks: tuple[Check, ...] = (),
    by_zones: bool = False,
    limits: Limits | None = None,
) -> Score | Callable[[Score], Score]:
    """Enter a function in OBJECTIVES under its name: `@objective`, or `@objective(...)`.

    Args:
        function: The function.
        checks: Checks of its parameters when a mission is read: functions from parameters of the same names to errors
            (see schema.check).
        by_zones: Whether the score depends only on which of the given zones each robot's centre is in, in each cycle.
        limits: The least and the largest possible score, infinite where there is no limit: a function of a `Size`, and
            of the parameters by their names (`**_` takes those that do not matter). [default: there are none]

    Raises:
        ValueError: if its name, or that of a parameter, is taken, or a parameter has no annotation.
    """

    def enter(function: Score) -> Score:
        _enter(OBJECTIVES, function, "an objective")
        function.CHECKS = checks  # type: ignore[attr-defined]  # where schema.problems looks
        function.BY_ZONES = by_zones  # type: ignore[attr-defined]
        function.LIMITS = limits  # type: ignore[attr-defined]
        return function

    return enter if function is None else enter(function)


def dynamic(*, change: Change) -> Callable[[Rows], Rows]:
    """Enter a function in DYNAMICS under its name.

    Args:
        change: A kernel (see jit.py), marked `@jittable`: `change(floor, table, poses, time)` is called once in each
            control cycle, after the robots have moved and before they sense. It changes `floor.zones` in place. `table`
            holds the rows that the marked function returned for this instance, and is the kernel's to write in; `poses`
            (robots, 3), only to read, are x, y [m], heading [rad]; `time` [s] has passed since the start. Colours that
            it paints must be among the function's parameters, annotated `Colour`: robots know of no others. It returns
            nothing.

    Raises:
        ValueError: as `objective`, and if the kernel is not marked or has other parameters.
    """

    def enter(function: Rows) -> Rows:
        if not jit.is_marked(change):
            raise ValueError(f"{function.__name__}: its change {change.__name__} is not marked @jittable")
        given = inspect.signature(change).parameters.values()
        if [(each.kind, each.default) for each in given] != [(_PLAIN, inspect.Parameter.empty)] * 4:
            expected = f"expected {change.__name__}(floor, table, poses, time), without defaults"
            raise ValueError(f"{function.__name__}: its change: {expected}")
        _enter(DYNAMICS, function, "a dynamic")
        if change not in CHANGES:
            CHANGES.append(change)
        _change_of[function.__name__] = CHANGES.index(change)
        return function

    return enter


def is_by_zones(function: Score) -> bool:
    """Whether the score depends only on which robots are in each zone."""
    return bool(getattr(function, "BY_ZONES", False))


def limits_of(function: Score) -> Limits | None:
    """The function that gives the limits of an objective's scores, if it has one."""
    found: Limits | None = getattr(function, "LIMITS", None)
    return found


def changes_of(dynamics: Iterable[str]) -> dict[Change, str]:
    """The kernels of dynamics, each with what it is."""
    return {CHANGES[_change_of[name]]: "floor dynamic" for name in dynamics if name in _change_of}


def change_of(name: str) -> int:
    """The number in CHANGES of a dynamic's kernel."""
    return _change_of[name]


def _enter(registry: dict[str, Callable[..., Any]], function: Callable[..., Any], what: str) -> None:
    if not is_ours(function):
        load_shipped()
    name = function.__name__
    first, *others = inspect.signature(function).parameters.values()
    for parameter in others:
        if parameter.kind is not parameter.KEYWORD_ONLY:
            raise ValueError(f"{name}: write `*,` behind {first.name}: a mission gives {parameter.name} by its name")
        if parameter.annotation is parameter.empty:
            raise ValueError(f"{name} does not say what its parameter {parameter.name} is: an annotation is missing")
    for key, (kind, default) in parameters_of(function).items():
        if key in {"name", "direction"}:
            raise ValueError(f"{name} has a parameter {key}, a key that means something else in missions")
        try:
            check_parameter(kind, default)
        except TypeError as wrong:
            raise ValueError(f"{name}: parameter {key}: {wrong}") from None
    if name in registry:
        where = registry[name].__code__.co_filename
        raise ValueError(f"{what} is called '{name}' already, in {where}")
    registry[name] = function
