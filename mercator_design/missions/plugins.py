"""Objectives and dynamics, which missions refer to by name, and how plugins add more.

An objective is a function `f(trace, *, parameters...) -> float` marked `@objective`. A dynamic, which changes a floor,
is a function `f(site, *, parameters...) -> rows of numbers` marked `@dynamic(change=kernel)`. The keyword-only
parameters are keys of a mission file beside `name`; their annotations are checked when the file is read.

The functions in the packages objectives/ and dynamics/ are found automatically. `load_plugin` adds those of a user's
file; plugin_files.py finds the modules that belong to it.
"""

import contextlib
import importlib
import inspect
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, overload

import numpy as np

from mercator_design import jit
from mercator_design.arrays import Floats
from mercator_design.config.loading import check_parameter
from mercator_design.config.schema import FieldError, Length, parameters_of
from mercator_design.errors import MissionError, described
from mercator_design.missions.plugin_files import IMPORTER, Plugin, offer, read_plugin
from mercator_design.system.interruptions import signals_first

Score: TypeAlias = Callable[..., float]
Rows: TypeAlias = Callable[..., list[tuple[float, ...]]]
Check: TypeAlias = Callable[..., Iterator[FieldError]]
Limits: TypeAlias = Callable[..., tuple[float, float]]
Change: TypeAlias = Callable[[Any, Floats, Floats, float], None]

OBJECTIVES: dict[str, Score] = {}
DYNAMICS: dict[str, Rows] = {}
CHANGES: list[Change] = []
"""The kernels of DYNAMICS."""

OF_A_PLUGIN = "one of a plugin: give its file with --plugin FILE.py, or call load_plugin(FILE) first"
"""The last item of a list of objectives or dynamics."""

_PACKAGE = Path(__file__).parents[1]
_PLAIN = inspect.Parameter.POSITIONAL_OR_KEYWORD

_change_of: dict[str, int] = {}  # name in DYNAMICS -> number of its kernel in CHANGES
_loaded: dict[str, Plugin] = {}  # by name
_loading = threading.RLock()
_refusal: list[str] = []  # why no more are run; empty while they are


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


def _load_shipped() -> None:
    """Enter the objectives and dynamics of this package: their names are taken, and their kernels come first."""
    for shipped in ("objectives", "dynamics"):
        importlib.import_module(f"mercator_design.missions.{shipped}")


def is_ours(function: Callable[..., Any]) -> bool:
    """Whether a function is of this package, not of a plugin."""
    return _module_of(function).startswith("mercator_design.")


def _module_of(function: Callable[..., Any]) -> str:
    """The name of a function's module; empty for a function from a text without a name."""
    return function.__module__ or ""


def is_by_zones(function: Score) -> bool:
    """Whether the score depends only on which robots are in each zone."""
    return bool(getattr(function, "BY_ZONES", False))


def limits_of(function: Score) -> Limits | None:
    """The function that gives the limits of an objective's scores, if it has one."""
    found: Limits | None = getattr(function, "LIMITS", None)
    return found


def first_line(function: Callable[..., Any]) -> str:
    """The first line of a function of a plugin, as "my.py:7: "; empty for one of this package."""
    code = function.__code__
    return "" if is_ours(function) else f"{code.co_filename}:{code.co_firstlineno}: "


def line_of(error: BaseException) -> str:
    """The line of a plugin where an error occurred, as "my.py:7: "; empty if it occurred elsewhere."""
    frames = [(frame.filename, frame.lineno or 0) for frame in traceback.extract_tb(error.__traceback__)]
    return last_line(frames)


def last_line(places: Iterable[tuple[str, int]]) -> str:
    """The last place, file and line, that is in a plugin, as "my.py:7: "; empty if there is none."""
    functions = {*OBJECTIVES.values(), *DYNAMICS.values(), *jit.marked()}
    files = {Path(each.__code__.co_filename).resolve() for each in functions if not is_ours(each)}
    by_name = {file.name: file for file in files}
    reached = [(Path(file).resolve(), line) for file, line in places]
    found = [(file, line) for file, line in reached if file in files]
    # Compiled code from the cache names the file that it was compiled from, which may be a copy of the plugin.
    found = found or [
        (by_name[file.name], line)
        for file, line in reached
        if file.name in by_name and not file.is_relative_to(_PACKAGE) and "site-packages" not in file.parts
    ]
    return f"{found[-1][0]}:{found[-1][1]}: " if found else ""


@contextlib.contextmanager
def reporting_kernels(dynamics: Collection[str]) -> Iterator[None]:
    """Turn errors of these dynamics' kernels, if they are of plugins, into MissionErrors that name the line."""
    try:
        yield
    except jit.CompilationError as error:
        found = next((error.others[kernel] for kernel in _kernels(dynamics) if kernel in error.others), error)
        place = last_line(found.places)
        if not place:  # then it is our fault
            raise
        raise MissionError(f"{place}a kernel that cannot be compiled: {found}") from None
    except Exception as error:
        place = line_of(error) or _first_lines(error, _kernels(dynamics))
        if not place:  # of no plugin's kernel
            raise
        raise MissionError(f"{place}floor dynamic: {described(error)}") from error


