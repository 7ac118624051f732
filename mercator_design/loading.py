"""What a user writes in YAML becomes a frozen dataclass; here is decided how, and what an error says.

The schema is the dataclass: its annotations say what is expected where, and a scalar is read as what is
expected (`1e3` is a number where a number is wanted, `no` is text where text is wanted), never guessed from
its looks. Understood are float (finite), int, bool, str, Literal, tuple, Mapping[str, X], dataclasses, NamedTuples,
unions (of dataclasses: told apart by a field that is a one-word Literal), and the rules of schema.py in Annotated.
Which texts are refused before anything is built is decided in yaml_tree.py.
"""

import dataclasses
import difflib
import hashlib
import math
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import yaml

from mercator_design import schema
from mercator_design.errors import MercatorError, excerpt
from mercator_design.schema import (
    Ascending,
    FieldError,
    FilePath,
    KeywordsOf,
    Kind,
    Length,
    Name,
    NonNegative,
    Pattern,
    Positive,
    Range,
    Specification,
)
from mercator_design.yaml_tree import Fault, Node, compose, merge, override, read_text, steps

__all__ = [
    "Ascending",
    "FieldError",
    "FilePath",
    "KeywordsOf",
    "Length",
    "Name",
    "NonNegative",
    "Pattern",
    "Positive",
    "Range",
    "check_parameter",
    "digest_of",
    "dump",
    "is_name",
    "parse",
    "plain",
    "read",
    "text_of",
]

T = TypeVar("T")

FindBase: TypeAlias = Callable[[str, Path], Path]


def read(
    path: str | Path,
    kind: type[T],
    *,
    error: type[MercatorError],
    overrides: Sequence[str] = (),
    defaults: Mapping[str, str] = types.MappingProxyType({}),
    find_base: FindBase | None = None,
) -> T:
    """The dataclass `kind` that a YAML file describes.

    Args:
        path: the file; relative paths in it start from its folder.
        kind: a dataclass.
        error: the class of errors to raise.
        overrides: assignments as `floor.zones[0].radius=0.3`, put in before anything is built.
        defaults: values of top-level keys that the file may leave out.
        find_base: where the file of a `base` is, given what the file calls it and the file's folder. What a file with
            that key does not say is as its base says.

    Raises:
        error: with file, line, path of the key, what was expected and what was found.
    """
    folder = Path(path).parent
    return parse(
        text_of(path, error=error),
        kind,
        error=error,
        label=str(path),
        folder=folder,
        overrides=overrides,
        defaults=defaults,
        find_base=find_base,
    )


def text_of(path: str | Path, *, error: type[MercatorError]) -> str:
    """The text of a file that `read` would look at; errors are of the class given."""
    try:
        return read_text(Path(path))
    except Fault as fault:
        raise error(str(fault)) from None


def parse(
    text: str,
    kind: type[T],
    *,
    error: type[MercatorError],
    label: str = "text",
    folder: Path | None = None,
    overrides: Sequence[str] = (),
    defaults: Mapping[str, str] = types.MappingProxyType({}),
    find_base: FindBase | None = None,
    may_be_empty: bool = False,
    lines: bool = True,
) -> T:
    """As `read`, of a text; `label` names it in errors, and relative paths in it start from `folder`.

    One that `may_be_empty`, or of comments only, says nothing of any key. Without `lines` errors do not tell them.
    """
    try:
        tree = compose(text, label, folder or Path.cwd(), may_be_empty=may_be_empty, lines=lines)
        if find_base is not None:
            tree = _on_base(tree, find_base, [str(Path(label).resolve())])
        for assignment in overrides:
            override(tree, assignment)
        if isinstance(tree.content, dict):
            given = {key: dataclasses.replace(tree, content=text) for key, text in defaults.items()}
            tree.content = given | tree.content
        return typing.cast("T", _build(tree, kind, ""))
    except Fault as fault:
        raise error(str(fault)) from None


def _on_base(tree: Node, find_base: FindBase, labels: list[str]) -> Node:
    """A tree with what its base, and that one's base, say in addition; `labels` are the files on the way."""
    if not isinstance(tree.content, dict) or "base" not in tree.content:
        return tree
    base = tree.content.pop("base")
    name = _build(base, str, "base")
    try:
        path = find_base(name, tree.folder)
    except MercatorError as error:
        raise _fault(base, "base", str(error)) from None
    file = str(path.resolve())
    if file in labels:
        raise _fault(base, "base", f"{path} is based on itself")
    below = _on_base(compose(read_text(path), str(path), path.parent), find_base, [*labels, file])
    if isinstance(below.content, dict):
        for key in ("name", "description"):  # are the base's own
            below.content.pop(key, None)
    return merge(below, tree)


