"""What a mission may name beyond its own words: objectives, and what changes a floor; and how more are added.

An objective is a function `f(trace, *, parameters...) -> float` marked `@objective`. What changes a floor is a function
`f(site, *, parameters...) -> rows of numbers` marked `@dynamic(change=kernel)`. The keyword-only parameters are what a
mission file may say beside `name`; their annotations are checked when the file is read.

The functions in the packages objectives/ and dynamics/ are found by being there. `load_plugin` adds those of a user's
own file, which need not be near this package.
"""

import hashlib
import importlib
import inspect
import sys
import traceback
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from mercator_design import jit
from mercator_design.errors import MissionError
from mercator_design.loading import Length
from mercator_design.missions.arena import Array
from mercator_design.schema import Kind, origin_of, parameters_of, unwrapped

OBJECTIVES: dict[str, Callable[..., float]] = {}
DYNAMICS: dict[str, Callable[..., "list[tuple[float, ...]]"]] = {}

Change: TypeAlias = Callable[[Any, Array, Array, float], None]

CHANGES: list[Change] = []
"""The kernels of DYNAMICS."""

_change_of: dict[str, int] = {}  # name in DYNAMICS -> number of its kernel in CHANGES
_loaded: dict[Path, str] = {}  # file -> digest


class _ZoneReference:
    """Marks what names a zone of the floor; a mission refuses names its floor does not have."""


Zone: TypeAlias = Annotated[str, _ZoneReference()]
Zones: TypeAlias = Annotated[tuple[Zone, ...], Length(1)]
When: TypeAlias = Literal["end", "always"]


class Site(NamedTuple):
    """What a dynamic may look at when an experiment begins."""

    zones: Array  # (zones, 9) as in FloorTable
    rows: Mapping[str, tuple[int, ...]]  # name of a zone -> its rows in `zones`
    rng: np.random.Generator  # of this instance

    def of(self, zones: tuple[str, ...]) -> list[int]:
        """The rows of some zones."""
        return [row for zone in zones for row in self.rows[zone]]


def objective(function: Callable[..., float]) -> Callable[..., float]:
    """Enter a function in OBJECTIVES under its name.

    Raises:
        ValueError: if its name, or that of a parameter, is taken, or a parameter has no annotation.
    """
    _enter(OBJECTIVES, function, "an objective")
    return function


def dynamic(
    *, change: Change
) -> Callable[[Callable[..., list[tuple[float, ...]]]], Callable[..., list[tuple[float, ...]]]]:
    """Enter a function in DYNAMICS under its name.

    Args:
        change: A kernel (see jit.py), marked `@jittable`: `change(floor, table, poses, time)` is called once in each
            control cycle, after the robots have moved and before they sense. It changes `floor.zones` in place. `table`
            holds the rows that the marked function returned for this instance, and is the kernel's to write in; `poses`
            (robots, 3) are x, y [m], heading [rad]; `time` [s] has passed since the start.

    Raises:
        ValueError: as `objective`, and if the kernel is not marked.
    """

    def enter(function: Callable[..., list[tuple[float, ...]]]) -> Callable[..., list[tuple[float, ...]]]:
        if not jit.is_marked(change):
            raise ValueError(f"{function.__name__}: its change {change.__name__} is not marked @jittable")
        _enter(DYNAMICS, function, "what changes a floor")
        if change not in CHANGES:
            CHANGES.append(change)
        _change_of[function.__name__] = CHANGES.index(change)
        return function

    return enter


def change_of(name: str) -> int:
    """The number in CHANGES of a dynamic's kernel."""
    return _change_of[name]


