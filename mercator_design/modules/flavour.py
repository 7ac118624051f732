"""Flavours: of which modules control software is made, by which numbers and within which limits.

A flavour is a YAML file. Shipped ones lie in scenarios/flavours/. Control software, texts and races refer to them by
name, and a process has one flavour of each name.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import mercator_design.modules.behaviours
import mercator_design.modules.conditions  # noqa: F401 - which enter the shipped modules
from mercator_design.config import shipped, spelling
from mercator_design.config.loading import parse
from mercator_design.config.schema import FieldError, Name, OneOf, Range, check, describe, fields_of, unwrapped
from mercator_design.config.writing import digest_of
from mercator_design.config.yaml_tree import FromFile
from mercator_design.errors import FsmError, excerpt
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, Module, ModuleParameter
from mercator_design.modules.reference import ReferenceModel
from mercator_design.plugins.registries import Registry, register
from mercator_design.system.files import small_text, text_of

DEFAULT_FLAVOUR = "watermelon"
_MAX_SIZE = 64 * 1024
_OF_ROBOTS = ("neighbour_memory", "neighbour_count_memory", "ground_vote_cycles")
"""Constants by which a robot has room for what it remembers: a robot model alone sets them."""

Number = Annotated[int, Range(0, 99)]
Limit = Annotated[int, Range(1, 16)]
Constant = Annotated[float, Range(-1e9, 1e9)]


class _Rules(NamedTuple):
    """The rules of an architecture for its flavours."""

    limits: Mapping[str, tuple[int, int]]  # the largest number of something: the usual one, and what may be given
    flags: Mapping[str, frozenset[str]]  # for each kind of its modules, letters that texts have for something else


_OF_TREES = frozenset({"n", "nchild", "nc", "a", "c"})
_RULES = {
    "pfsm": _Rules(
        {"states": (4, 16), "transitions": (4, 16)},
        {"behaviour": frozenset({"s", "n"}), "condition": frozenset({"n", "c"})},
    ),
    "tree": _Rules(
        {"branches": (4, 10), "conditions": (1, 9)},  # texts have at most 10 children of a node
        {"behaviour": _OF_TREES | {"p"}, "condition": _OF_TREES},
    ),
    "network": _Rules({"weight": (5, 16)}, {}),
}
"""The architectures; software/architectures.py has their functions."""


def _modules_exist(
    architecture: str, behaviours: Mapping[str, int] | None, conditions: Mapping[str, int] | None
) -> Iterator[FieldError]:
    for key, given, table in (
        ("behaviours", behaviours or {}, BEHAVIOURS),
        ("conditions", conditions or {}, CONDITIONS),
    ):
        kind = key.removesuffix("s")
        for name in given:
            if name not in table:
                near = spelling.nearest(name, table)
                hint = (
                    f"did you mean '{near}'?" if near else f"it is one of {', '.join(table)}, or of a plugin (--plugin)"
                )
                yield FieldError(f"{key}.{name}", f"no such {kind}; {hint}")
        numbers = [*given.values()]
        for name, number in given.items():
            first = next(one for one in given if given[one] == number)
            if numbers.count(number) > 1 and name != first:
                yield FieldError(f"{key}.{name}", f"expected a number of its own, found {number}, that of {first}")
        if given and kind not in _RULES[architecture].flags:
            yield FieldError(key, f"expected none, as a {architecture} has no modules, found {', '.join(given)}")
    if not behaviours and _RULES[architecture].flags:
        yield FieldError("behaviours", "expected one behaviour at least, found none")


def _parameters_are_told_apart(
    architecture: str, behaviours: Mapping[str, int] | None, conditions: Mapping[str, int] | None
) -> Iterator[FieldError]:
    for key, given, table in (("behaviours", behaviours, BEHAVIOURS), ("conditions", conditions, CONDITIONS)):
        taken = _RULES[architecture].flags.get(key.removesuffix("s"), frozenset())
        known: dict[str, tuple[str, ModuleParameter]] = {}
        for name in (name for name in given or {} if name in table):
            for one in table[name].parameters:
                other, same = known.setdefault(one.stem, (name, one))
                if one.flag in taken:
                    use = f"texts of a {architecture} have --{one.flag} for something else"
                    yield FieldError(f"{key}.{name}", f"parameter {one.name}: {use}; call it otherwise")
                if one != same:
                    found = f"the parameter {same.name} of {other} is called {one.stem} in races, too"
                    yield FieldError(f"{key}.{name}", f"parameter {one.name}: {found}; call one of them otherwise")


def _limits_are_known(architecture: str, limits: Mapping[str, int] | None) -> Iterator[FieldError]:
    known = _RULES[architecture].limits
    for name, value in (limits or {}).items():
        if name not in known:
            yield FieldError(f"limits.{name}", f"expected one of {', '.join(known)}")
        elif value > known[name][1]:
            yield FieldError(f"limits.{name}", f"expected an integer from 1 to {known[name][1]}, found {value}")


def _designed_are_modules(
    architecture: str,
    not_designed: tuple[str, ...],
    behaviours: Mapping[str, int] | None,
    conditions: Mapping[str, int] | None,
) -> Iterator[FieldError]:
    if not_designed and architecture != "tree":
        yield FieldError("not_designed", "expected none: only trees may have modules that are not designed with")
    for k, name in enumerate(not_designed):
        if name not in {**(behaviours or {}), **(conditions or {})}:
            expected = f"expected a behaviour or a condition of this flavour, found '{name}'"
            yield FieldError(f"not_designed[{k}]", expected)
    if behaviours and {*behaviours} <= {*not_designed}:
        yield FieldError("not_designed", "expected one behaviour at least that is designed, found none")
    if architecture == "tree" and {*(conditions or {})} <= {*not_designed}:
        yield FieldError("conditions", "expected one condition at least that trees are designed with, found none")


def _constants_are_valid(constants: Mapping[str, float] | None) -> Iterator[FieldError]:
    known = fields_of(ReferenceModel)
    for name, value in (constants or {}).items():
        if name not in known:
            near = spelling.nearest(name, known)
            hint = f"; did you mean '{near}'?" if near else ""
            yield FieldError(f"constants.{name}", f"expected a constant of the reference model{hint}")
            continue
        if name in _OF_ROBOTS:
            yield FieldError(f"constants.{name}", "expected this constant in the robot model: robots remember by it")
            continue
        kind, rules = known[name][0], unwrapped(known[name][0])[1]
        if not all(rule.allows(value) for rule in rules):
            yield FieldError(f"constants.{name}", f"expected {describe(kind)}, found {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Flavour(FromFile):
    """A flavour of control software."""

    KIND: ClassVar = "flavour"
    CHECKS: ClassVar = (
        _modules_exist,
        _parameters_are_told_apart,
        _designed_are_modules,
        _limits_are_known,
        _constants_are_valid,
    )

    schema: Literal[1] = 1  # version of this format
    name: Name  # by default the file's
    description: str = ""  # what it is, in a line
    architecture: Annotated[str, OneOf(tuple(_RULES))] = "pfsm"  # what its control software is
    limits: Mapping[str, Limit] | None = (
        None  # largest numbers: of states, transitions, branches (4 if not given), conditions (1), or a weight (5)
    )
    behaviours: Mapping[str, Number] | None = None  # name of each -> its number in texts
    conditions: Mapping[str, Number] | None = None  # the same of conditions
    not_designed: tuple[str, ...] = ()  # modules that texts of trees may have, but designs do not
    constants: Mapping[str, Constant] | None = None  # of the reference model, instead of the robot's

    def __post_init__(self) -> None:
        check(self)

    @property
    def is_shipped(self) -> bool:
        """Whether it comes with this package."""
        return self.name in shipped.flavours()

    def limit(self, name: str) -> int:
        """The largest number of something."""
        return (self.limits or {}).get(name, _RULES[self.architecture].limits[name][0])

    def check_module(self, place: str, kind: str, name: str, values: Sequence[float], *, any_domain: bool) -> None:
        """Check a behaviour or a condition of control software at a place.

        Raises:
            FsmError: It does not exist in this flavour, or a parameter is missing, superfluous, or as `check` says.
        """
        known = self.numbers_of(kind)
        if name not in known:
            raise FsmError(f"{place}: {self.name} has no {kind} {name!r}; it has {', '.join(known)}")
        parameters = (BEHAVIOURS if kind == "behaviour" else CONDITIONS)[name].parameters
        if len(values) != len(parameters):
            raise FsmError(f"{place}: {name} takes {len(parameters)} parameters, found {len(values)}")
        for parameter, value in zip(parameters, values, strict=True):
            parameter.check(place, name, value, any_domain=any_domain)

    def reserved_flags(self, kind: str) -> frozenset[str]:
        """Letters that its texts have for something else than parameters of its behaviours or conditions."""
        return _RULES[self.architecture].flags[kind]

    def numbered(self, kind: str) -> dict[int, Module]:
        """Its behaviours or conditions by their numbers, in order of number."""
        table = BEHAVIOURS if kind == "behaviour" else CONDITIONS
        numbers = self.numbers_of(kind)
        return {numbers[name]: table[name] for name in sorted(numbers, key=numbers.__getitem__)}

    def numbers_of(self, kind: str) -> Mapping[str, int]:
        """The numbers of its behaviours or conditions, by name."""
        return (self.behaviours if kind == "behaviour" else self.conditions) or {}

    def designed(self, kind: str) -> dict[int, Module]:
        """As `numbered`, of those that designs may have."""
        return {number: one for number, one in self.numbered(kind).items() if one.name not in self.not_designed}

    @property
    def modules(self) -> Iterator[Module]:
        """Its behaviours and conditions."""
        yield from self.numbered("behaviour").values()
        yield from self.numbered("condition").values()

    def reference_model(self, model: ReferenceModel) -> ReferenceModel:
        """A robot's reference model with the constants of this flavour."""
        return model._replace(**self.constants) if self.constants else model


