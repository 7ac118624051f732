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
from mercator_design.sim.robot_model import RobotModel

DOCS = Path(__file__).parent
REFERENCE_MODEL = MadePart(DOCS / "reference" / "control-software.md", "reference model", "tables.py")
ROBOT_MODEL = MadePart(DOCS / "reference" / "robot-models.md", "robot model", "tables.py")

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
    REFERENCE_MODEL.write(reference_model())
    ROBOT_MODEL.write(robot_model())


if __name__ == "__main__":
    main()
