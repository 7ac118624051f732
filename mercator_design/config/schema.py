"""Annotations of dataclass fields as a schema of YAML files, and their descriptions for users.

The rules are in `Annotated[type, rule]`. This module only reads annotations; config/loading.py applies them.
"""

import contextlib
import dataclasses
import functools
import inspect
import math
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol, TypeAlias, Union

from mercator_design.errors import ITEM

Kind: TypeAlias = Any
"""An annotation: a type, a union, Annotated, Literal, tuple[...], Mapping[...]."""

Specification: TypeAlias = dict[str, tuple[Kind, Any]]
"""Name -> (annotation, default or dataclasses.MISSING)."""


class FieldError(ValueError):
    """The error that a dataclass's `__post_init__` raises; `field` is the path from the dataclass, as `zones[1].name`.

    `others` are the other mistakes in the same dataclass.
    """

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.field, self.message = field, message
        self.others: tuple[FieldError, ...] = ()


def checked(errors: Iterable[FieldError]) -> None:
    """Raise all errors as one, if there are any."""
    found = [*errors]
    if not found:
        return
    first, *others = found
    first.others = tuple(others)
    for other in others:
        first.add_note(str(other))
    raise first


def check(record: Any) -> None:  # noqa: ANN401 - a dataclass with CHECKS
    """Run the CHECKS of a dataclass; its `__post_init__` calls this.

    CHECKS are functions from some of its fields, with parameters of the same names, to mistakes. A check runs if these
    fields are valid, so all mistakes of a file are reported at once.
    """
    kind: Kind = type(record)
    checked(problems(kind, {name: getattr(record, name) for name in fields_of(kind)}))


def problems(kind: Kind, values: Mapping[str, Any]) -> "Iterator[FieldError]":
    """The mistakes found by those CHECKS of a dataclass that need only the given fields."""
    for each in getattr(kind, "CHECKS", ()):
        needed = inspect.signature(each).parameters.keys()
        if needed <= values.keys():
            yield from each(**{name: values[name] for name in needed})


class Rule(Protocol):
    """A restriction beyond the type."""

    def allows(self, value: Any) -> bool: ...  # noqa: ANN401 - of the type it is annotated with
    def says(self, noun: str) -> str: ...


@dataclass(frozen=True, slots=True)
class Range:
    """Bounds of a number, inclusive unless said otherwise."""

    low: float = -math.inf
    high: float = math.inf
    exclusive_low: bool = False

    def allows(self, value: float) -> bool:
        return self.low <= value <= self.high and not (self.exclusive_low and value == self.low)

    def says(self, noun: str) -> str:
        above = f"> {self.low:g}" if self.exclusive_low else f">= {self.low:g}"
        bounds = [above] * (self.low > -math.inf) + [f"<= {self.high:g}"] * (self.high < math.inf)
        return f"{noun} {' and '.join(bounds)}"


@dataclass(frozen=True, slots=True)
class Length:
    """Bounds of the number of items."""

    low: int = 0
    high: float = math.inf

    def allows(self, value: typing.Sized) -> bool:
        return self.low <= len(value) <= self.high

    def says(self, noun: str) -> str:
        bounds = [f"at least {self.low}"] * (self.low > 0) + [f"at most {self.high:g}"] * (self.high < math.inf)
        return f"{noun} of {' and '.join(bounds)}"


@dataclass(frozen=True, slots=True)
class Ascending:
    """Two numbers are the bounds of a range."""

    def allows(self, value: tuple[float, float]) -> bool:
        return value[0] < value[1]

    def says(self, noun: str) -> str:
        return f"{noun}, the smaller first"


@dataclass(frozen=True, slots=True)
class OneOf:
    """A text is one of some words, which a function returns where there may be more of them later."""

    words: tuple[str, ...] | Callable[[], tuple[str, ...]]
    more: str = ""  # what else there may be, in messages

    @property
    def known(self) -> tuple[str, ...]:
        return self.words() if callable(self.words) else self.words

    def allows(self, value: str) -> bool:
        return value in self.known

    def says(self, noun: str) -> str:  # noqa: ARG002 - as all rules have it
        return one_of(list(self.known)) + self.more


@dataclass(frozen=True, slots=True)
class Pattern:
    """A regular expression for a whole text, and its meaning in words."""

    regex: str
    meaning: str

    def allows(self, value: str) -> bool:
        return re.fullmatch(self.regex, value) is not None

    def says(self, noun: str) -> str:
        return f"{noun}: {self.meaning}"


@dataclass(frozen=True, slots=True)
class FilePath:
    """A path, relative to the folder of the file that names it; it becomes absolute.

    With `unless_name`, a text that does not look like a path is a name, and is not changed.
    """

    unless_name: bool = False

    def allows(self, value: str) -> bool:
        return value != "" and "\0" not in value

    def says(self, noun: str) -> str:
        return f"{noun}: a path"