_loaded: dict[str, Flavour] = {}  # by name
_loading = threading.RLock()


def flavour_names(architecture: str | None = None) -> tuple[str, ...]:
    """The names of the shipped flavours, and of those that were loaded; the default one comes first.

    Args:
        architecture: That of the flavours; by default all.
    """
    names = {DEFAULT_FLAVOUR: None, **dict.fromkeys(shipped.flavours()), **dict.fromkeys(_loaded)}
    return tuple(name for name in names if architecture in {None, flavour_of(name).architecture})


def flavour_of(name: str, architecture: str | None = None) -> Flavour:
    """The flavour of a name.

    Raises:
        FsmError: There is none, its file is not valid, or it is not of the given architecture.
    """
    with _loading:
        if name not in _loaded:
            files = shipped.flavours()
            if name not in files:
                raise FsmError(
                    f"flavour: expected one of {', '.join(flavour_names())}, found {excerpt(repr(name))}; another one "
                    "is given by its FILE.yaml, or with the plugin that has it (--plugin)"
                )
            _loaded[name] = flavour_from(files[name].read_text("utf-8"), str(files[name]))
        found = _loaded[name]
    if architecture not in {None, found.architecture}:
        known = ", ".join(flavour_names(architecture))
        raise FsmError(f"flavour: expected one of {architecture}s ({known}), found {excerpt(repr(name))}")
    return found


