"""Modules: behaviours and conditions, to which control software refers by name.

A module is one function, marked `@behaviour` or `@condition`, which is a kernel (see jit.py). Its signature says what
its parameters are, the comments behind them their units and meaning, its docstring what it does. The marks enter it in
BEHAVIOURS or CONDITIONS, of which texts, grammars, words, diagrams and tests are made. Flavours (flavour.py) say which
of them there are and by which numbers; plugins add more.
"""

import inspect
import math
import re
import typing
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple, TypeVar, cast

from mercator_design.config.schema import Range, comments_of, origin_of, sentence_of, unit_of
from mercator_design.errors import FsmError
from mercator_design.jit import jittable
from mercator_design.modules.perception import MutableRow, Row
from mercator_design.modules.reference import OUTPUTS, SENSES, Readings, ReferenceModel
from mercator_design.plugins.marks import check_functions, check_memory, check_set, check_texts
from mercator_design.plugins.registries import Registry, is_ours, load_shipped, register

MAX_PARAMETERS = 6
"""Largest number of parameters of a module."""

_FIRST = {"behaviour": ("model", "readings", "memory", "u"), "condition": ("model", "readings", "memory")}
"""Parameters of all functions of a kind; those of the module follow."""

F = TypeVar("F", bound=Callable[..., Any])


class Designed(NamedTuple):
    """Says of a parameter how it is designed, where that is not evenly from its lowest to its highest value."""

    low: float | None = None  # the lowest value that is designed, where a lower one is legal
    log: bool = False  # whether simple machines and moves draw it evenly over its logarithm


class Written(NamedTuple):
    """Says how a parameter is called in AutoMoDe's texts; by default by its own name."""

    flag: str  # letters of the command line: "rwm" in --rwm0
    stem: str  # begin of its name in the parameter file: "RWM" in RWM0


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleParameter:
    """A parameter of a module."""

    name: str
    flag: str  # see Written
    stem: str  # see Written
    low: float
    high: float
    integer: bool = False
    sampled_low: float | None = None  # see Designed.low
    log: bool = False  # see Designed
    labels: tuple[str, ...] = ()  # what the integers from 0 mean, if they are numbers of something

    @property
    def domain(self) -> str:
        """The domain as text: "an integer from 1 to 100", "an integer from 0 to 1 (green, blue)"."""
        words = f" ({', '.join(self.labels)})" * bool(self.labels)
        return f"{'an integer' if self.integer else 'a number'} from {self.low:g} to {self.high:g}{words}"

    @property
    def sampled(self) -> tuple[float, float]:
        """Bounds of what is designed."""
        return self.low if self.sampled_low is None else self.sampled_low, self.high

    def contains(self, value: float) -> bool:
        """Whether a value lies in the domain."""
        return self.low <= value <= self.high and (not self.integer or value == int(value))

    def check(self, place: str, of: str, value: float, *, any_domain: bool) -> None:
        """Check a value of this parameter `of` a module at a place.

        Raises:
            FsmError: It is not finite, or (unless `any_domain`) not in the domain.
        """
        if not math.isfinite(value) or not (any_domain or self.contains(value)):
            raise FsmError(f"{place}: parameter {self.name} of {of} must be {self.domain}, found {value:g}")


class KnownSwarm(NamedTuple):
    """Known facts about the robots that run control software."""

    cycle: float  # [s] control period
    robots: int | None = None  # how many; None if it is not known
    model: ReferenceModel = ReferenceModel()


