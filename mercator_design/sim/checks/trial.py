"""Tries a module on its whole domain: in plain Python, as robots run it, and compiled, as the simulator does."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, NamedTuple, cast, get_type_hints

import numpy as np

from mercator_design.compiling.kernel_sources import origins
from mercator_design.config.schema import Range
from mercator_design.errors import FsmError, Signalled, described, excerpt
from mercator_design.jit import compiled, jit_wanted, marked
from mercator_design.modules.behaviours import behave
from mercator_design.modules.conditions import probability
from mercator_design.modules.flavour import Flavour
from mercator_design.modules.module import KnownSwarm, Module, ModuleParameter
from mercator_design.modules.perception import MutableRow, Row
from mercator_design.modules.reference import (
    ACTIONS,
    LED_COLOURS,
    MAX_SIGNAL,
    SCRATCH,
    Actions,
    Readings,
    ReferenceModel,
    sense_of,
)
from mercator_design.plugins.places import first_line, line_of, reporting_kernels
from mercator_design.plugins.registries import is_ours
from mercator_design.system.interruptions import processor_limit

CYCLES = 25
"""Control cycles in a row with the same parameters, in which a module's memory is kept."""
SETTINGS = 80
"""Settings of the parameters: their bounds, and random ones between."""
MAX_CALL_TIME = 10.0
"""[s] of the processor's time that a call may take."""
_MAX_BOUNDS = 32
_REFUSED = {
    "numpy": "robots have no NumPy: use math",
    "random": "then no run can be repeated: use u, the random number of the cycle",
    "time": "then no run can be repeated: count cycles in memory",
}
"""Packages that a module must not use, even if it can be compiled, and what to do instead."""

DOMAINS: dict[str, Range] = {
    field: hint.__metadata__[0] for field, hint in get_type_hints(Readings, include_extras=True).items()
}
"""The range of each field of Readings."""


class _Call(NamedTuple):
    """What a module was called with."""

    parameters: tuple[float, ...]
    readings: Readings
    u: float

    def words(self, module: Module) -> str:
        """What matters of it, in words."""
        named = dict(zip((one.name for one in module.parameters), self.parameters, strict=True))
        if module.kind == "behaviour":
            named["u"] = self.u
        unusual = {
            name: value for name, value in self.readings._asdict().items() if value != Readings()._asdict()[name]
        }
        return ", ".join(f"{name}={value:.6g}" for name, value in (named | unusual).items()) or "nothing perceived"


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """How a module was tried, and what was found."""

    module: Module
    calls: int
    is_compiled: bool  # whether it was also tried in its compiled form
    problems: tuple[str, ...]  # each with the place
    notes: tuple[str, ...]


class _Watched:
    """Readings that note which senses are read."""

    __slots__ = ("_readings", "_seen")

    def __init__(self, readings: Readings, seen: set[str]) -> None:
        self._readings, self._seen = readings, seen

    def __getattr__(self, name: str) -> float:
        value = cast("float", getattr(self._readings, name))
        self._seen.add(sense_of(name))
        return value

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _Watched.__slots__:
            raise AttributeError(f"readings cannot be changed, such as {name}")
        object.__setattr__(self, name, value)

    def __getitem__(self, place: int) -> float:
        return cast("float", getattr(self, Readings._fields[place]))

    def __iter__(self) -> Iterator[float]:
        return (cast("float", getattr(self, name)) for name in Readings._fields)


def _behaving(
    which: int,
    model: ReferenceModel,
    readings: Readings,
    parameters: Row,
    memory: MutableRow,
    u: float,
    out: MutableRow,
) -> None:
    behave(which, model, readings, parameters, memory, u, out)


def _probable(
    which: int, model: ReferenceModel, readings: Readings, parameters: Row, memory: MutableRow, out: MutableRow
) -> None:
    probability(which, model, readings, parameters, memory, out)


def try_flavour(flavour: Flavour, model: ReferenceModel | None = None, *, own_only: bool = False) -> Iterator[Trial]:
    """Try the modules of a flavour.

    Args:
        flavour: The flavour.
        model: The robot's constants.
        own_only: Whether to try only those of plugins.

    Raises:
        FsmError: A module cannot be compiled; with file, line and what to write instead.
    """
    for module in flavour.modules:
        if not (own_only and is_ours(module.function)):
            yield try_module(module, flavour.reference_model(model or ReferenceModel()))


def refuse_wrong(flavour: Flavour, model: ReferenceModel) -> None:
    """Try the modules of plugins in a flavour, before a race.

    Raises:
        FsmError: One cannot be compiled, or was found wrong.
    """
    problems = [problem for trial in try_flavour(flavour, model, own_only=True) for problem in trial.problems]
    if problems:
        raise FsmError(*problems)


