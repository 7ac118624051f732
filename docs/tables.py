"""Writes the tables in the documents that are made from the code. Run: python docs/tables.py"""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from docs.made_part import MadePart, table
from mercator_design.config.json_schema import json_schema
from mercator_design.config.schema import comments_of
from mercator_design.modules.reference import SENSES, Readings, sense_of
from mercator_design.sim.robot_model import RobotModel

DOCS = Path(__file__).parent
REFERENCE_MODEL = MadePart(DOCS / "reference" / "control-software.md", "reference model", "tables.py")
ROBOT_MODEL = MadePart(DOCS / "reference" / "robot-models.md", "robot model", "tables.py")
SENSES_TABLE = MadePart(DOCS / "reference" / "control-software.md", "senses", "tables.py")

HEADER = ("key", "default", "unit", "what")
SCHEMA = json_schema(RobotModel, title="")
TOLD_ELSEWHERE = {"ReferenceModel", "Gaussian", "Uniform"}


def reference_model() -> str:
    """Key, default, unit and meaning of every constant, from the comments behind them."""
    keys = SCHEMA["$defs"]["ReferenceModel"]["properties"]
    return table(
        HEADER, [row(f"`{key}`", entry["description"], f"{entry['default']:.6g}") for key, entry in keys.items()]
    )


def robot_model() -> str:
    """The same of every key of a robot model, section by section."""
    rows = []
    for key, entry in SCHEMA["properties"].items():
        sections = [SCHEMA["$defs"][name] for name in records(entry) if name not in TOLD_ELSEWHERE]
        if not sections:
            rows.append(row(f"**`{key}`**", entry["description"], default(SCHEMA, key)))
        for section in sections:
            tags = [f" `{tag}: {each['const']}`" for tag, each in section["properties"].items() if "const" in each]
            meaning = section["description"] if tags else entry["description"]
            rows.append(row("".join([f"**`{key}`**", *tags]), meaning, default(SCHEMA, key)))
            for name, each in section["properties"].items():
                if "const" not in each:
                    rows.append(row(f"`{key}.{name}`", each["description"], default(section, name)))
    return table(HEADER, rows)


def senses() -> str:
    """Readings of each sense, with the comments behind them, and the devices that measure it."""
    meanings, neutral = comments_of(Readings), Readings()._asdict()
    rows = []
    for name, sense in SENSES.items():
        groups: list[list[str]] = []  # a comment is that of the fields behind its own, too
        for field in (each for each in Readings._fields if sense_of(each) == name):
            if field in meanings:
                groups.append([])
            groups[-1].append(field)
        told = [f"{names(group)}: {meanings[group[0]]}" for group in groups]
        values = {f"{value:g}" for field, value in neutral.items() if sense_of(field) == name}
        rows.append([f"`{name}`", "; ".join(told), *values, f"`{sense.device}`", sense.sample or "none"])
    return table(("sense", "readings", "neutral", "device in simulation", "sensor of the robot"), rows)


def names(fields: list[str]) -> str:
    """Fields of a sense; only the first and the last of them if they are numbered."""
    is_numbered = fields[-1].rpartition("_")[2].isdigit()
    return " to ".join(f"`{field}`" for field in (fields[0], fields[-1])) if is_numbered else f"`{'`, `'.join(fields)}`"


def records(entry: Any) -> Iterator[str]:
    """The names of the dataclasses that a value may be."""
    if "$ref" in entry:
        yield entry["$ref"].rpartition("/")[2]
    for alternative in [*entry.get("anyOf", []), *entry.get("oneOf", [])]:
        yield from records(alternative)


def default(record: dict[str, Any], key: str) -> str:
    """What a key is if it is left out; nothing is said of a section whose keys say it."""
    if key in record["required"] and key != "name":
        return "required"
    value = record["properties"][key].get("default")
    return "" if value == "" or isinstance(value, dict) or key == "name" else json.dumps(value)


def row(key: str, description: str, value: str) -> list[str]:
    unit, meaning = re.fullmatch(r"(?:\[(.+?)\] )?(.+)", description).groups("")
    return [key, value, unit, meaning]


def main() -> None:
    SENSES_TABLE.write(senses())
    REFERENCE_MODEL.write(reference_model())
    ROBOT_MODEL.write(robot_model())


if __name__ == "__main__":
    main()
