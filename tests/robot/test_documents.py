"""What the documents say of a robot's limits is what the program does."""

import re
from dataclasses import asdict
from pathlib import Path

import pytest

from mercator_design.robot.devices.health import ANSWER_LIMIT, ANSWERS_WINDOW, MIN_ANSWERS, WINDOW, warning_share
from mercator_design.robot.devices.settings import COMMANDS_END, CONTROL_PERIOD, Limits, parse_settings
from mercator_design.robot.protocols.joint_start import LEAD, SILENCE
from mercator_design.robot.run.mercator import QUERY_EVERY
from mercator_design.robot.run.safety import STALL

ROOT = Path(__file__).parents[2]
REFERENCE, EXPLANATION = ROOT / "docs" / "reference", ROOT / "docs" / "explanation"
SAFETY = (REFERENCE / "robot-safety.md").read_text()
SETTINGS = (REFERENCE / "robot-yaml.md").read_text()
GUIDE = (ROOT / "docs" / "how-to" / "operate-a-robot.md").read_text()
LINES = (EXPLANATION / "robot-lines.md").read_text()
JOINT = (EXPLANATION / "starting-together.md").read_text()
LIMITS = Limits()


def rows():
    """The table of what stops the wheels, by its first column."""
    table = SAFETY.partition("\n## What stops the wheels")[2].partition("Measured is")[0]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:2] == "| "]
    return {first: rest for first, *rest in cells}


def row(words):
    ((what, rest),) = [(what, rest) for what, rest in rows().items() if words in what]
    return " | ".join([what, *rest])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("is silent", f"RVR {LIMITS.rvr:g} s, hub {LIMITS.proximity:g} s, lidar {LIMITS.lidar:g} s"),
        ("is silent", f"{CONTROL_PERIOD:g} s after the limit"),
        ("sees nothing", f"for {LIMITS.lidar_blind:g} s of the last {2.0 * LIMITS.lidar_blind:g} s"),
        ("control loop stalls", f"no command for {STALL:g} s"),
        ("of what a device sends", f"RVR's bytes and the lidar's turns less than {100 * LIMITS.rvr_whole:g} %"),
        ("of what a device sends", f"of the hub's bytes less than {100 * LIMITS.proximity_whole:g} %"),
        ("of what a device sends", f"over the last {WINDOW:g} s"),
        ("of what a device sends", f"{WINDOW + CONTROL_PERIOD:g} s at most"),
        ("answers less than", f"answers less than {100 * LIMITS.rvr_whole:g} %"),
        ("answers less than", f"over the last {ANSWERS_WINDOW:g} s"),
        ("answers less than", f"{ANSWERS_WINDOW + ANSWER_LIMIT + CONTROL_PERIOD:g} s at most"),
        ("limits.battery_critical", f"{QUERY_EVERY + CONTROL_PERIOD:g} s"),
        ("killed or suspended", f"no command for {COMMANDS_END:g} s"),
        ("hears nothing", f"by the RVR after {COMMANDS_END:g} s"),
    ],
)
def test_what_stops_the_wheels(words, expected):
    assert expected in row(words)


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        (
            SAFETY,
            f"RVR and lidar {100 * warning_share(LIMITS.rvr_whole):g} %, hub "
            f"{100 * warning_share(LIMITS.proximity_whole):g} %",
        ),
        (LINES, f"if there were fewer than {MIN_ANSWERS}, the others count"),
        (GUIDE, f"makes its commands end after {1000 * COMMANDS_END:g} ms"),
        (JOINT, f"3. All robots receive a start time, {LEAD:g} s ahead"),
        (JOINT, f"after {SILENCE:g} s of silence, or when the connection ends"),
    ],
    ids=["damage", "answers", "commands", "start", "silence"],
)
def test_other_limits(document, expected):
    assert expected in " ".join(document.split())


def test_the_robot_yaml_in_the_documents_has_the_default_limits():
    (block,) = re.findall(r"```\n(schema: 1 .*?)```", SETTINGS, re.DOTALL)
    assert asdict(parse_settings(block, "robot.yaml", ROOT).limits) == asdict(LIMITS)


def test_the_readme_has_what_was_measured():
    readme = " ".join((ROOT / "README.md").read_text().split())
    silent, killed = rows()[next(key for key in rows() if "is silent" in key)][-1], row("killed")
    told = f"killed or suspended {killed.rpartition('| ')[2]}, RVR silent {silent.removeprefix('RVR ')}"
    assert told in readme