def is_name(text: str) -> bool:
    """Whether a text is the name of something shipped, not a path: no separator, no .yaml or .yml."""
    return not ("/" in text or "\\" in text or text.endswith((".yaml", ".yml")))


_WRONG: Any = object()
"""What a builder returns for a node that is not of its kind; `_build` then says what was expected."""


def _build(node: Node, kind: Kind, path: str) -> Any:  # noqa: ANN401 - what `kind` says
    base, rules = schema.unwrapped(kind)
    value = _builder(base)(node, base, path)
    if value is _WRONG or (value is not None and not all(rule.allows(value) for rule in rules)):
        near = _nearest(node.content, schema.words(base)) if isinstance(node.content, str) else ""
        raise _fault(node, path, f"expected {schema.describe(kind)}, found {node.found}{near}")
    if any(isinstance(rule, FilePath) and not (rule.unless_name and is_name(value)) for rule in rules):
        value = str(node.folder.resolve() / value)
    return value


def _builder(base: Kind) -> Callable[[Node, Kind, str], Any]:
    if schema.is_union(base):
        return _union
    if schema.origin_of(base) is tuple:
        return _tuple
    if schema.origin_of(base) is Mapping:
        return _mapping
    return _record if schema.is_record(base) else _scalar


def _scalar(node: Node, base: Kind, _: str) -> Any:  # noqa: ANN401 - what `base` says
    text = node.content
    if not isinstance(text, str):
        return _WRONG
    if schema.origin_of(base) is Literal:
        return next((word for word in typing.get_args(base) if text == str(word)), _WRONG)
    if base is str:
        return text if text or not node.plain else _WRONG
    if not node.plain:
        return _WRONG
    if base is bool:
        return {"true": True, "false": False}.get(text, _WRONG)
    if base is int:
        return int(text) if re.fullmatch(r"[-+]?[0-9]{1,18}", text) else _WRONG
    if base is float:
        number = re.fullmatch(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?", text)
        return float(text) if number and math.isfinite(float(text)) else _WRONG
    if base is types.NoneType:
        return None if text in {"", "~", "null"} else _WRONG
    raise TypeError(f"no YAML form for {base!r}")


def _tuple(node: Node, base: Kind, path: str) -> Any:  # noqa: ANN401
    if not isinstance(node.content, list):
        return _WRONG
    kinds = typing.get_args(base)
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(node.content)
    if len(kinds) != len(node.content):
        return _WRONG
    pairs = zip(node.content, kinds, strict=True)
    return tuple(_build(item, kind, f"{path}[{index}]") for index, (item, kind) in enumerate(pairs))


def _mapping(node: Node, base: Kind, path: str) -> Any:  # noqa: ANN401
    if not isinstance(node.content, dict):
        return _WRONG
    key_kind, item_kind = typing.get_args(base)
    built = {}
    for key, item in node.content.items():
        place = _join(path, key)
        key_node = dataclasses.replace(item, content=key, plain=False)
        built[_build(key_node, key_kind, place)] = _build(item, item_kind, place)
    return built


def _union(node: Node, base: Kind, path: str) -> Any:  # noqa: ANN401
    """The alternative of the node's form: the dataclass its tag names, or the first kind to fit."""
    kinds = [kind for kind in typing.get_args(base) if schema.form(kind) is type(node.content)]
    if len(kinds) > 1 and all(schema.is_record(kind) for kind in kinds):
        key, tagged = schema.tags(kinds)
        return _build(node, tagged[_word(node, key, tagged, path)], path)
    if len(kinds) == 1 and kinds[0] is not types.NoneType:
        return _build(node, kinds[0], path)
    for kind in sorted(kinds, key=lambda kind: kind is not types.NoneType):  # `null` is text only if quoted
        try:
            return _build(node, kind, path)
        except Fault:
            continue
    return _WRONG


def _record(node: Node, kind: Kind, path: str) -> Any:  # noqa: ANN401
    if not isinstance(node.content, dict):
        return _WRONG
    specification = schema.fields_of(kind)
    keywords = schema.keywords_of(kind)
    if keywords is None:
        values = _entries(node, node.content, specification, path)
    else:
        field, rule = keywords
        parameters = schema.parameters_of(rule.functions[_word(node, rule.key, rule.functions, path)])
        fields = {name: entry for name, entry in specification.items() if name != field}
        values = _entries(node, node.content, fields | parameters, path)
        values[field] = {name: values.pop(name, default) for name, (_, default) in parameters.items()}
    try:
        return kind(**values)
    except FieldError as wrong:
        for step in steps(wrong.field):
            path = f"{path}[{step}]" if isinstance(step, int) else _join(path, step)
        raise _fault(node.nearest(steps(wrong.field)), path, wrong.message) from None


def _entries(node: Node, content: Mapping[str, Node], specification: Specification, path: str) -> dict[str, Any]:
    """The values of a mapping's keys, in the order of the file so that its first mistake is reported."""
    values = {}
    for key, item in content.items():
        if key not in specification:
            near = _nearest(key, specification) or f"; known: {', '.join(specification)}"
            raise _fault(item, _join(path, key), f"unknown key{near}")
        values[key] = _build(item, specification[key][0], _join(path, key))
    for key, (kind, default) in specification.items():
        if default is dataclasses.MISSING and key not in values:
            raise _fault(node, _join(path, key), f"missing key; expected {schema.describe(kind)}")
    return values


def _word(node: Node, key: str, known: Iterable[str], path: str) -> str:
    """The value of `key`, which must be one of the known words."""
    item, place, expected = node.child(key), _join(path, key), schema.one_of(list(known))
    if item is None:
        raise _fault(node, place, f"missing key; expected {expected}")
    if not isinstance(item.content, str):
        raise _fault(item, place, f"expected {expected}, found {item.found}")
    if item.content not in known:
        raise _fault(item, place, f"expected {expected}, found {item.found}{_nearest(item.content, known)}")
    return item.content


def _fault(node: Node, path: str, message: str) -> Fault:
    return Fault(f"{node.where}: {path}: {message}" if path else f"{node.where}: {message}")


def _join(path: str, key: str) -> str:
    return f"{path}.{excerpt(key)}" if path else excerpt(key)


def _nearest(word: str, known: Iterable[str]) -> str:
    """A suggestion to append to an error, or nothing."""
    near = difflib.get_close_matches(word[:100], known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def check_parameter(kind: Kind, default: object = dataclasses.MISSING) -> None:
    """Make sure that a file can give a value of a kind, and could have given the default.

    Raises:
        TypeError: saying what is wrong.
    """
    schema.check_annotation(kind)
    if default is dataclasses.MISSING:
        return
    try:
        text = yaml.dump([plain(default)], Dumper=_Dumper)
        _build(compose(text, "", Path()), tuple[kind], "")
    except (Fault, yaml.YAMLError):
        raise TypeError(
            f"its default {excerpt(repr(default))} cannot be written in YAML as {schema.describe(kind)}"
        ) from None


def dump(value: object) -> str:
    """The YAML text of a dataclass, with every default filled in: `parse(dump(x), type(x))` equals x."""
    return yaml.dump(plain(value), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


def digest_of(value: object) -> str:
    """16 hexadecimal digits; equal for values whose texts (`dump`) are equal."""
    return hashlib.sha256(dump(value).encode()).hexdigest()[:16]


def plain(value: object) -> Any:  # noqa: ANN401 - dicts, lists and scalars
    """A dataclass, or a value of one, as YAML and JSON have it."""
    if schema.is_record(value):
        kind: Kind = type(value)
        keywords = schema.keywords_of(kind)
        fields = {name: plain(getattr(value, name)) for name in schema.fields_of(kind)}
        return fields | fields.pop(keywords[0]) if keywords else fields
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


class _Dumper(yaml.SafeDumper):
    """Mappings in block style, lists of scalars in one line, long texts as they were written."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - yaml's signature
        return True


def _represent_list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.SequenceNode:
    flow = not any(isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flow)


def _represent_dict(dumper: yaml.SafeDumper, mapping: dict[str, Any]) -> yaml.MappingNode:
    return dumper.represent_mapping("tag:yaml.org,2002:map", mapping, flow_style=False)


def _represent_str(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    printable = all(line.isprintable() for line in text.split("\n"))
    style = '"' if not printable else "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(dict, _represent_dict)
_Dumper.add_representer(str, _represent_str)