def other_flavour(flavour: str | None, architecture: str, read: Callable[[str], object]) -> str:
    """A hint on control software that cannot be read in its flavour, but in another; empty if it fits none."""
    for other in flavour_names(architecture):
        if other != flavour:
            with contextlib.suppress(FsmError):
                read(other)
                return f"; it fits the flavour {other}: give that flavour"
    return ""


def same_constants(one: str, other: str) -> bool:
    """Whether two flavours have the same constants of the reference model."""
    return (flavour_of(one).constants or {}) == (flavour_of(other).constants or {})


def load_flavour(name_or_path: str) -> Flavour:
    """A shipped flavour by its name, or one of a file, which from then on can be referred to by its name.

    Raises:
        FsmError: There is none, it is not valid, or another one of its name is loaded.
    """
    if not shipped.is_path(name_or_path):
        return flavour_of(name_or_path)
    return enter_flavour(read_flavour(Path(name_or_path)), name_or_path)


def enter_flavour(flavour: Flavour, label: str = "") -> Flavour:
    """Let a flavour be referred to by its name; `label` names it in errors.

    Raises:
        FsmError: Another one of its name is loaded.
    """
    with _loading:
        if flavour.name in shipped.flavours():
            known = flavour_of(flavour.name)
        else:
            known = _loaded.setdefault(flavour.name, flavour)
        if digest_of(known) != digest_of(flavour):
            raise FsmError(
                f"{label or flavour.name}: another flavour is called {flavour.name} already; change its name"
            )
        return known


def flavour_from(text: str, label: str) -> Flavour:
    """A flavour of the text of its file, without entering it; `label` names it in errors.

    Raises:
        FsmError: It is not valid.
    """
    return parse(text, Flavour, error=FsmError, label=label, files=False, defaults={"name": Path(label).stem})


def read_flavour(path: Path) -> Flavour:
    """A flavour of a file, without entering it; errors are those of `flavour_from`, and that it cannot be read."""
    return flavour_from(small_text(path, _MAX_SIZE, FsmError), str(path))


def define_flavour(text: str, name: str) -> Flavour:
    """Enter a flavour of the text of its file, as plugins do, under a name if the text has none.

    Raises:
        FsmError: It is not valid, or another one of its name is loaded.
    """
    return enter_flavour(flavour_from(text, name), name)


def _enter_file(data: bytes, label: str) -> None:
    enter_flavour(flavour_from(text_of(data, FsmError, label), label), label)


register(Registry(what="a flavour", table=_loaded, enter_file=_enter_file))
