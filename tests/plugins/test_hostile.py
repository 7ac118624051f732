"""Plugins that are wrong in ways that a kernel or a table would not survive get an error with their line."""

import re

import pytest

from mercator_design.errors import FsmError, MissionError
from mercator_design.modules.flavour import define_flavour
from mercator_design.plugins.loading import load_plugin
from mercator_design.plugins.sources import read_plugin
from mercator_design.sim.checks import trial
from mercator_design.sim.checks.trial import try_flavour
from tests.plugins.walls import FLAVOUR, PLUGIN

pytestmark = pytest.mark.usefixtures("registries")
READ = "    x, y = readings.proximity_x, readings.proximity_y\n"


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")


def edited(old, new):
    assert old in PLUGIN
    return PLUGIN.replace(old, new, 1)


def marked(text):
    return edited('reads={"proximity"}, memory=1', text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (marked("memory=10**9"), "memory: expected a whole number from 0 to 64, found 1000000000"),
        (marked("memory=1.5"), "memory: expected a whole number from 0 to 64, found 1.5"),
        (marked("memory=True"), "memory: expected a whole number from 0 to 64, found True"),
        (marked("memory=0, end_mark=True"), "memory: expected a whole number from 1 to 64, found 0"),
        (marked('name="../../etc/passwd"'), "name: expected letters a to z and A to Z, digits, blanks and . _ + -, at"),
        (marked('name="st\\u043ep"'), "name: expected letters"),  # it looks like stop
        (marked('name="\\u202e stop"'), "name: expected letters"),
        (marked('name="a\\nb: c"'), "name: expected letters"),
        (marked('name="x" * 101'), "name: expected letters"),
        (marked("name=3"), "name: expected letters"),
        (marked("label=3"), "label: expected letters"),
        (edited("@condition(", '@condition(name="-", '), "name: expected letters"),
        (marked("words=7"), "wall following: words: expected a function that returns, found 7"),
        (marked("fails=3"), "wall following: fails: expected a function that returns, found 3"),
        (marked('reads="proximity"'), "wall following: senses: expected a set of words, found 'proximity'"),
        (marked("reads=None"), "wall following: senses: expected a set of words, found None"),
        (marked("reads={1}"), "expected senses of proximity, neighbours, "),
        (edited("def wall_following", "async def wall_following"), "expected a function that returns, found <function"),
        (edited(READ, READ + "    yield 1\n"), "expected a function that returns, found <function"),
        (edited("    gain:", "    *,\n    gain:"), "parameter gain: expected none behind a *"),
        (edited("[float, Range(0.1, 2)]", "[int, Range(0.1, 0.9)]"), "parameter gain: expected Annotated[float, Range"),
        (edited("Range(0.1, 2)", 'Range(float("nan"), 2)'), "parameter gain: expected Annotated[float, Range"),
        (edited("Range(0.1, 2)", "Range(0, 1e999)"), "parameter gain: expected Annotated[float, Range"),
        (edited("import math", "import math\nX = " + "(" * 5000 + ")" * 5000), "too many nested parentheses"),
        (edited("import math", "import math\nX = " + "-" * 100_000 + "1"), "a plugin that cannot be run: "),
    ],
)
def test_is_refused_when_it_is_loaded(tmp_path, text, message):
    (tmp_path / "walls.py").write_text(text)
    with pytest.raises(MissionError) as caught:
        load_plugin(tmp_path / "walls.py")
    assert re.match(rf"{tmp_path}/walls\.py(:\d+)?: ", str(caught.value))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (edited(READ, READ + "    exit()\n"), "behaviour wall following: SystemExit"),
        (
            edited(READ, READ + "    while True:\n        x = x\n"),
            "TimeoutError: it has not ended after 0.3 s; has it a",
        ),
        (edited(READ, READ + "    while gain > 1.9:\n        x = x\n"), "TimeoutError: it has not ended after 0.3 s"),
        (edited(READ, READ + "    readings.proximity_x = 1.0\n"), "readings cannot be changed, such as proximity_x"),
        (edited(READ, READ + "    memory[-2] = 1.0\n"), "list assignment index out of range (it declares memory=1)"),
        (edited(READ, READ + "    return wall_following(model, readings, memory, u, gain)\n"), "RecursionError"),
        (marked('reads={"proximity"}, memory=1, words=lambda swarm, gain: 5'), "expected a text of its words, found 5"),
        (marked('reads={"proximity"}, memory=1, words=lambda swarm, gain: 1 / 0'), "ZeroDivisionError"),
        (marked('reads={"proximity"}, memory=1, fails=lambda model: True'), "takes 1 positional argument but 3 were"),
        (
            marked('reads={"proximity"}, memory=1, fails=lambda model, readings, gain: "no"'),
            "expected True or False of",
        ),
    ],
)
def test_is_found_when_it_is_tried(tmp_path, monkeypatch, text, message):
    monkeypatch.setattr(trial, "MAX_CALL_TIME", 0.3)
    (tmp_path / "walls.py").write_text(text)
    load_plugin(tmp_path / "walls.py")
    problems = [one for each in try_flavour(define_flavour(FLAVOUR, "walls"), own_only=True) for one in each.problems]
    assert len(problems) == 1
    assert re.match(rf"{tmp_path}/walls\.py:\d+: behaviour wall following: ", problems[0])
    assert message in problems[0]


def test_words_that_fail_are_named_where_they_are_used(mdesign, tmp_path):
    (tmp_path / "walls.py").write_text(marked('reads={"proximity"}, memory=1, words=lambda swarm, gain: 1 / 0'))
    (tmp_path / "walls.yaml").write_text(FLAVOUR)
    (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 2 --gain0 1\n")
    given = ("--plugin", tmp_path / "walls.py", "--flavour", tmp_path / "walls.yaml")
    code, _, err = mdesign("fsm", "explain", tmp_path / "fsm.txt", *given)
    assert code == 3
    assert re.fullmatch(r"Error: /\S+/walls\.py:\d+: words of wall following: ZeroDivisionError: .*\n", err)


def test_linked_folders_of_a_package_are_refused(tmp_path):
    """Links to folders above would be followed for ever."""
    (tmp_path / "own" / "part").mkdir(parents=True)
    (tmp_path / "own" / "__init__.py").write_text(PLUGIN)
    for name in ("a", "b"):
        (tmp_path / "own" / "part" / name).symlink_to(tmp_path / "own" / "part")
    with pytest.raises(MissionError, match=r"own/part/a: expected a folder, found a link"):
        read_plugin(tmp_path / "own")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("architecture: tree\nbehaviours: {stop: 0}\nconditions: {light: 0}\nlimits: {branches: 11}",
         "limits.branches: expected an integer from 1 to 10, found 11"),
        ("architecture: tree\nbehaviours: {stop: 0}\nconditions: {light: 0}\nlimits: {conditions: 10}",
         "limits.conditions: expected an integer from 1 to 9, found 10"),
        ("base: own\nbehaviours: {stop: 0}\nconditions: {light: 0}", "base: unknown key"),
        ("behaviours: &x [*x]", "anchors and aliases (&, *) are not understood"),
        ("behaviours: " + "[" * 3000, "nested more than 32 levels deep"),
        ("behaviours: {stop: 0}\nconditions: {light: 0}\nconstants: {attraction_gain: 1e999}", "expected a number"),
    ],
)  # fmt: skip
def test_flavours_that_nothing_can_be_designed_with(text, message):
    with pytest.raises(FsmError) as caught:
        define_flavour(text, "own")
    assert message in str(caught.value)
    assert all(one.startswith("own") for one in caught.value.messages)
