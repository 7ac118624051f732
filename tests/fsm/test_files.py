"""fsm.yaml and fsm.txt hold the same, and mistakes in either are named."""

import json
import random
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from mercator_design.config.json_schema import json_schema
from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse
from mercator_design.fsm.words.names import state_names
from mercator_design.fsm.yaml_form import NamedPfsm, parse_yaml
from mercator_design.modules.conditions import COLOUR_LABELS
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, KnownSwarm
from mercator_design.modules.words import module_words
from mercator_design.software.files import FsmFile, fsm_file_text, fsm_yaml_text, read_fsm
from tests.fsm.strategies import FLAVOURS, MAX_STATES, MAX_TRANSITIONS, OF_NAME, WORD, pfsms
from tests.tiers import cases, some

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
SCHEMA = Draft202012Validator(json_schema(NamedPfsm, title="A PFSM"))
GOOD = """\
schema: 1
header: {mission: home, control period: 0.1}
states:
  - name: search
    behaviour: exploration
    tau: 20
    transitions:
      - {condition: floor color, beta: 0.5, label: blue, to: rest}
  - name: rest
    behaviour: stop
"""
NAME = st.builds(
    "{}{}".format,
    st.sampled_from("azAZ09_é"),
    st.just("") | st.builds("{}{}".format, st.text(OF_NAME, max_size=6), WORD),
)


def from_yaml(text, flavour=None, **given):
    named = parse_yaml(text, "fsm.yaml", flavour, **given)
    return FsmFile(software=named.pfsm(**given), header=named.header or {}, names=named.names)


def random_file(draws: random.Random) -> FsmFile:
    """Any PFSM, with names or without, with a header or without."""
    flavour = draws.choice(FLAVOURS)

    def made(kind):
        module = draws.choice(list(flavour_of(flavour).numbered(kind).values()))
        return module.name, tuple(
            float(draws.randint(int(p.low), int(p.high))) if p.integer else round(draws.uniform(p.low, p.high), digits)
            for p in module.parameters
        )

    n, digits = draws.randint(1, MAX_STATES), draws.choice((2, 17))
    states = []
    for i in range(n):
        others = [k for k in range(n) if k != i]
        m = draws.randint(0, MAX_TRANSITIONS) if others else 0
        edges = (Transition(*made("condition"), draws.choice(others)) for _ in range(m))
        states.append(State(*made("behaviour"), tuple(edges)))
    words = ["no", "1", "1e5", "null", "a b", "x.y", "é", "2024-01-01", "~a".strip("~"), "state_1"]
    names = tuple(draws.sample(words, n)) if draws.random() < 0.5 else ()
    header = {"mission": "home", "set": '["robots=4"]', "score": "2.97 (mean)"} if draws.random() < 0.5 else {}
    return FsmFile(software=Pfsm(tuple(states), flavour), header=header, names=names)


def check_round_trip(file: FsmFile, path: Path) -> None:
    again = from_yaml(fsm_yaml_text(file))
    assert again == file
    path.write_text(fsm_file_text(again.pfsm, again.header, again.names))
    assert read_fsm(path) == file


@pytest.mark.swept
@pytest.mark.parametrize("flavour", some(FLAVOURS, 1))
def test_published_controllers_round_trip(flavour, tmp_path):
    for line in PUBLISHED[flavour].values():
        file = FsmFile(software=parse(line, flavour), header={"mission": "home"})
        check_round_trip(file, tmp_path / "fsm.txt")
        SCHEMA.validate(yaml.safe_load(fsm_yaml_text(file)))


@given(pfsms(), st.lists(NAME, min_size=MAX_STATES, max_size=MAX_STATES, unique=True), st.booleans())
def test_any_pfsm_round_trips(pfsm, names, named):
    file = FsmFile(software=pfsm, header={}, names=tuple(names[: len(pfsm.states)]) if named else ())
    assert from_yaml(fsm_yaml_text(file)) == file
    SCHEMA.validate(yaml.safe_load(fsm_yaml_text(file)))


@pytest.mark.thorough
def test_many_round_trip(tmp_path):
    draws = random.Random(1)
    for _ in cases(2000):
        check_round_trip(random_file(draws), tmp_path / "fsm.txt")


def test_some_of_these_round_trip(tmp_path):
    draws = random.Random(2)
    for _ in range(50):
        check_round_trip(random_file(draws), tmp_path / "fsm.txt")


