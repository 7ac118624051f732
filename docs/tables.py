"""Writes the tables in the documents that are made from the code. Run: python docs/tables.py"""

import re
from pathlib import Path

from mercator_design.files import write_text
from mercator_design.json_schema import json_schema
from mercator_design.sim.robot_model import RobotModel

DOCUMENT = Path(__file__).parent / "control_software.md"
BEGIN, END = "<!-- reference model: made by docs/tables.py -->\n", "\n<!-- end of the reference model -->\n"


def reference_model() -> str:
    """Key, default, unit and meaning of every constant, from the comments behind them."""
    keys = json_schema(RobotModel, title="")["$defs"]["ReferenceModel"]["properties"]
    lines = ["| key | default | unit | what |", "|---|---|---|---|"]
    for key, entry in keys.items():
        unit, meaning = re.fullmatch(r"(?:\[(.+?)\] )?(.+)", entry["description"]).groups("")
        lines.append(f"| `{key}` | {entry['default']:.6g} | {unit} | {meaning} |")
    return "".join(f"{line}\n" for line in ["", *lines])


def main() -> None:
    before, _, rest = DOCUMENT.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    write_text(DOCUMENT, before + BEGIN + reference_model() + END + after)


if __name__ == "__main__":
    main()
