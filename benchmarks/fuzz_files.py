"""Missions and FSM texts with random mistakes: each is read, or refused with errors that name their places.

`python benchmarks/fuzz_files.py missions --count 10000` prints how many were read and refused, and ends at the first
that leads to anything else; `fsms` does the same for FSM texts. The same numbers give the same texts.
"""

import argparse
import collections
import copy
import functools
import json
import random
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.config import shipped
from mercator_design.errors import FsmError, MissionError
from mercator_design.fsm.text import parse, to_text
from mercator_design.missions.mission import parse_mission
from mercator_design.modules.flavour import flavour_names
from mercator_design.sim.checks.no_effect import no_effect_warnings
from mercator_design.sim.simulate import Simulator

_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_FSMS = json.loads((Path(__file__).parents[1] / "tests/data/published_fsms.json").read_text())
_PLACED = re.compile(r"(fuzzed(:\d+)?|--set [^\n]*): ", re.DOTALL)
_WHOLE = ("not valid YAML", "found an empty text", "its reading ended")
"""Of a text as a whole, which has no line."""
_DEEPLY = 20
"""Every so many-th of the missions that can be read is also set up and looked at as `mdesign validate` does."""

_ODD = [
    "", "0", "-1", "1e9", "-1e-9", "nan", "1e400", "90", "360", "0.1", "2", "1000", "true", "null", "~", "x", "'1'",
    "[]", "{}", "[1, 2]", "[[0, 0]]", "black", "grey", "[300, 0, 0]", "disc", "always", "mercator", "epuck",
    "./nowhere.yaml", "\u202e", "&a 1", "*a", "!x 1", "1_000", "12 m", "0x10", "1,5", "robots_in_zone", "trips", "spot",
]  # fmt: skip
_ODD_TOKENS = [
    "-1", "0", "1e9", "nan", "inf", "1e400", "9" * 400, "0.5", "7", "x", "--", "--s9", "--n0x9", "--n0", "\0", "é",
]  # fmt: skip
_KEYS = [
    "radius", "colour", "color", "center", "centre", "zones", "name", "shape", "size", "angle", "extra", "objective",
    "robots", "base", "sources", "nests", "when", "share", "dynamics", "obstacles", "vertices", "height", "heading",
]  # fmt: skip
_OVERRIDES = [
    "robots=0", "robots=900", "duration=0.05", "floor.zones=[]", "floor.zones[0].radius=-1", "objective.zones=[x]", "x",
    "placement.radius=0.01", "arena.walls.apothem=0.01", "robot_model=nobody", "floor.zones[9].color=red", "a.b[3]=1",
    "objective.direction=maximize", "floor.background=grey", "robots=3", "robots=4",
]  # fmt: skip


def fuzzed_mission(number: int) -> tuple[str, list[str], Path]:
    """The text of a shipped mission with some mistakes, overrides for it, and the folder that its paths start from."""
    draw = random.Random(f"mission {number}")
    path = draw.choice([*shipped.missions().values()])
    text, tree = _shipped(path)
    if draw.random() < 0.75:
        tree = copy.deepcopy(tree)
        for _ in range(draw.randint(1, 4)):
            _spoil(tree, draw)
        text = yaml.dump(tree, Dumper=_DUMPER, sort_keys=False, default_flow_style=draw.choice([None, True, False]))
        text = re.sub(r"'@(.*?)@'", r"\1", text)
    for _ in range(draw.choice([0, 0, 1, 3])):
        text = _scratched(text, draw)
    return text, draw.sample(_OVERRIDES, draw.choice([0, 0, 0, 1, 2])), path.parent


@functools.cache
def _shipped(path: Path) -> tuple[str, Any]:
    """The text of a mission, and its tree."""
    text = path.read_text()
    return text, yaml.safe_load(text)