@dataclass(frozen=True, kw_only=True)
class Module:
    """A behaviour or a condition."""

    name: str
    kind: Literal["behaviour", "condition"]
    function: Callable[..., Any]
    parameters: tuple[ModuleParameter, ...]
    reads: frozenset[str]  # of SENSES
    sets: frozenset[str]  # of OUTPUTS
    memory: int  # numbers that it keeps from cycle to cycle
    label: str  # as AutoMoDe's diagrams write it
    words: Callable[..., str] | None  # see `behaviour`
    position: int  # in BEHAVIOURS or CONDITIONS
    fails: Callable[..., bool] | None = None  # see `behaviour`
    failure: int = -1  # position in FAILURE_CALLS; -1: it never fails
    end_mark: bool = False  # see `behaviour`
    call: Callable[..., None] = field(init=False, repr=False, compare=False)
    """The kernel of one signature for all modules of a kind."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "call", jittable(_call(self)))

    def __reduce__(self) -> tuple[Callable[..., "Module"], tuple[str, str]]:
        return module_of, (self.kind, self.name)

    @property
    def sentence(self) -> str:
        """A sentence on its purpose, from its docstring."""
        return sentence_of(self.function)

    @cached_property
    def meanings(self) -> dict[str, str]:
        """The comments behind its parameters, by name."""
        return comments_of(self.function)

    def unit(self, parameter: str) -> str:
        """The unit of a parameter; empty if it has none."""
        return unit_of(self.function, parameter)

    def probability(self, model: ReferenceModel, readings: Readings, parameters: Sequence[float]) -> float:
        """The probability of a condition in its first cycle."""
        memory = [0.0] * self.memory
        return float(self.function(model, readings, memory, *parameters))

    @property
    def has_beta(self) -> bool:
        """Whether its first parameter is beta from 0 to 1: by agreement its probability wherever it is not 0."""
        return any((one.name, one.low, one.high) == ("beta", 0, 1) for one in self.parameters[:1])

    @property
    def needs_colours(self) -> bool:
        """Whether its last parameter is the label of a colour of the ground."""
        return self.labelled and "ground" in self.reads

    @property
    def labelled(self) -> bool:
        """Whether its last parameter is a number of a label."""
        return bool(self.parameters) and bool(self.parameters[-1].labels)


def _functions(table: Mapping[str, Module]) -> list[Callable[..., Any]]:
    return [module.function for module in table.values()]


BEHAVIOURS: dict[str, Module] = {}
CONDITIONS: dict[str, Module] = {}
"""The modules by name, in order of their positions: those of this package come first."""

Call = Callable[..., None]

BEHAVIOUR_CALLS: list[Call] = []
CONDITION_CALLS: list[Call] = []
"""Kernels of one signature for all modules, in order of their positions."""

FAILURE_CALLS: list[Call] = []
"""Kernels of one signature for the failure tests of behaviours."""

_TABLES = {"behaviour": (BEHAVIOURS, BEHAVIOUR_CALLS), "condition": (CONDITIONS, CONDITION_CALLS)}
for _kind, (_table, _calls) in _TABLES.items():
    register(
        Registry(
            what=f"a @{_kind}",
            table=_table,
            others=(_calls, FAILURE_CALLS),
            functions=partial(_functions, _table),
        )
    )


def module_of(kind: str, name: str) -> Module:
    """The module of a name."""
    return _TABLES[kind][0][name]


def behaviour(
    *,
    name: str = "",
    label: str = "",
    reads: Iterable[str] = (),
    sets: Iterable[str] = ("wheels",),
    memory: int = 0,
    words: Callable[..., str] | None = None,
    fails: Callable[..., bool] | None = None,
    end_mark: bool = False,
) -> Callable[[F], F]:
    """Enter a kernel `f(model, readings, memory, u, *parameters) -> Actions` in BEHAVIOURS, and return it unchanged.

    Args:
        name: Its name in files; by default that of the function, with blanks.
        label: As diagrams write it; by default the name.
        reads: The senses that it reads, of SENSES; all others have neutral readings.
        sets: The outputs that it sets, of OUTPUTS.
        memory: How many numbers it keeps from cycle to cycle: `memory[0]` and so on, zero when it begins.
        words: A function of (KnownSwarm, *parameters) that says what a robot does: "stands still". By default a
            sentence is made of the docstring.
        fails: A kernel `f(model, readings, *parameters) -> bool`: whether it fails instead of acting in a tree.
        end_mark: Whether a tree sets the last number of its memory to 1 where it succeeds or fails.

    Raises:
        ValueError: if the function, its parameters or these arguments are not as they should be.
    """
    return lambda function: _entered("behaviour", function, name, label, reads, sets, memory, words, fails, end_mark)


def condition(
    *,
    name: str = "",
    label: str = "",
    reads: Iterable[str] = (),
    memory: int = 0,
    words: Callable[..., str] | None = None,
) -> Callable[[F], F]:
    """Enter a kernel `f(model, readings, memory, *parameters) -> probability` in CONDITIONS, and return it unchanged.

    Arguments and errors are those of `behaviour`; `words` say with which probability the condition holds, and where.
    """
    return lambda function: _entered("condition", function, name, label, reads, (), memory, words)


def _entered(
    kind: Literal["behaviour", "condition"],
    function: F,
    name: str,
    label: str,
    reads: Iterable[str],
    sets: Iterable[str],
    memory: int,
    words: Callable[..., str] | None,
    fails: Callable[..., bool] | None = None,
    end_mark: bool = False,
) -> F:
    table, calls = _TABLES[kind]
    if not is_ours(function):
        load_shipped()
    name = name or function.__name__.replace("_", " ").strip()
    check_texts(name=name, label=label or name)
    check_functions(name, function, words=words, fails=fails)
    check_memory(name, memory, int(end_mark))
    for given, known, what in ((reads, SENSES, "senses"), (sets, OUTPUTS, "outputs")):
        if unknown := sorted({*map(str, check_set(given, f"{name}: {what}"))} - {*known}):
            raise ValueError(f"{name}: expected {what} of {', '.join(known)}, found {', '.join(unknown)}")
    if (taken := BEHAVIOURS.get(name) or CONDITIONS.get(name)) is not None:
        raise ValueError(f"a {taken.kind} is called '{name}' already, in {taken.function.__code__.co_filename}")
    module = Module(
        name=name,
        kind=kind,
        function=function,
        parameters=_parameters(kind, name, function),
        reads=frozenset(reads),
        sets=frozenset(sets),
        memory=memory,
        label=label or name,
        words=words,
        position=len(table),
        fails=fails,
        failure=len(FAILURE_CALLS) if fails else -1,
        end_mark=end_mark,
    )
    if fails:
        FAILURE_CALLS.append(jittable(_failure_call(module, jittable(fails))))
    calls.append(module.call)
    table[name] = module
    jittable(function)
    return function


def _parameters(kind: str, name: str, function: Callable[..., Any]) -> tuple[ModuleParameter, ...]:
    """The parameters of a module, from the signature of its function."""
    names = [*inspect.signature(function).parameters]
    first = _FIRST[kind]
    if tuple(names[: len(first)]) != first:
        raise ValueError(f"{name}: expected {function.__name__}({', '.join(first)}, ...), found ({', '.join(names)})")
    own = names[len(first) :]
    if len(own) > MAX_PARAMETERS:
        raise ValueError(f"{name}: expected at most {MAX_PARAMETERS} parameters, found {len(own)}")
    hints = typing.get_type_hints(function, include_extras=True)
    return tuple(_parameter(name, each, hints.get(each)) for each in own)


def _parameter(module: str, name: str, kind: Any) -> ModuleParameter:  # noqa: ANN401 - an annotation
    extras: Sequence[Any] = getattr(kind, "__metadata__", ())
    base = typing.get_args(kind)[0] if extras else kind
    token = next((one for one in extras if isinstance(one, Written)), Written(name, _stem(module, name)))
    designed = next((one for one in extras if isinstance(one, Designed)), Designed())
    if not re.fullmatch(r"[a-z]+", token.flag):
        raise ValueError(f"{module}: parameter {name}: expected a name of the letters a to z")
    labels: tuple[str, ...] = ()
    if origin_of(base) is Literal:
        labels, base = typing.get_args(base), int
        domain = Range(0, len(labels) - 1)
    else:
        domain = next((one for one in extras if isinstance(one, Range)), Range())
    is_known = base in {int, float} and all(isinstance(label, str) for label in labels)
    is_whole = base is float or all(bound == bound // 1 for bound in (domain.low, domain.high))
    if not (is_known and -1e9 <= domain.low < domain.high <= 1e9 and is_whole):
        raise ValueError(
            f"{module}: parameter {name}: expected Annotated[float, Range(lowest, highest)] with the lower bound "
            f"first, the same of int, or a Literal of words"
        )
    return ModuleParameter(
        name=name,
        flag=token.flag,
        stem=token.stem,
        low=domain.low,
        high=domain.high,
        integer=base is int,
        sampled_low=designed.low,
        log=designed.log,
        labels=labels,
    )


def _stem(module: str, parameter: str) -> str:
    return re.sub(r"[^A-Z0-9]", "", f"{module}{parameter}".upper())


_TAKEN: tuple[Callable[..., Any], ...] = (
    lambda _: (),
    lambda p: (p[0],),
    lambda p: (p[0], p[1]),
    lambda p: (p[0], p[1], p[2]),
    lambda p: (p[0], p[1], p[2], p[3]),
    lambda p: (p[0], p[1], p[2], p[3], p[4]),
    lambda p: (p[0], p[1], p[2], p[3], p[4], p[5]),
)
for _n, _take in enumerate(_TAKEN):
    _take.__qualname__ = _take.__name__ = f"first_{_n}"
    jittable(_take)


def like(**draw: float) -> tuple[Any, ...]:
    """Arguments of the types that compiled code passes to the kernels of modules."""
    row = memoryview(array("d", [0.0]))
    return ReferenceModel(), Readings(), row, row, *draw.values(), row


def _call(module: Module) -> Call:
    """The kernel that gives a module's function its parameters one by one, and stores what it returns."""
    function, taken = module.function, _TAKEN[len(module.parameters)]

    def call_behaviour(
        model: ReferenceModel,
        readings: Readings,
        parameters: Row,
        memory: MutableRow,
        u: float,
        actions: MutableRow,
    ) -> None:
        found = function(model, readings, memory, u, *taken(parameters))
        actions[0] = found.left
        actions[1] = found.right
        if found.led_colour != -1.0:
            actions[2] = found.led_colour
        actions[3] = found.signal

    def call_condition(
        model: ReferenceModel,
        readings: Readings,
        parameters: Row,
        memory: MutableRow,
        found: MutableRow,
    ) -> None:
        found[0] = function(model, readings, memory, *taken(parameters))

    call = call_behaviour if module.kind == "behaviour" else call_condition
    return _named(call, module.kind, module, function)


def _failure_call(module: Module, fails: Callable[..., bool]) -> Call:
    """The kernel that tells whether a behaviour fails, with a signature of all such kernels."""
    taken = _TAKEN[len(module.parameters)]

    def call_failure(model: ReferenceModel, readings: Readings, parameters: Row, found: MutableRow) -> None:
        found[0] = 1.0 if fails(model, readings, *taken(parameters)) else 0.0

    return _named(call_failure, "failure", module, fails)


def _named(call: Any, what: str, module: Module, function: Callable[..., Any]) -> Call:  # noqa: ANN401 - a function
    """A kernel with a name of its own, as compiled code links kernels by their names, and what it calls."""
    call.__qualname__ = call.__name__ = f"call_{what}_{re.sub(r'[^a-zA-Z0-9]', '_', module.name)}"
    call.calls = function
    return cast("Call", call)