def test_each_module_has_words_and_comments_for_its_parameters():
    swarm = KnownSwarm(cycle=0.1, robots=4)
    for module in (*BEHAVIOURS.values(), *CONDITIONS.values()):
        assert module.sentence
        assert list(module.meanings) == [parameter.name for parameter in module.parameters]
        assert module_words(module, tuple(parameter.low for parameter in module.parameters), swarm)
    assert CONDITIONS["floor colour"].parameters[-1].labels == COLOUR_LABELS


def test_the_content_decides_how_a_file_is_read(tmp_path):
    path = tmp_path / "fsm.txt"  # as a robot gets a copy of either
    for text in (GOOD, "# mine\n\n" + GOOD, json.dumps(yaml.safe_load(GOOD) | {"header": {"control period": "0.1"}})):
        path.write_text(text)
        file = read_fsm(path)
        assert file.names == ("search", "rest")
        assert file.header["control period"] == "0.1"
        assert file.pfsm == parse("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 6 --p0x0 0.5 --l0x0 1 --s1 1")


def test_usual_names_are_those_of_behaviours_and_not_in_a_header():
    pfsm = parse("--nstates 3 --s0 1 --s1 0 --rwm1 3 --s2 1")
    assert state_names(pfsm) == ("stop 1", "exploration", "stop 2")
    assert "state names" not in fsm_file_text(pfsm, {}, state_names(pfsm))
    assert "# state names: a, b, c\n" in fsm_file_text(pfsm, {}, ("a", "b", "c"))


@pytest.mark.parametrize("names", ["a", "a, a", "a, b, c", "a, ", "a, <b>"])
def test_wrong_names_in_a_header(tmp_path, names):
    path = tmp_path / "fsm.txt"
    path.write_text(f"# state names: {names}\n--nstates 2 --s0 1 --s1 1\n")
    with pytest.raises(FsmError, match="state names in the header: expected 2 different names"):
        read_fsm(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tau: 20", "tau: 200", r"fsm.yaml:6: states\[0\].tau: expected .* <= 100 \[cycles\], found \"200\""),
        ("tau: 20", "tau: 2.5", r"6: states\[0\].tau: expected a whole number"),
        ("tau: 20", "alpha: 2", r"6: states\[0\].alpha: unknown key"),
        ("    tau: 20\n", "", r"states\[0\].tau: missing key; expected a whole number"),
        ("to: rest", "to: sleep", r"8: states\[0\].transitions\[0\].to: expected another state: rest; found 'sleep'"),
        ("to: rest", "to: search", "expected another state: rest; found 'search'"),
        ("name: rest", "name: search", r"9: states\[1\].name: state 0 has the name 'search', too"),
        ("label: blue", "label: pink", "expected one of green, blue, red, yellow, found"),
        ("floor color", "flor", "expected one of black floor"),
        ("behaviour: stop", "behaviour: phototaxis", "10: .*watermelon has no behaviour 'phototaxis'; it has"),
        ("schema: 1", "schema: 2", "1: schema: expected 1"),
        ("header: {m", "header: {'a:b': 1, m", "words without a colon"),
        ("name: rest", "name: '<script>'", "letters, digits"),
    ],
)  # fmt: skip
def test_mistakes_name_their_line(tmp_path, old, new, message):
    assert old in GOOD
    path = tmp_path / "fsm.yaml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(FsmError, match=message):
        read_fsm(path)


def test_no_text_makes_the_reader_fail_otherwise():
    draws, names = (
        random.Random(4),
        ["x", "1", "[", "&a", "*a", "!!python/object:os.system", "<script>", "\u202e", "\x1b[2J"],
    )
    lines = fsm_yaml_text(
        FsmFile(software=parse(PUBLISHED["watermelon"]["W9"]), header={"mission": "home"})
    ).splitlines()
    outcomes: set[object] = set()
    for _ in range(200):
        changed = lines.copy()
        for _ in range(draws.randint(1, 3)):
            k = draws.randrange(len(changed))
            key, colon, value = changed[k].partition(":")
            odd = draws.choice(
                [f"{key}{colon} {draws.choice(names)}", value, f"  {changed[k]}", f"{key}{colon} {'9' * 10_000}"]
            )
            changed[k : k + draws.randint(0, 2)] = [odd]
        try:
            from_yaml("\n".join(changed))
            outcomes.add("read")
        except FsmError as error:
            outcomes |= {message.startswith("fsm.yaml") and message.isprintable() for message in error.messages}
    assert outcomes == {"read", True}