def try_module(module: Module, model: ReferenceModel) -> Trial:
    """Try a module on bounds and random points of its parameters and of what robots may perceive.

    Raises:
        FsmError: It cannot be compiled.
    """
    seen: set[str] = set()
    problems: dict[str, str] = {}  # by what is wrong: the first case of each
    calls = 0
    place = first_line(module.function)
    what = f"{module.kind} {module.name}"
    if refused := sorted(origins(module.function, marked()) & {*_REFUSED}):
        banned = tuple(f"{place}{what}: uses {name}; {_REFUSED[name]}" for name in refused)
        return Trial(module=module, calls=0, is_compiled=False, problems=banned, notes=())
    if endless := _endless(module, model):
        return Trial(module=module, calls=1, is_compiled=False, problems=(f"{place}{what}: {endless}",), notes=())
    with reporting_kernels({module.call: f"{what} (it declares memory={module.memory})"}, FsmError):
        fast = _compiled_calls(module, model) if jit_wanted() else None
    random = Random(module.name)
    for parameters in _settings(module.parameters, random):
        rows = [array_of(module.memory) for _ in range(2)]
        for _ in range(CYCLES):
            call = _Call(parameters, random_readings(random), random.choice((0.0, random.random(), 1.0 - 2.0**-53)))
            calls += 1
            try:
                with processor_limit(MAX_CALL_TIME):
                    plain = _plain(module, model, call, rows[0], seen)
                    _try_others(module, model, call)
            except (KeyboardInterrupt, Signalled):
                raise
            except BaseException as error:  # noqa: BLE001 - whatever a user's function raises, also by exit()
                kept = f" (it declares memory={module.memory})" * isinstance(error, IndexError)
                problems.setdefault(
                    "raises", f"{line_of(error) or place}{what}: {described(error)}{kept}, for {call.words(module)}"
                )
                break
            for kind, words in _wrong(module, call, plain, rows[0]):
                problems.setdefault(kind, f"{place}{what}: {words}, for {call.words(module)}")
            if fast is not None and not problems:
                with reporting_kernels({module.call: what}, FsmError):
                    found = fast(call, rows[1])
                if (found, rows[1].tolist()) != (plain, rows[0].tolist()):
                    problems.setdefault(
                        "differs", f"{place}{what}: {_difference(plain, found, rows)}, for {call.words(module)}"
                    )
        if problems:
            break
    if undeclared := sorted(seen - module.reads):
        problems["reads"] = (
            f"{place}{what}: reads {', '.join(undeclared)}, which it does not declare: "
            f"reads={{{_quoted({*undeclared, *module.reads})}}}"
        )
    unread = sorted(module.reads - seen) if not problems else []
    notes = [f"{place}{what}: declares {', '.join(unread)} in `reads`, and never read it"] if unread else []
    return Trial(
        module=module, calls=calls, is_compiled=fast is not None, problems=tuple(problems.values()), notes=tuple(notes)
    )


def _endless(module: Module, model: ReferenceModel) -> str:
    """What is wrong if a first call does not end, which compiled code could not report; empty if it ends."""
    try:
        with processor_limit(MAX_CALL_TIME):
            _plain(module, model, _middle(module), array_of(module.memory), set())
    except TimeoutError as error:
        return described(error)
    except (KeyboardInterrupt, Signalled):
        raise
    except BaseException:  # noqa: BLE001 - it is found again, and reported
        return ""
    return ""


def _try_others(module: Module, model: ReferenceModel, call: _Call) -> None:
    """Call what goes with a module: its words, and its test of failure in trees."""
    if module.words is not None:
        found: object = module.words(KnownSwarm(0.1, model=model), *call.parameters)
        if not isinstance(found, str):
            raise TypeError(f"expected a text of its words, found {excerpt(repr(found))}")
    if module.fails is not None:
        found = module.fails(model, call.readings, *call.parameters)
        if not isinstance(found, (bool, int)):
            raise TypeError(f"expected True or False of what its argument `fails` is, found {excerpt(repr(found))}")


def _difference(plain: Sequence[float], fast: Sequence[float], rows: Sequence[Any]) -> str:
    """How the compiled form differs from plain Python."""
    plain_memory, fast_memory = (row.tolist() for row in rows)
    found = [f"{list(plain)} in plain Python and {list(fast)} compiled"] * (tuple(plain) != tuple(fast))
    found += [f"memory {plain_memory} in plain Python and {fast_memory} compiled"] * (plain_memory != fast_memory)
    return (
        f"expected the same in both forms, found {'; '.join(found)}; write math.sqrt(x * x + y * y) instead of "
        "math.hypot(x, y), and read no global that changes"
    )


def _quoted(names: set[str]) -> str:
    return ", ".join(f'"{name}"' for name in sorted(names))


def array_of(memory: int) -> Any:  # noqa: ANN401 - an array
    """A row of so many numbers, zero."""
    return np.zeros(memory)


def _plain(module: Module, model: ReferenceModel, call: _Call, row: Any, seen: set[str]) -> tuple[float, ...]:  # noqa: ANN401 - an array
    """What a module returns in plain Python."""
    memory = [*row.tolist()]
    readings = cast("Readings", _Watched(call.readings, seen))
    if module.kind == "behaviour":
        actions = module.function(model, readings, memory, call.u, *call.parameters)
        if not isinstance(actions, Actions):
            raise TypeError(f"expected Actions, as drive(left, right) makes them, found {excerpt(repr(actions))}")
        found = tuple(actions)
    else:
        found = (module.function(model, readings, memory, *call.parameters),)
    row[:] = memory
    return found