def _enter(registry: dict[str, Callable[..., Any]], function: Callable[..., Any], kind: str) -> None:
    name = function.__name__
    first, *others = inspect.signature(function).parameters.values()
    for parameter in others:
        if parameter.kind is not parameter.KEYWORD_ONLY:
            raise ValueError(f"{name}: write `*,` behind {first.name}: a mission gives {parameter.name} by its name")
        if parameter.annotation is parameter.empty:
            raise ValueError(f"{name} does not say what its parameter {parameter.name} is: an annotation is missing")
    taken = {"name", "direction"} & parameters_of(function).keys()
    if taken:
        raise ValueError(f"{name} has a parameter {taken.pop()}, a key that means something else in missions")
    if name in registry:
        where = sys.modules[registry[name].__module__].__file__
        raise ValueError(f"{kind} is called '{name}' already, in {where}")
    registry[name] = function


def zone_references(function: Callable[..., Any], parameters: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The zones that parameters name, each with its place among them, as ("zones[0]", "nest")."""
    for name, (kind, default) in parameters_of(function).items():
        yield from _references(kind, parameters.get(name, default), name)


def _references(kind: Kind, value: Any, path: str) -> Iterator[tuple[str, str]]:  # noqa: ANN401 - of that kind
    if any(isinstance(extra, _ZoneReference) for extra in getattr(kind, "__metadata__", ())):
        yield path, value
        return
    base, _ = unwrapped(kind)
    if origin_of(base) is tuple:
        for index, item in enumerate(value):
            yield from _references(typing.get_args(base)[0], item, f"{path}[{index}]")
    elif origin_of(base) is Mapping:
        for key, item in value.items():
            yield from _references(typing.get_args(base)[1], item, f"{path}.{key}")


def loaded_plugins() -> dict[str, str]:
    """The names of the files loaded so far, and digests of what is in them."""
    return {path.name: digest for path, digest in _loaded.items()}


def load_plugin(path: str | Path) -> None:
    """Run a Python file that defines objectives or floor dynamics; a second time does nothing.

    Raises:
        MissionError: if it cannot be read or run, defines nothing or a name that is taken, or brings kernels after
            the simulator was compiled.
    """
    file = Path(path).resolve()
    if file in _loaded:
        return
    try:
        source = file.read_bytes()
    except OSError as error:
        raise MissionError(f"{path}: a plugin that cannot be read: {error.strerror}") from None
    digest = hashlib.sha256(source).hexdigest()[:16]
    for shipped in ("objectives", "dynamics"):  # whose names are taken
        importlib.import_module(f"mercator_design.missions.{shipped}")
    if any(file.name == other.name for other in _loaded):
        raise MissionError(f"{path}: a plugin of that name is loaded already; give it another")
    objectives, dynamics, changes, marked = dict(OBJECTIVES), dict(DYNAMICS), len(CHANGES), jit.marked()
    problem = _run(source, file, path, digest)
    if problem is None and (objectives, dynamics) == (OBJECTIVES, DYNAMICS):
        problem = f"{path}: a plugin that defines neither an @objective nor a @dynamic"
    if problem is None and jit.marked() > marked and not jit.add_kernel_file(file):
        problem = f"{path}: a plugin with compiled code; load it before the first experiment of this process"
    if problem is not None:
        for registry, entries in ((OBJECTIVES, objectives), (DYNAMICS, dynamics)):
            for name in registry.keys() - entries.keys():
                del registry[name]
        del CHANGES[changes:]
        raise MissionError(problem)
    _loaded[file] = digest


def _run(source: bytes, file: Path, path: str | Path, digest: str) -> str | None:
    """Run a file as a module; what went wrong, if something did."""
    name = f"mercator_design_plugin_{digest}"
    module = types.ModuleType(name)
    module.__file__ = str(file)
    sys.modules[name] = module  # where typing and pickle look for what is in it
    try:
        exec(compile(source, str(file), "exec"), module.__dict__)  # noqa: S102 - the user's own file
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever it raises
        del sys.modules[name]
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(file)]
        line = lines[-1] if lines else getattr(error, "lineno", None)
        place = f"{path}:{line}" if line else str(path)
        return f"{place}: a plugin that cannot be run: {type(error).__name__}: {error}"
    return None
