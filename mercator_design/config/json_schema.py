"""The JSON Schema (2020-12) of a YAML file, for editors: from the same annotations by which config/loading.py reads it.

A schema cannot express relations between the parts of a file (a zone that the floor has, a place within the walls);
`mdesign validate` checks them.
"""

import dataclasses
import inspect
import math
import types
import typing
from collections.abc import Callable, Collection, Mapping
from typing import Any, Literal, TypeAlias

from mercator_design.config import schema
from mercator_design.config.schema import Ascending, FilePath, Kind, Length, OneOf, Pattern, Range, Rule, Specification
from mercator_design.config.writing import plain

Json: TypeAlias = dict[str, Any]
_Records: TypeAlias = dict[Kind, Json]

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_TYPES = {float: "number", int: "integer", bool: "boolean", str: "string", types.NoneType: "null"}
_CHANGES = "-changes"
_BASE = {"base": {"type": "string", "description": "the file, or the name of what is shipped, that this one changes"}}


def json_schema(kind: Kind, *, title: str, given: Collection[str] = (), based: bool = False) -> Json:
    """The schema of the files that a dataclass describes.

    Args:
        kind: The dataclass.
        title: The title of the schema.
        given: Keys that a file may omit although the dataclass has no default for them.
        based: Whether a file may name another one, its `base`, which it changes; then all other keys are optional.
    """
    records: _Records = {}
    whole = _record(kind, records)
    for alternative in whole.get("oneOf", [whole]):
        alternative["required"] = [key for key in alternative["required"] if key not in given]
    named = {record.__name__: found for record, found in sorted(records.items(), key=lambda item: item[0].__name__)}
    if len(named) < len(records):
        raise TypeError(f"two dataclasses of one name among {list(records)}")
    if based:
        changes = _partial(whole)
        changes["properties"] |= _BASE
        whole = {"if": {"type": "object", "required": ["base"]}, "then": changes, "else": whole}
        named |= {f"{name}{_CHANGES}": _partial(record) for name, record in named.items()}
    return {"$schema": _DIALECT, "title": title, **whole, "$defs": named}


def _partial(schema_: Any) -> Any:  # noqa: ANN401 - any JSON
    """A schema without required keys, for a file that changes its base; even the key of alternatives is optional."""
    if isinstance(schema_, list):
        return [_partial(item) for item in schema_]
    if not isinstance(schema_, dict):
        return schema_
    changed: Json = {}
    for key, value in schema_.items():
        if key == "$ref":
            changed[key] = f"{value}{_CHANGES}"
        elif key == "properties":
            changed[key] = {name: _partial(each) for name, each in value.items()}
        elif key not in {"required", "default"}:
            changed["anyOf" if key == "oneOf" else key] = _partial(value)
    return changed


def _schema(kind: Kind, records: _Records) -> Json:
    """The schema of any annotation; its dataclasses are entered in `records`."""
    base, rules = schema.unwrapped(kind)
    origin, arguments = schema.origin_of(base), typing.get_args(base)
    if schema.is_union(base):
        found = _union(list(arguments), records)
    elif schema.is_record(base):
        if base not in records:
            records[base] = {}  # it may be part of itself
            records[base] = _record(base, records)
        found = {"$ref": f"#/$defs/{base.__name__}"}
    elif origin is Literal:
        found = {"const": arguments[0]} if len(arguments) == 1 else {"enum": list(arguments)}
    elif origin is tuple and arguments[-1] is Ellipsis:
        found = {"type": "array", "items": _schema(arguments[0], records)}
    elif origin is tuple:
        items, n = [_schema(argument, records) for argument in arguments], len(arguments)
        alike = all(item == items[0] for item in items)
        each = {"items": items[0]} if alike else {"prefixItems": items, "items": False}
        found = {"type": "array", **each, "minItems": n, "maxItems": n}
    elif origin is Mapping:
        keys, values = (_schema(argument, records) for argument in arguments)
        found = {"type": "object", "propertyNames": keys, "additionalProperties": values}
    else:
        found = {"type": _TYPES[base]}
    form = found.get("type")
    for rule in rules:
        more = _keywords(rule, form)
        found = found | more if found.keys().isdisjoint(more) else {"allOf": [found, more]}
    return found