def test_all_mistakes_are_reported_at_once():
    with pytest.raises(FsmError) as error:
        from_yaml(GOOD.replace("20", "200").replace("blue", "pink"))
    assert len(error.value.messages) == 2


def test_lenient_files_may_leave_domains(tmp_path):
    line = "--nstates 2 --s0 2 --att0 50 --n0 1 --n0x0 0 --c0x0 6 --p0x0 1.5 --l0x0 7 --s1 1"
    file = FsmFile(software=parse(line, tolerate=lambda _: None), header={})
    path = tmp_path / "fsm.yaml"
    path.write_text(fsm_yaml_text(file))
    heard: list[str] = []
    assert read_fsm(path, tolerate=heard.append) == file
    assert [words.split(" is ")[1] for words in heard] == [
        "50, not a number from 1 to 5", "1.5, not a number from 0 to 1",
        "7, not an integer from 0 to 3 (green, blue, red, yellow)",
    ]  # fmt: skip
    with pytest.raises(FsmError, match="alpha"):
        read_fsm(path)


class TestFlavour:
    def test_a_text_of_another_flavour_is_reported(self, tmp_path):
        path = tmp_path / "fsm.txt"
        path.write_text(PUBLISHED["chocolate"]["C4"])
        with pytest.raises(FsmError, match="found 4; it fits the flavour chocolate: give that flavour"):
            read_fsm(path)
        with pytest.raises(FsmError, match="it fits the flavour watermelon"):
            read_fsm(path.with_name("w.txt") if path.with_name("w.txt").write_text(GOOD) else path, "chocolate")

    def test_a_text_of_no_flavour(self):
        with pytest.raises(FsmError) as error:
            parse("--nstates 1 --s0 7")
        assert "fits" not in str(error.value)

    def test_a_yaml_of_another_flavour_is_reported(self, tmp_path):
        path = tmp_path / "fsm.yaml"
        path.write_text("schema: 1\nstates: [{name: a, behaviour: phototaxis}]\n")
        with pytest.raises(FsmError, match="it fits the flavour chocolate: give that flavour"):
            read_fsm(path)
        assert read_fsm(path, "chocolate").pfsm.flavour == "chocolate"


class TestVerb:
    def test_both_ways_without_loss(self, mdesign, tmp_path):
        there, back = tmp_path / "fsm.yaml", tmp_path / "fsm.txt"
        there.write_text(GOOD)
        assert mdesign("fsm", "show", there, "-o", back)[0] == 0
        assert read_fsm(back) == read_fsm(there)
        code, out, _ = mdesign("fsm", "show", back, "--format", "yaml")
        assert (code, from_yaml(out)) == (0, read_fsm(there))
        assert mdesign("validate", there)[1].endswith("valid watermelon FSM, 2 states, 1 transition\n")

    def test_unknown_suffix(self, mdesign, tmp_path):
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 1")
        code, _, err = mdesign("fsm", "show", tmp_path / "fsm.txt", "-o", tmp_path / "a.png")
        assert (code, "expected --format, or a file that ends in .svg" in err) == (2, True)

    def test_schema(self, mdesign):
        assert json.loads(mdesign("schema", "fsm")[1])["title"] == "A PFSM"

    def test_header_of_another_flavour_is_not_copied(self):
        file = from_yaml(GOOD.replace("floor color, beta: 0.5, label: blue", "black floor, beta: 0.5"), "chocolate")
        assert fsm_file_text(file.pfsm, file.header).startswith("# flavour: chocolate\n# mission: home\n")
        assert replace(file, names=()).names == ("exploration", "stop")


def test_the_schema_has_all_flavours():
    assert SCHEMA.schema["properties"]["flavour"]["enum"] == list(FLAVOURS)


@pytest.mark.parametrize("key", ["flavour", "state names"])
def test_header_of_yaml_that_would_say_what_the_file_says(key, tmp_path):
    path = tmp_path / "fsm.yaml"
    path.write_text(f"schema: 1\nstates:\n- {{name: wait, behaviour: stop}}\nheader: {{{key}: chocolate}}\n")
    with pytest.raises(FsmError, match=f"header: expected no key '{key}'"):
        read_fsm(path)
