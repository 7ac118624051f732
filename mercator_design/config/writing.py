"""Writes a dataclass as YAML that people and `parse` can read."""

import functools
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import yaml

from mercator_design.config import schema


def dump(value: object) -> str:
    """The YAML text of a dataclass, with every default filled in: `parse(dump(x), type(x))` equals x."""
    return _text_of(json.dumps(plain(value)))


def digest_of(value: object) -> str:
    """16 hexadecimal digits; equal for values whose texts (`dump`) are equal."""
    return hashlib.sha256(dump(value).encode()).hexdigest()[:16]


@functools.lru_cache(maxsize=64)
def _text_of(data: str) -> str:
    """The YAML text of JSON data. Most of a program's texts are of the same few missions and robots."""
    return yaml.dump(json.loads(data), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=100)


def plain(value: object) -> Any:  # noqa: ANN401 - dicts, lists and scalars
    """A dataclass, or a value of one, as dicts, lists and scalars."""
    if schema.is_record(value):
        kind: schema.Kind = type(value)
        keywords = schema.keywords_of(kind)
        fields = {name: plain(getattr(value, name)) for name in schema.fields_of(kind)}
        for name in getattr(kind, "UNWRITTEN", ()):  # keys that are not written if null or empty: older digests hold
            if fields[name] is None or fields[name] == []:
                del fields[name]
        return fields | fields.pop(keywords[0]) if keywords else fields
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


class Dumper(yaml.SafeDumper):
    """Mappings in block style, lists of scalars in one line, long texts with their line breaks."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - yaml's signature
        return True


def _represent_list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.SequenceNode:
    flow = not any(isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flow)


def _represent_str(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    printable = all(line.isprintable() for line in text.split("\n"))
    style = '"' if not printable else "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


Dumper.add_representer(list, _represent_list)
Dumper.add_representer(str, _represent_str)
