"""Builds the dataclass that a tree of nodes describes, with all mistakes at once.

A scalar is read as the expected type (`1e3` is a number if a number is expected, `no` is text if text is expected); the
type is never guessed. All mistakes of a tree are collected, up to MAX_MISTAKES; each message has the place, the
path of the key, what was expected with its unit, what was found, and a suggestion if there is one.
"""

import dataclasses
import functools
import math
import re
import types
import typing
from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal, NamedTuple, TypeAlias

from mercator_design.config import schema, spelling
from mercator_design.config.schema import FieldError, FilePath, Kind, Specification
from mercator_design.config.yaml_tree import MAX_INTEGER, MAX_MISTAKES, Fault, Node, steps
from mercator_design.errors import excerpt

Holder: TypeAlias = Callable[..., Any]


class NodePath(NamedTuple):
    """The path from the root to a node: the last step, and the path before it. The root has none."""

    before: "NodePath | None"
    step: str | int
    holder: Holder | None = None  # the dataclass or function whose field or parameter it is

    def __str__(self) -> str:
        before = "" if self.before is None else str(self.before)
        if isinstance(self.step, int):
            return f"{before}[{self.step}]"
        return f"{before}.{excerpt(self.step)}" if before else excerpt(self.step)

    @property
    def unit(self) -> str:
        """The unit of the values there; empty if they have none."""
        if self.holder is not None:
            step = str(self.step)
            return schema.unit_of(self.holder, spelling.find(step, schema.comments_of(self.holder)) or step)
        return self.before.unit if self.before is not None and isinstance(self.step, int) else ""


_WRONG: Any = object()
"""A builder returns this for a node that is not of its kind; `build` then reports the expected kind."""


def build(node: Node, kind: Kind, path_to: NodePath | None = None) -> Any:  # noqa: ANN401 - what `kind` says
    """The value of a kind that a node describes.

    Raises:
        Fault: with a message for each mistake.
    """
    if node.content is None:  # which is reported
        raise Fault
    base, rules = schema.unwrapped(kind)
    value = _builder(base)(node, base, path_to)
    if value is _WRONG or (value is not None and not all(rule.allows(value) for rule in rules)):
        raise Fault(
            message(node, path_to, f"{_expected(kind, path_to)}, found {node.found}{_hint(node, base, path_to)}")
        )
    if any(isinstance(rule, FilePath) and not (rule.unless_name and is_name(value)) for rule in rules):
        if node.folder is None:
            what = f"expected no file, because this text may not name files, found {node.found}"
            raise Fault(message(node, path_to, what))
        value = str(node.folder.resolve() / value)
    return value


def message(node: Node, path_to: NodePath | None, what: str) -> str:
    """The message on a mistake in a node, with its place and path."""
    return ": ".join(str(part) for part in (node.where, path_to, what) if part)


def is_name(text: str) -> bool:
    """Whether a text is the name of something shipped, not a path: no separator, no .yaml or .yml."""
    return not ("/" in text or "\\" in text or text.endswith((".yaml", ".yml")))


def _builder(base: Kind) -> Callable[[Node, Kind, NodePath | None], Any]:
    if base is object:
        return lambda node, _, __: node.content
    if schema.is_union(base):
        return _union
    if schema.origin_of(base) is tuple:
        return _tuple
    if schema.origin_of(base) is Mapping:
        return _mapping
    return _record if schema.is_record(base) else _scalar


def _scalar(node: Node, base: Kind, _: NodePath | None) -> Any:  # noqa: ANN401 - what `base` says
    text = node.content
    if not isinstance(text, str):
        return _WRONG
    if schema.origin_of(base) is Literal:
        words = {str(word): word for word in typing.get_args(base)}
        found = spelling.find(text, words)
        return _WRONG if found is None else words[found]
    if base is str:
        return text if not node.plain or (text and not node.is_json) else _WRONG
    return _plain_scalar(text, base) if node.plain else _WRONG