def _wrong(
    module: Module,
    call: _Call,
    found: Sequence[float],
    memory: Any,  # noqa: ANN401 - an array
) -> Iterator[tuple[str, str]]:
    """What is wrong with what a module returns, and with what it keeps."""
    if not all(isinstance(value, (int, float)) and math.isfinite(value) for value in found):
        yield "finite", f"expected finite numbers, found {list(found)}"
        return
    if not np.isfinite(memory).all():
        yield "memory", f"expected finite numbers in its memory, found {memory.tolist()}"
    if module.kind == "condition":
        if not 0.0 <= found[0] <= 1.0:
            yield "probability", f"expected a probability from 0 to 1, found {found[0]:.6g}"
        elif module.has_beta and found[0] not in {0.0, call.parameters[0]}:
            yield (
                "beta",
                f"expected 0 or beta, as a parameter of this name is the probability where a condition holds, found "
                f"{found[0]:.6g}; call the parameter otherwise",
            )
        return
    actions = Actions(*found)
    for name in ("left", "right"):
        if not -1.0 <= getattr(actions, name) <= 1.0:
            yield "wheels", f"expected wheels from -1 to 1, found {name} {getattr(actions, name):.6g}"
    if actions.led_colour not in range(-1, len(LED_COLOURS)):
        yield "led", f"expected an LED colour from -1 to {len(LED_COLOURS) - 1}, found {actions.led_colour:.6g}"
    if actions.signal not in range(MAX_SIGNAL + 1):
        yield "signal", f"expected a signal from 0 to {MAX_SIGNAL}, found {actions.signal:.6g}"
    for output, is_set in (("led_colour", actions.led_colour != -1.0), ("signal", actions.signal != 0.0)):
        if is_set and output not in module.sets:
            declared = _quoted({output, *module.sets})
            yield output, f"sets {output}, which it does not declare: sets={{{declared}}}"


def _compiled_calls(module: Module, model: ReferenceModel) -> Callable[[_Call, Any], tuple[float, ...]]:
    """Calls of the compiled form; the first one, which compiles it, has been made."""
    is_behaviour = module.kind == "behaviour"
    entry: Any = compiled(_behaving if is_behaviour else _probable)

    def call(given: _Call, memory: Any) -> tuple[float, ...]:  # noqa: ANN401 - an array
        out = np.zeros(ACTIONS)
        out[2] = -1.0
        draw = (given.u,) * is_behaviour
        entry(module.position, model, given.readings, np.array(given.parameters), memory, *draw, out)
        return tuple(out[: SCRATCH if is_behaviour else 1].tolist())

    call(_middle(module), array_of(module.memory))
    return call


def _middle(module: Module) -> _Call:
    """A call with nothing perceived and parameters in the middle of their domains."""
    return _Call(tuple(0.5 * (one.low + one.high) for one in module.parameters), Readings(), 0.5)


def _settings(parameters: Sequence[ModuleParameter], random: Random) -> Iterator[tuple[float, ...]]:
    """All combinations of bounds, if they are not too many, and random points between."""
    bounds = itertools.islice(itertools.product(*((one.low, one.high) for one in parameters)), _MAX_BOUNDS)
    yield from (tuple(map(float, each)) for each in bounds)
    for _ in range(SETTINGS):
        values = [random.uniform(one.low, one.high) for one in parameters]
        yield tuple(
            float(round(value) if one.integer else value) for one, value in zip(parameters, values, strict=True)
        )


def random_readings(random: Random) -> Readings:
    """With nothing, something and much perceived, on all colours."""
    length, angle = random.choice((0.0, random.random(), 1.0)), random.uniform(-math.pi, math.pi)
    light, to_light = random.choice((0.0, 1.0)), random.choice((0.0, math.pi, random.uniform(-math.pi, math.pi)))
    n = random.choice((0, random.randrange(1, 20)))
    pull = [random.choice((random.uniform(-3.0, 3.0), random.uniform(-1e6, 1e6))) * n for _ in range(2)]
    colour = [random.choice((0.0, 127.5, 255.0, random.uniform(0.0, 255.0))) for _ in range(3)]
    neutral = Readings()._asdict()
    others = {
        field: random.choice((neutral[field], domain.low, domain.high, random.uniform(domain.low, domain.high)))
        for field, domain in DOMAINS.items()
    }
    return Readings(**others)._replace(
        proximity_x=length * math.cos(angle),
        proximity_y=length * math.sin(angle),
        neighbours=float(n),
        neighbours_x=pull[0],
        neighbours_y=pull[1],
        ground_red=colour[0],
        ground_green=colour[1],
        ground_blue=colour[2],
        light_x=light * math.cos(to_light),
        light_y=light * math.sin(to_light),
    )
