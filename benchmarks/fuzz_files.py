"""Missions and control software with random mistakes: each is read, or refused with errors that name their places.

`python benchmarks/fuzz_files.py missions --count 10000` prints how many were read and refused, and ends at the first
that leads to anything else; `fsms`, `trees`, `networks` and `genomes` do the same for control software. The same
numbers give the same texts.
"""

import argparse
import collections
import copy
import functools
import gzip
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
from mercator_design.modules.module import KnownSwarm
from mercator_design.network.genome import Genome, genome_text
from mercator_design.network.network import KINDS as NODES
from mercator_design.network.network import Gene, Network, NetworkNode
from mercator_design.network.text import to_text as network_text
from mercator_design.show.machines.picture import software_svg
from mercator_design.sim.checks.no_effect import no_effect_warnings
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import architecture_of
from mercator_design.software.files import fsm_file_text, fsm_of

_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_DATA = Path(__file__).parents[1] / "tests" / "data"
_FSMS = json.loads((_DATA / "published_fsms.json").read_text())
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
    return _spoilt(draw.choice(_texts()), draw)


def _spoilt(text: str, draw: random.Random) -> str:
    """A command line in which some tokens are others."""
    tokens = text.split()
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
    flavours = flavour_names("pfsm")
    text, flavour = fuzzed_fsm(number), flavours[number % len(flavours)]
    warnings: list[str] = []
    is_lenient = bool(number // len(flavours) % 2)
    try:
        pfsm = parse(text, flavour, tolerate=warnings.append if is_lenient else None)
    except FsmError as error:
        return "refused" if str(error) else "refused without a word"
    assert parse(to_text(pfsm), flavour, tolerate=warnings.append if is_lenient else None) == pfsm, text  # noqa: S101
    return "read, with warnings" if warnings else "read"


def fuzzed_tree(number: int) -> str:
    """A published behaviour tree with some mistakes."""
    draw = random.Random(f"tree {number}")
    return _spoilt(draw.choice(_trees()), draw)


@functools.cache
def _trees() -> list[str]:
    found = json.loads(gzip.decompress((_DATA / "maple_trees.json.gz").read_bytes()))
    return [one["text"] for one in found["published"]]


def fuzzed_network(number: int) -> str:
    """A published network, as a line, with some mistakes."""
    draw = random.Random(f"network {number}")
    return _spoilt(network_text(draw.choice(_networks())), draw)


def fuzzed_genome(number: int) -> str:
    """The file of a published genome with some mistakes."""
    draw = random.Random(f"genome {number}")
    text = genome_text(Genome(network=draw.choice(_networks())))
    for _ in range(draw.randint(1, 3)):
        lines = text.split("\n")
        place = draw.randrange(len(lines))
        if draw.random() < 0.7 and lines[place]:
            lines[place] = _spoilt(lines[place], draw)
            text = "\n".join(lines)
        else:
            text = _scratched(text, draw)
    return text


@functools.cache
def _networks() -> list[Network]:
    found = json.loads(gzip.decompress((_DATA / "published_networks.json.gz").read_bytes()))
    return [_network(one["genome"]) for one in found["networks"]]


def _network(genome: dict[str, Any]) -> Network:
    nodes = tuple(NetworkNode(number, NODES[kind]) for number, kind in genome["nodes"])
    return Network(nodes, tuple(Gene(source, to, weight, bool(on)) for source, to, weight, on in genome["genes"]))


def read_software(text: str, flavours: tuple[str, ...], number: int) -> str:
    """What came of control software, in words; what can be read means the same when it is written and read again.

    Raises:
        AssertionError: if something is read otherwise the second time.
    """
    flavour = flavours[number % len(flavours)]
    warnings: list[str] = []
    lenient = warnings.append if number // len(flavours) % 2 else None
    try:
        found = fsm_of(text, "fuzzed", flavour, tolerate=lenient)
    except FsmError as error:
        return "refused" if all(map(_PLACED.match, error.messages)) else "refused without a place"
    again = fsm_of(fsm_file_text(found.software, {}), "again", flavour, tolerate=lenient)
    assert again.software == found.software, text  # noqa: S101
    software_svg(found.software)
    names = architecture_of(flavour).names(found.software)
    assert architecture_of(flavour).explanation(found.software, names, KnownSwarm(0.1)), text  # noqa: S101
    return "read, with warnings" if warnings else "read"


_MAPLES = ("maple", "maple-epuck", "maple-mercator")
_STICKS = ("evostick", "evostick-epuck")
KINDS: dict[str, Callable[[int], str]] = {
    "missions": read_mission,
    "fsms": read_fsm,
    "trees": lambda number: read_software(fuzzed_tree(number), _MAPLES, number),
    "networks": lambda number: read_software(fuzzed_network(number), _STICKS, number),
    "genomes": lambda number: read_software(fuzzed_genome(number), _STICKS, number),
}


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