def _kernels(dynamics: Collection[str]) -> list[Change]:
    return [CHANGES[_change_of[name]] for name in dynamics if name in _change_of]


def _first_lines(error: Exception, kernels: Collection[Change]) -> str:
    """Where plugins' kernels begin, if one of them failed: of an index or a division, compiled code tells no line."""
    is_compiled = traceback.extract_tb(error.__traceback__)[-1].filename == jit.__file__
    if not (is_compiled and isinstance(error, (IndexError, ZeroDivisionError))):
        return ""
    lines = [first_line(kernel) for kernel in kernels if not is_ours(kernel)]
    if len(lines) < 2:
        return "".join(lines)
    return f"one of {', '.join(line.removesuffix(': ') for line in lines)}: "


def change_of(name: str) -> int:
    """The number in CHANGES of a dynamic's kernel."""
    return _change_of[name]


def _enter(registry: dict[str, Callable[..., Any]], function: Callable[..., Any], what: str) -> None:
    if not is_ours(function):
        _load_shipped()
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


def loaded_plugins() -> dict[str, str]:
    """The names and digests of the plugins loaded so far."""
    return {plugin.name: plugin.digest for plugin in _loaded.values()}


def plugins() -> tuple[Plugin, ...]:
    """The plugins loaded so far, in the order of loading."""
    return tuple(_loaded.values())


def load_plugin(path: str | Path, digest: str | None = None) -> None:
    """Run a Python file that defines objectives or floor dynamics; a second time, or a copy of it, does nothing.

    Args:
        path: The file. The modules of its folder that it imports belong to it.
        digest: The digest that the plugin must have; otherwise it is not run.

    Raises:
        MissionError: if it cannot be read or run, has another digest, or defines nothing or a name that is taken.
    """
    plugin = read_plugin(Path(path))
    if digest not in {None, plugin.digest}:
        raise MissionError(f"{path}: expected a plugin of digest {digest}, found {plugin.digest}; it was not run")
    run_plugin(plugin, str(path))


def run_plugin(plugin: Plugin, label: str = "") -> None:
    """As `load_plugin`, from sources that were read, here or in another process; errors name `label`, or its file."""
    label = label or str(plugin.file)
    with _loading:
        _load_shipped()
        namesake = _loaded.get(plugin.name)
        if namesake is not None and namesake.digest == plugin.digest:
            return
        if _refusal:
            raise MissionError(f"{plugin.name}: {_refusal[0]}")
        if namesake is not None:
            another = f"another plugin of that name (digest {namesake.digest}, not {plugin.digest}) is loaded already"
            raise MissionError(f"{label}: {another}; start this process anew, or give the plugin another name")
        others = {path: source for other in _loaded.values() for path, source in other.files.items()}
        for path, source in plugin.files.items():
            if others.get(path, source) != source:  # a run folder has one file of a name
                raise MissionError(f"{label}: its file {path} differs from that of another plugin with the same name")
        before = {**OBJECTIVES, **DYNAMICS}
        with contextlib.ExitStack() as undo:
            undo.callback(snapshot())
            offer(plugin)
            _run(plugin, label)
            if before == {**OBJECTIVES, **DYNAMICS}:
                raise MissionError(f"{label}: a plugin that defines neither an @objective nor a @dynamic")
            undo.pop_all()
        _loaded[plugin.name] = plugin


def refuse_more(why: str) -> None:
    """Run no more plugins in this process: from now on, those not loaded yet raise a MissionError with this reason."""
    _refusal[:] = [why]


def snapshot() -> Callable[[], None]:
    """A function that restores the present state of everything that plugins define."""
    registries: list[dict[Any, Any]] = [OBJECTIVES, DYNAMICS, _change_of, _loaded, IMPORTER.paths, IMPORTER.sources]
    entries, changes, marked, modules = [{**each} for each in registries], [*CHANGES], jit.marked(), {*sys.modules}

    def restore() -> None:
        defined = {*OBJECTIVES.values(), *DYNAMICS.values()} - {*entries[0].values(), *entries[1].values()}
        foreign = [each for each in {*(jit.marked() - marked), *defined} if not is_ours(each)]
        jit.forget(foreign)
        own = {*IMPORTER.paths}
        for registry, entry in zip(registries, entries, strict=True):
            registry.clear()
            registry.update(entry)
        CHANGES[:] = changes
        # A module that stays imported would not define its functions again.
        packages = {_module_of(each).partition(".")[0] for each in foreign}
        for name in {*sys.modules} - modules:
            if name.partition(".")[0] in packages or name in own:
                del sys.modules[name]

    return restore


def _run(plugin: Plugin, label: str) -> None:
    """Run a plugin's file as a module; a MissionError reports what it raises."""
    file = str(plugin.file)
    with signals_first():
        try:
            importlib.import_module(plugin.module_name)
        except BaseException as error:  # noqa: BLE001 - whatever it raises, also by sys.exit()
            lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
            line = lines[-1] if lines else getattr(error, "lineno", None)
            place = f"{label}:{line}" if line else label
            raise MissionError(f"{place}: a plugin that cannot be run: {described(error)}") from None