@dataclass(frozen=True, slots=True)
class Radians:
    """Marks an angle [rad]: one beyond a whole turn is allowed, and may be meant in degrees."""


@dataclass(frozen=True, slots=True)
class KeywordsOf:
    """Marks a field of type Mapping that has the keyword-only arguments of the function that the field `key` names.

    In the file they are keys beside `key`, and are read by the annotations of `functions[name]`. If no function has the
    name, the error has the first sentence of each one's docstring, and `others`, which says where more come from.
    """

    functions: Mapping[str, Callable[..., Any]]
    key: str
    others: str = ""

    @property
    def items(self) -> str:
        """The functions with their sentences and `others`, as items of a message; empty without `others`."""
        lines = [f"{name}: {sentence_of(function)}" for name, function in self.functions.items()]
        return "".join(f"{ITEM}{line.removesuffix(': ')}" for line in [*lines, self.others]) if self.others else ""


Positive = Annotated[float, Range(0.0, exclusive_low=True)]
NonNegative = Annotated[float, Range(0.0)]
Name = Annotated[str, Pattern(r"\w[\w .+-]{0,99}", "letters, digits, spaces and . _ + -, at most 100")]


def origin_of(kind: Kind) -> Kind:
    """As `typing.get_origin`, whose type mypy takes too literally."""
    return None if type(kind) is type else typing.get_origin(kind)  # most are classes


def unwrapped(kind: Kind) -> tuple[Kind, list[Rule]]:
    """An annotation without Annotated, and its rules."""
    if origin_of(kind) is not Annotated:
        return kind, []
    base, *extras = typing.get_args(kind)
    return base, [extra for extra in extras if hasattr(extra, "allows")]


def is_union(base: Kind) -> bool:
    return origin_of(base) in {Union, types.UnionType}


def is_record(kind: Kind) -> bool:
    """Whether a mapping of keys is read as this: a dataclass or NamedTuple."""
    return dataclasses.is_dataclass(kind) or hasattr(kind, "_field_defaults")


@functools.cache
def fields_of(kind: Kind) -> Specification:
    """The fields of a NamedTuple or dataclass, except those with init=False, or with both repr and compare False."""
    hints = typing.get_type_hints(kind, include_extras=True)
    if dataclasses.is_dataclass(kind):
        fields = [field for field in dataclasses.fields(kind) if field.init and (field.repr or field.compare)]
        return {field.name: (hints[field.name], field.default) for field in fields}
    defaults = kind._field_defaults
    return {name: (hints[name], defaults.get(name, dataclasses.MISSING)) for name in kind._fields}


@functools.cache
def parameters_of(function: Callable[..., Any]) -> Specification:
    """The keyword-only parameters of a function."""
    hints = typing.get_type_hints(function, include_extras=True)
    keywords = [p for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY]
    return {p.name: (hints[p.name], dataclasses.MISSING if p.default is p.empty else p.default) for p in keywords}


@functools.cache
def keywords_of(kind: Kind) -> tuple[str, KeywordsOf] | None:
    """The field of a dataclass that holds keyword arguments, if one does."""
    for name, (annotation, _) in fields_of(kind).items():
        for extra in getattr(annotation, "__metadata__", ()):
            if isinstance(extra, KeywordsOf):
                return name, extra
    return None


@functools.cache
def comments_of(described: Callable[..., Any]) -> dict[str, str]:
    """Field of a dataclass or NamedTuple, or parameter on a line of its own -> the comment behind it in the source."""
    found: dict[str, str] = {}
    for each in reversed(getattr(described, "__mro__", (described,))):
        with contextlib.suppress(OSError, TypeError):  # made at run time, or of Python itself
            found |= re.findall(r"^    (\w+): [^#\n]*  # (.+)$", inspect.getsource(each), re.MULTILINE)
    return found


def sentence_of(described: Callable[..., Any]) -> str:
    """The first sentence of a docstring; empty if there is none."""
    return re.split(r"\.(?:\s|$)", " ".join((inspect.getdoc(described) or "").split()), maxsplit=1)[0]


def unit_of(described: Callable[..., Any], name: str) -> str:
    """The unit in the comment behind a field or parameter, such as "m/s"; empty if it begins with none."""
    unit = re.match(r"\[([^\]]+)\]", comments_of(described).get(name, ""))
    return unit[1] if unit else ""


def values_in(
    kind: Kind,
    value: Any,  # noqa: ANN401 - of that kind
    path: str = "",
) -> Iterator[tuple[Kind, Any, str]]:
    """A value of a kind and all values in it, each with its annotation and its path, as "zones[0]".

    Keys of a mapping are values, too, of the path of their entry.
    """
    yield kind, value, path
    base, _ = unwrapped(kind)
    if origin_of(base) is Mapping:
        yield from ((typing.get_args(base)[0], key, f"{path}.{key}".removeprefix(".")) for key in value)
    for step, part_kind, part in _parts(kind, value):
        yield from values_in(part_kind, part, (path + step).removeprefix("."))