def _keywords(rule: Rule, type_: str | None) -> Json:
    """The keywords that a rule adds to the schema of a type."""
    if isinstance(rule, Range):
        low = {"exclusiveMinimum" if rule.exclusive_low else "minimum": rule.low} if rule.low > -math.inf else {}
        return low | ({"maximum": rule.high} if rule.high < math.inf else {})
    if isinstance(rule, Length):
        what = {"array": "Items", "object": "Properties"}.get(type_ or "", "Length")
        low = {f"min{what}": rule.low} if rule.low > 0 else {}
        return low | ({f"max{what}": int(rule.high)} if rule.high < math.inf else {})
    if isinstance(rule, OneOf):
        return {"enum": [*rule.known]}
    if isinstance(rule, Pattern):
        return {"pattern": f"^(?:{rule.regex})$", "description": rule.meaning}
    if isinstance(rule, FilePath):
        return {"minLength": 1}
    if isinstance(rule, Ascending):  # beyond what a schema can say
        return {"description": "the smaller first"}
    raise TypeError(f"no JSON Schema for {rule!r}")


def _union(kinds: list[Kind], records: _Records) -> Json:
    """A schema of alternatives; dataclasses are distinguished by their tag, which is then required."""
    tagged = [kind for kind in kinds if schema.is_record(kind)]
    others = [_schema(kind, records) for kind in kinds if kind not in tagged]
    if len(tagged) > 1:
        key, _ = schema.tags(tagged)
        alternatives: list[Json] = [{"oneOf": [_schema(kind, records) | {"required": [key]} for kind in tagged]}]
    else:
        alternatives = [_schema(kind, records) for kind in tagged]
    alternatives += others
    return alternatives[0] if len(alternatives) == 1 else {"anyOf": alternatives}


def _record(kind: Kind, records: _Records) -> Json:
    """The schema of a dataclass or NamedTuple; if it holds keyword arguments, an alternative for each function."""
    specification, comments = schema.fields_of(kind), schema.comments_of(kind)
    keywords = schema.keywords_of(kind)
    if keywords is None:
        return _object(specification, comments, summary_of(kind), records)
    field, rule = keywords
    fields = {name: entry for name, entry in specification.items() if name != field}
    alternatives = []
    for name, function in rule.functions.items():
        named = {rule.key: (Literal[name], dataclasses.MISSING)}
        parameters = schema.parameters_of(function)
        alternatives.append(
            _object(fields | named | parameters, comments | schema.comments_of(function), summary_of(function), records)
        )
    return _described(summary_of(kind)) | {"oneOf": alternatives}


def _object(specification: Specification, comments: Mapping[str, str], summary: str, records: _Records) -> Json:
    properties = {}
    for name, (kind, default) in specification.items():
        properties[name] = _schema(kind, records)
        properties[name] |= _described(comments.get(name) or meaning(kind, summary))
        if default is not dataclasses.MISSING:
            properties[name]["default"] = plain(default)
    return _described(summary) | {
        "type": "object",
        "properties": properties,
        "required": [name for name, (_, default) in specification.items() if default is dataclasses.MISSING],
        "additionalProperties": False,
    }


def meaning(kind: Kind, summary: str = "") -> str:
    """The description of a key without a comment: that of its dataclass, or of the alternative."""
    base, _ = schema.unwrapped(kind)
    if schema.origin_of(base) is Literal:
        return summary
    parts = typing.get_args(base) if schema.is_union(base) else (base,)
    records = [part for part in parts if schema.is_record(part)]
    return summary_of(records[0]) if len(records) == 1 else ""


def _described(text: str) -> Json:
    return {"description": text} if text else {}


def summary_of(described: Callable[..., Any]) -> str:
    """The first paragraph of a docstring; empty if `dataclass` has generated it."""
    text = inspect.getdoc(described) or ""
    return "" if text.startswith(f"{described.__name__}(") else " ".join(text.split("\n\n")[0].split())