def _plain_scalar(text: str, base: Kind) -> Any:  # noqa: ANN401
    """The value of a text without quotes."""
    if base is bool:
        return {"true": True, "false": False}.get(text, _WRONG)
    if base is int:
        return int(text) if re.fullmatch(r"[-+]?[0-9]{1,19}", text) and abs(int(text)) <= MAX_INTEGER else _WRONG
    if base is float:
        number = re.fullmatch(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?", text)
        return float(text) if number and math.isfinite(float(text)) else _WRONG
    if base is types.NoneType:
        return None if text in {"", "~", "null"} else _WRONG
    raise TypeError(f"no YAML form for {base!r}")


class _Mistakes(list[str]):
    """The mistakes in the parts of a node, in their order; `any` is set even if all are reported already."""

    any = False

    def build(self, node: Node, kind: Kind, path_to: NodePath | None) -> Any:  # noqa: ANN401
        """As `build`; _WRONG if there are mistakes, which are noted."""
        try:
            return build(node, kind, path_to)
        except Fault as fault:
            self.note(*fault.args)
        return _WRONG

    def note(self, *messages: str) -> None:
        """Add messages; reading ends when there are MAX_MISTAKES."""
        self.any = True
        self.extend(messages)
        if len(self) >= MAX_MISTAKES:
            raise Fault(*self)


def _tuple(node: Node, base: Kind, path_to: NodePath | None) -> Any:  # noqa: ANN401
    if not isinstance(node.content, list):
        return _WRONG
    kinds = typing.get_args(base)
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(node.content)
    if len(kinds) != len(node.content):
        return _WRONG
    wrong = _Mistakes()
    pairs = zip(node.content, kinds, strict=True)
    built = tuple([wrong.build(item, kind, NodePath(path_to, index)) for index, (item, kind) in enumerate(pairs)])
    if wrong.any:
        raise Fault(*wrong)
    return built


def _mapping(node: Node, base: Kind, path_to: NodePath | None) -> Any:  # noqa: ANN401
    if not isinstance(node.content, dict):
        return _WRONG
    key_kind, item_kind = typing.get_args(base)
    wrong = _Mistakes()
    built: dict[Any, Any] = {}
    for word, item in node.content.items():
        place = NodePath(path_to, word)
        key = wrong.build(dataclasses.replace(item, content=word, plain=False), key_kind, place)
        value = wrong.build(item, item_kind, place)
        if key in built and key is not _WRONG:
            wrong.note(message(item, place, f"'{key}' in another spelling is here already; give it once"))
        built[key] = value
    if wrong.any:
        raise Fault(*wrong)
    return built


def _union(node: Node, base: Kind, path_to: NodePath | None) -> Any:  # noqa: ANN401
    """The alternative of the node's form: the dataclass that its tag names, or the first kind that fits."""
    kinds = [kind for kind in typing.get_args(base) if schema.form(kind) is type(node.content)]
    if len(kinds) > 1 and all(schema.is_record(kind) for kind in kinds):
        return _alternative(node, kinds, path_to)
    if len(kinds) == 1 and kinds[0] is not types.NoneType:
        return build(node, kinds[0], path_to)
    for kind in sorted(kinds, key=lambda kind: kind is not types.NoneType):  # `null` is text only if quoted
        try:
            return build(node, kind, path_to)
        except Fault:
            continue
    return _WRONG


def _alternative(node: Node, kinds: list[Kind], path_to: NodePath | None) -> Any:  # noqa: ANN401 - one of the kinds
    """The dataclass that the node's tag names.

    If the tag is wrong, the other mistakes are found with the nearest dataclass.
    """
    (key, tagged), wrong = schema.tags(kinds), _Mistakes()
    specification, holders = _of_any(tuple(kinds), key)
    word, node = _tagged(node, key, tagged, specification, path_to, wrong)
    if not wrong.any:
        return build(node, tagged[word], path_to)
    if word:
        wrong.build(node, tagged[word], path_to)
    else:
        _entries(node, specification, holders, path_to, wrong)
    raise Fault(*wrong)


@functools.cache
def _of_any(kinds: tuple[Kind, ...], tag: str) -> tuple[Specification, dict[str, Holder]]:
    """The keys of several dataclasses, and for each key a dataclass that has it.

    Any value is accepted for the tag, and for a key whose annotations differ.
    """
    specification: Specification = {}
    holders: dict[str, Holder] = {}
    for name in dict.fromkeys(name for kind in kinds for name in schema.fields_of(kind)):
        having = [kind for kind in kinds if name in schema.fields_of(kind)]
        annotations, defaults = zip(*(schema.fields_of(kind)[name] for kind in having), strict=True)
        is_one = name != tag and all(each == annotations[0] for each in annotations)
        is_needed = is_one and len(having) == len(kinds) and all(default is dataclasses.MISSING for default in defaults)
        specification[name] = (annotations[0] if is_one else object, dataclasses.MISSING if is_needed else None)
        holders[name] = having[0]
    return specification, holders


def _record(node: Node, kind: Kind, path_to: NodePath | None) -> Any:  # noqa: ANN401
    if not isinstance(node.content, dict):
        return _WRONG
    fields, wrong = schema.fields_of(kind), _Mistakes()
    holders: dict[str, Holder] = {name: kind for name in fields}  # noqa: C420 - whose type mypy loses
    keywords = schema.keywords_of(kind)
    if keywords is None:
        values = _entries(node, fields, holders, path_to, wrong)
    else:
        field, rule = keywords
        fields = {name: entry for name, entry in fields.items() if name != field}
        word, node = _tagged(node, rule.key, rule.functions, fields, path_to, wrong, rule.items)
        if not word:  # without it the other keys cannot be read
            del fields[rule.key]
            _entries(node, fields, holders, path_to, wrong, complete=False)
            raise Fault(*wrong)
        function = rule.functions[word]
        parameters = schema.parameters_of(function)
        holders |= dict.fromkeys(parameters, function)
        values = _entries(node, fields | parameters, holders, path_to, wrong)
        values[rule.key] = word
        values[field] = {name: values.pop(name, default) for name, (_, default) in parameters.items()}
    if wrong.any:
        missing = ((name, default) for name, (_, default) in fields.items() if node.child(name) is None)
        usual = {name: default for name, default in missing if default is not dataclasses.MISSING}
        found = schema.problems(kind, usual | values)
        raise Fault(*wrong, *(_of_field(node, path_to, each) for each in found))
    try:
        return kind(**values)
    except FieldError as error:
        raise Fault(*(_of_field(node, path_to, each) for each in (error, *error.others))) from None


def _of_field(node: Node, path_to: NodePath | None, error: FieldError) -> str:
    for step in steps(error.field):
        path_to = NodePath(path_to, step)
    return message(node.nearest(steps(error.field)), path_to, error.message)


def _entries(
    node: Node,
    specification: Specification,
    holders: Mapping[str, Holder],
    path_to: NodePath | None,
    wrong: _Mistakes,
    *,
    complete: bool = True,
) -> dict[str, Any]:
    """The values of those keys of a mapping that are valid; the mistakes in others are noted.

    A mapping that is not complete may have other keys.
    """
    values: dict[str, Any] = {}
    words: dict[str, str] = {}
    meant: set[str] = set()
    assert isinstance(node.content, dict)  # noqa: S101 - as the caller has seen
    for word, item in node.content.items():
        key = spelling.find(word, specification)
        if key is None:
            near = spelling.nearest(word, [*specification])
            if complete:
                known = f"did you mean '{near}'?" if near else f"known: {', '.join(specification)}"
                wrong.note(message(item, NodePath(path_to, word), f"unknown key; {known}"))
            meant.add(near)
        elif key in words:
            other = f"the same as '{words[key]}', in another spelling; give one of the two"
            wrong.note(message(item, NodePath(path_to, word), other))
        else:
            words[key] = word
            value = wrong.build(item, specification[key][0], NodePath(path_to, word, holders[key]))
            if value is not _WRONG:
                values[key] = value
    for key, (kind, default) in specification.items():
        if default is dataclasses.MISSING and key not in words and key not in meant:
            place = NodePath(path_to, key, holders[key])
            wrong.note(message(node, place, f"missing key; {_expected(kind, place)}"))
    return values


def _tagged(
    node: Node,
    key: str,
    words: Collection[str],
    keys: Collection[str],
    path_to: NodePath | None,
    wrong: _Mistakes,
    items: str = "",
) -> tuple[str, Node]:
    """The word of a mapping's tag, and the mapping.

    If the tag is wrong, the word is the nearest valid one, also in the mapping; if none is near, the word is empty.
    """
    assert isinstance(node.content, dict)  # noqa: S101 - as the caller has seen
    expected, spelt = f"expected {schema.one_of(list(words))}", node.key(key)
    if spelt not in node.content:
        unknown = [word for word in node.content if spelling.find(word, keys) is None]
        spelt = next((word for word in unknown if spelling.nearest(word, keys) == key), "")
        if not spelt:
            wrong.note(message(node, NodePath(path_to, key), f"missing key; {expected}{items}"))
            return "", node
        wrong.note(message(node.content[spelt], NodePath(path_to, spelt), f"unknown key; did you mean '{key}'?"))
    item = node.content[spelt]
    text = item.content if isinstance(item.content, str) else ""
    word = spelling.find(text, words)
    if item.content is None:  # which is reported already
        wrong.note()
    elif word is None:
        wrong.note(
            message(item, NodePath(path_to, key), f"{expected}, found {item.found}{_did_you_mean(item, words)}{items}")
        )
    word = word or spelling.nearest(text, words)
    item = dataclasses.replace(item, content=word or item.content)
    content = {key if each == spelt else each: item if each == spelt else node.content[each] for each in node.content}
    return word, dataclasses.replace(node, content=content)


def _expected(kind: Kind, path_to: NodePath | None) -> str:
    unit = path_to.unit if path_to is not None else ""
    return f"expected {schema.describe(kind)}{f' [{unit}]' * bool(unit)}"


def _did_you_mean(node: Node, known: Collection[str]) -> str:
    near = spelling.nearest(node.content, known) if isinstance(node.content, str) else ""
    return f"; did you mean '{near}'?" if near else ""


_BOOLEANS = {"yes": "true", "on": "true", "1": "true", "no": "false", "off": "false", "0": "false"}


def _hint(node: Node, base: Kind, path_to: NodePath | None) -> str:
    """A suggestion to append to an error about a value that is not of a kind; may be empty."""
    parts = typing.get_args(base) if schema.is_union(base) else (base,)
    kinds = [schema.unwrapped(part)[0] for part in parts]
    if not isinstance(node.content, str):
        return ""
    near = _did_you_mean(node, schema.words(base))
    if near:
        return near
    text = node.content.strip()
    if bool in kinds and text.lower() in {*_BOOLEANS, "true", "false"}:
        return f"; did you mean {_BOOLEANS.get(text.lower(), text.lower())}?"
    if float in kinds or int in kinds:
        return _number_hint(node, float if float in kinds else int, path_to.unit if path_to is not None else "")
    lists = [kind for kind in kinds if schema.origin_of(kind) is tuple and typing.get_args(kind)[-1] is Ellipsis]
    return f"; did you mean [{excerpt(text)}]?" if text and lists else ""


def _number_hint(node: Node, base: Kind, unit: str) -> str:
    text = str(node.content).strip()
    if _plain_scalar(text, base) is not _WRONG:
        return "" if node.plain else "; write it without quotes"
    tidy = re.sub(r"(?<=[0-9])_(?=[0-9])", "", text)
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+", tidy):
        tidy = tidy.replace(",", ".")
    if _plain_scalar(tidy, base) is not _WRONG:
        return f"; did you mean {tidy}?"
    said = re.fullmatch(r"([-+]?[0-9.]{1,20})\s*([^\W\d_]{1,10}(?:/[a-z]+)?|[°%])", text)
    if said is None or _plain_scalar(said[1], base) is _WRONG:
        return ""
    if unit == "rad" and said[2].lower() in {"°", "deg", "degree", "degrees"}:
        return f"; did you mean {math.radians(float(said[1])):.5g}, which is {said[1]} degrees?"
    return f"; write the number alone{f', in {unit}' * bool(unit)}"