def _spoil(tree: Any, draw: random.Random) -> None:
    """Change something somewhere in a tree."""
    node, key = tree, draw.choice([*tree])
    while isinstance(node[key], dict | list) and node[key] and draw.random() < 0.75:
        node = node[key]
        key = draw.choice([*node] if isinstance(node, dict) else range(len(node)))
    kind = draw.randrange(6)
    if kind == 0:
        del node[key]
    elif kind == 1 and isinstance(node, dict):
        node[draw.choice(_KEYS)] = node.pop(key) if draw.random() < 0.5 else node[key]
    elif kind == 2 and isinstance(node, list):
        node.append(node[key])
    elif kind == 3 and isinstance(node[key], int | float):
        node[key] = node[key] * draw.choice([-1, 0, 1e-3, 2, 57.3, 1e4, 1e12])
    elif kind == 4 and isinstance(node, dict):
        word = str(key)
        node[word[: len(word) // 2] + word[len(word) // 2 + 1 :]] = node.pop(key)
    else:
        node[key] = f"@{draw.choice(_ODD)}@"
    if not tree:
        tree["schema"] = 1


def _scratched(text: str, draw: random.Random) -> str:
    """A text in which some characters, or a line, are others."""
    lines = text.split("\n")
    place, kind = draw.randrange(len(text) + 1), draw.randrange(5)
    if kind == 0:
        return text[:place] + text[place + draw.randint(1, 9) :]
    if kind == 1:
        return text[:place] + draw.choice("\t:{}[],&*!#'\"%@\0é\u2028 \n0-") + text[place:]
    number = draw.randrange(len(lines))
    if kind == 2:
        lines.insert(draw.randrange(len(lines)), lines[number])
    elif kind == 3:
        del lines[number]
    else:
        lines[number] = " " * draw.randint(0, 5) + lines[number].strip()
    return "\n".join(lines)


def read_mission(number: int) -> str:
    """What came of a fuzzed mission, in words.

    Raises:
        AssertionError: if an error does not name its place.
    """
    text, overrides, folder = fuzzed_mission(number)
    try:
        mission = parse_mission(text, name="fuzzed", folder=folder, overrides=overrides)
    except MissionError as error:
        _check_places(error)
        return f"refused, {'one mistake' if len(error.messages) == 1 else 'several mistakes'}"
    if number % _DEEPLY or mission.arena.area > 100.0 or mission.robots > 50:
        return "read"
    try:
        simulator = Simulator(mission)
        simulator.instance(0)
        doubtful = [
            *simulator.warnings,
            *no_effect_warnings(
                mission, simulator.robot_model, flavour_names()[number // _DEEPLY % len(flavour_names())]
            ),
        ]
    except MissionError as error:
        _check_places(error)
        return "set up, refused"
    return "set up, doubtful" if doubtful else "set up"


def _check_places(error: MissionError) -> None:
    for message in error.messages:
        place = _PLACED.match(message)
        assert place, f"no place: {message}"  # noqa: S101 - what is looked for
        has_line = place[2] or message.startswith("--set")
        assert has_line or any(words in message for words in _WHOLE), f"no line: {message}"  # noqa: S101


def fuzzed_fsm(number: int) -> str:
    """A published FSM with some mistakes."""
    draw = random.Random(f"fsm {number}")
    tokens = draw.choice(_texts()).split()
    for _ in range(draw.randint(1, 4)):
        place, kind = draw.randrange(len(tokens) + 1), draw.randrange(6)
        if kind == 0:
            del tokens[place : place + draw.randint(1, 3)]
        elif kind == 1:
            tokens.insert(place, draw.choice(tokens or ["--s0"]))
        elif kind == 2:
            odd = draw.choice(_ODD_TOKENS)
            tokens[place : place + 1] = [odd]
        elif kind == 3 and place < len(tokens):
            tokens[place] = re.sub(r"[0-9]", lambda _: str(draw.randrange(10)), tokens[place])
        elif kind == 4 and place < len(tokens):
            tokens[place] = tokens[place][: draw.randrange(len(tokens[place]) + 1)]
        else:
            draw.shuffle(tokens[place : place + 6])
    return draw.choice([" ", "  ", "\t"]).join(tokens)


def _texts() -> list[str]:
    found: list[str] = []

    def look(value: Any) -> None:
        if isinstance(value, str) and "--nstates" in value:
            found.append(value)
        for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            look(each)

    look(_FSMS)
    return found


def read_fsm(number: int) -> str:
    """What came of a fuzzed FSM text, in words; what can be read means the same when it is written and read again."""
    text, flavour = fuzzed_fsm(number), flavour_names()[number % len(flavour_names())]
    warnings: list[str] = []
    is_lenient = bool(number // len(flavour_names()) % 2)
    try:
        pfsm = parse(text, flavour, tolerate=warnings.append if is_lenient else None)
    except FsmError as error:
        return "refused" if str(error) else "refused without a word"
    assert parse(to_text(pfsm), flavour, tolerate=warnings.append if is_lenient else None) == pfsm, text  # noqa: S101
    return "read, with warnings" if warnings else "read"


KINDS: dict[str, Callable[[int], str]] = {"missions": read_mission, "fsms": read_fsm}


def main() -> None:
    """Read some, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=[*KINDS])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    given = parser.parse_args()
    results: collections.Counter[str] = collections.Counter()
    for number in range(given.first, given.first + given.count):
        try:
            results[KINDS[given.kind](number)] += 1
        except Exception:  # noqa: BLE001 - whatever it is, it is what is looked for
            traceback.print_exc()
            sys.exit(f"{given.kind} {number}")
    print(f"{given.kind} {given.first} to {given.first + given.count - 1}: {dict(sorted(results.items()))}")


if __name__ == "__main__":
    main()