def mapped(
    kind: Kind,
    value: Any,  # noqa: ANN401 - of that kind
    change: Callable[[Kind, Any], Any],
) -> Any:  # noqa: ANN401 - the same
    """A value of a kind with changed parts.

    `change` takes each part with its annotation, and returns what replaces it, or the same object.
    """
    if (changed := change(kind, value)) is not value:
        return changed
    parts = [mapped(part_kind, part, change) for _, part_kind, part in _parts(kind, value)]
    base, _ = unwrapped(kind)
    if is_record(base):
        return base(**dict(zip(fields_of(base), parts, strict=True)))
    if origin_of(base) is tuple:
        return tuple(parts)
    if origin_of(base) is Mapping:
        return dict(zip(value, parts, strict=True))
    return parts[0] if parts else value


def _parts(kind: Kind, value: Any) -> list[tuple[str, Kind, Any]]:  # noqa: ANN401 - of that kind
    """The direct parts of a value of a kind: step of the path, annotation, part."""
    base, _ = unwrapped(kind)
    arguments = typing.get_args(base)
    if is_union(base):
        return [("", part, value) for part in arguments if _is_of(part, value)][:1]
    if is_record(base):
        found = {name: (annotation, getattr(value, name)) for name, (annotation, _) in fields_of(base).items()}
        if keywords := keywords_of(base):
            field, rule = keywords
            _, given = found.pop(field)
            parameters = parameters_of(rule.functions[getattr(value, rule.key)])
            found |= {name: (each, given.get(name, default)) for name, (each, default) in parameters.items()}
        return [(f".{name}", *part) for name, part in found.items()]
    if origin_of(base) is tuple:
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else arguments
        return [(f"[{index}]", *part) for index, part in enumerate(zip(kinds, value, strict=True))]
    if origin_of(base) is Mapping:
        return [(f".{key}", arguments[1], item) for key, item in value.items()]
    return []


def _is_of(kind: Kind, value: Any) -> bool:  # noqa: ANN401 - of any kind
    """Whether a value, read as one of several kinds, was read as this one."""
    base, _ = unwrapped(kind)
    if is_union(base):
        return any(_is_of(part, value) for part in typing.get_args(base))
    if origin_of(base) is Literal:
        return value in typing.get_args(base)
    return isinstance(value, base if isinstance(base, type) else origin_of(base))


def form(kind: Kind) -> type:
    """The form of a value of this kind in YAML: dict, list or str (any scalar)."""
    base, _ = unwrapped(kind)
    if is_record(base) or origin_of(base) is Mapping:
        return dict
    return list if origin_of(base) is tuple else str


def tags(kinds: list[Kind]) -> tuple[str, dict[str, Kind]]:
    """The key that distinguishes dataclasses (a one-word Literal in each), and its word for each."""
    for key in fields_of(kinds[0]):
        found = [words(fields_of(kind)[key][0]) for kind in kinds if key in fields_of(kind)]
        if len(found) == len(kinds) and all(len(each) == 1 for each in found):
            return key, {each[0]: kind for each, kind in zip(found, kinds, strict=True)}
    names = " and ".join(kind.__name__ for kind in kinds)
    raise TypeError(f"{names} cannot be distinguished; give each a field that is a Literal of one word of its own")


def words(kind: Kind) -> list[str]:
    """The words of the Literals in an annotation."""
    base, _ = unwrapped(kind)
    if is_union(base):
        return [word for alternative in typing.get_args(base) for word in words(alternative)]
    return [str(word) for word in typing.get_args(base)] if origin_of(base) is Literal else []


def one_of(names: list[str]) -> str:
    return f"one of {', '.join(names)}" if len(names) > 1 else names[0]


NOUNS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text",
    types.NoneType: "null",
    object: "data",
}


def describe(kind: Kind) -> str:
    """An annotation in a user's words."""
    base, rules = unwrapped(kind)
    origin, arguments = origin_of(base), typing.get_args(base)
    if is_union(base):
        text = " or ".join(dict.fromkeys(describe(alternative) for alternative in arguments))
    elif origin is tuple:
        several = arguments[-1] is Ellipsis
        text = "a list" if several else f"[{', '.join(describe(argument) for argument in arguments)}]"
    elif origin is Literal:
        text = one_of(words(base))
    else:
        text = NOUNS.get(base, "a mapping of keys")
    lengths = [rule for rule in rules if isinstance(rule, Length)]
    if lengths:  # as one: the tightest
        rules = [rule for rule in rules if not isinstance(rule, Length)]
        rules.append(Length(max(one.low for one in lengths), min(one.high for one in lengths)))
    for rule in rules:
        text = rule.says(text)
    return text
