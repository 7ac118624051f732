"""Plugins and flavour files with random mistakes: each is read, or refused with errors that name their places.

`python benchmarks/fuzz_plugins.py plugins --count 1000` prints how many were loaded, found wrong when their modules
were tried (in plain Python), and refused, and ends at the first that leads to anything else; `flavours` does the same
for flavour files. The same numbers give the same texts.
"""

import argparse
import collections
import os
import random
import re
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.config import shipped
from mercator_design.errors import MercatorError
from mercator_design.modules.flavour import define_flavour, flavour_names
from mercator_design.plugins.loading import load_plugin, loaded_plugins, snapshot
from mercator_design.sim.checks.trial import try_flavour

_TUTORIAL = (Path(__file__).parents[1] / "docs/tutorials/your-own-behaviour.md").read_text()
PLUGIN, FLAVOUR = (re.findall(rf"```{kind}\n(.+?)```", _TUTORIAL, re.DOTALL)[0] for kind in ("python", "yml"))
_ODD = [
    "", "0", "-1", "1e400", "None", "True", "float('nan')", "x", "readings", "memory", "u", "()", "(1.0, 2.0)",
    "[]", "{}", "'text'", "b''", "lambda: 0", "1 / 0", "memory[9]", "raise", "return", "yield", "import", "@", ":",
    "def", "class A: pass", "Range(1, 0)", "Range()", "int", "str", "list", "Literal['a']", "reads={'sonar'}",
    "memory=99", "memory='a'", "sets={1}", "name=3", "label=None", "words=7", "exit()", "math.nan", "\u202e", "\0",
    "é", "*", "**", "->", "__name__", "print",
]  # fmt: skip
_ODD_YAML = [
    "", "0", "-1", "1e9", "nan", "null", "[]", "{}", "x", "'1'", "pfsm", "tree", "network", "&a 1", "*a", "!x 1",
    "\u202e", "wall following", "exploration", "{states: 99}", "{states: 2}", "{weakest_pull: -1}", "{no_such: 1}",
    "99", "[1, 2]",
]  # fmt: skip
_TOKEN = re.compile(r"\w+|[^\w\s]|\n[ ]*")
_FILE = "fuzzed.py"


def _require(condition: bool, words: str) -> None:
    if not condition:
        raise ValueError(words)


def fuzzed_plugin(number: int) -> str:
    """The text of a plugin with some mistakes."""
    return _spoilt(PLUGIN, _ODD, random.Random(f"plugin {number}"))


def fuzzed_flavour(number: int) -> str:
    """The text of a flavour file with some mistakes."""
    draw = random.Random(f"flavour {number}")
    texts = [FLAVOUR, *(file.read_text("utf-8") for file in shipped.flavours().values())]
    return _spoilt(draw.choice(texts), _ODD_YAML, draw)


def _spoilt(text: str, odd: list[str], draw: random.Random) -> str:
    tokens = _TOKEN.findall(text)
    spaced = re.split(_TOKEN, text)
    for _ in range(draw.choice([1, 1, 1, 2, 4])):
        place = draw.randrange(len(tokens))
        match draw.randrange(5):
            case 0:
                tokens[place] = draw.choice(odd)
            case 1:
                tokens[place] = ""
            case 2:
                tokens[place] += f" {draw.choice(odd)}"
            case 3:
                other = draw.randrange(len(tokens))
                tokens[place], tokens[other] = tokens[other], tokens[place]
            case 4:
                tokens[place] = draw.choice(tokens)
    return "".join(space + token for space, token in zip(spaced, [*tokens, ""], strict=True))


def outcome_of_plugin(number: int, folder: Path) -> str:
    """What becomes of a fuzzed plugin; ValueError if that is not as it should be."""
    restore, file = snapshot(), folder / _FILE
    file.write_text(fuzzed_plugin(number), encoding="utf-8")
    before = flavour_names(), loaded_plugins()
    try:
        try:
            load_plugin(file)
        except MercatorError as error:
            _require(_FILE in str(error), f"no place: {error}")
            _require((flavour_names(), loaded_plugins()) == before, "something was left behind")
            return "refused"
        try:
            trials = [*try_flavour(define_flavour(FLAVOUR, "walls"), own_only=True)]
        except MercatorError as error:
            _require(_FILE in str(error) or str(error).startswith("walls:"), f"no place: {error}")
            return "not of the flavour"
        problems = [problem for trial in trials for problem in trial.problems]
        _require(all(_FILE in problem for problem in problems), f"no place: {problems}")
        return "found wrong" if problems else "loaded"
    finally:
        restore()


def outcome_of_flavour(number: int, folder: Path) -> str:
    """What becomes of a fuzzed flavour; ValueError if that is not as it should be."""
    restore = snapshot()
    (folder / "walls.py").write_text(PLUGIN)
    try:
        load_plugin(folder / "walls.py")
        define_flavour(fuzzed_flavour(number), "fuzzed")
    except MercatorError as error:
        placed = all(message.startswith("fuzzed") for message in error.messages)
        _require(placed, f"no place: {error}")
        return "refused"
    finally:
        restore()
    return "read"


KINDS: dict[str, tuple[Callable[[int], str], Callable[[int, Path], str]]] = {
    "plugins": (fuzzed_plugin, outcome_of_plugin),
    "flavours": (fuzzed_flavour, outcome_of_flavour),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiling a thousand plugins would take an hour
    text, outcome = KINDS[given.kind]
    found = collections.Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.first, given.first + given.count):
            try:
                found[outcome(number, Path(folder))] += 1
            except (Exception, SystemExit):  # noqa: BLE001 - any is a fault
                traceback.print_exc()
                sys.exit(f"{given.kind} {number}:\n{text(number)}")
    print(", ".join(f"{count} {what}" for what, count in sorted(found.items())))


if __name__ == "__main__":
    main()
