import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.errors import FsmError
from mercator_design.fsm.text import parse, to_text
from mercator_design.software.files import fsm_file_text, read_fsm
from tests.fsm.strategies import pfsms

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
CASES = [(flavour, name) for flavour in ("watermelon", "chocolate") for name in PUBLISHED[flavour]]


@pytest.mark.parametrize(("flavour", "name"), CASES)
def test_published_controllers_round_trip(flavour, name):
    line = PUBLISHED[flavour][name]
    pfsm = parse(line, flavour)
    canonical = to_text(pfsm)
    assert parse(canonical, flavour) == pfsm
    assert to_text(parse(canonical, flavour)) == canonical
    assert [float(t) if not t.startswith("--") else t for t in canonical.split()] == [
        float(t) if not t.startswith("--") else t for t in line.split()
    ]


@given(pfsms())
def test_any_pfsm_round_trips(pfsm):
    assert parse(to_text(pfsm), pfsm.flavour) == pfsm


TWO = "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 {} --s1 1"

# What the original crashes on or swallows (numbers as in its published source): text, words that the error must have.
MALFORMED = {
    "relative target out of range": (
        "--nstates 2 --s0 1 --n0 1 --n0x0 1 --c0x0 0 --p0x0 1 --s1 1",
        ["--n0x0", "state 0, transition 0", "1"],
    ),
    "unknown behaviour": ("--nstates 1 --s0 5", ["--s0", "state 0", "5"]),
    "unknown condition": (TWO.format("9 --p0x0 1"), ["--c0x0", "state 0, transition 0", "9"]),
    "missing behaviour parameter": ("--nstates 1 --s0 0", ["state 0", "--rwm0"]),
    "missing condition parameter": (TWO.format("3 --p0x0 1"), ["state 0, transition 0", "--w0x0"]),
    "missing condition": (TWO.replace("--c0x0 {}", ""), ["state 0, transition 0", "--c0x0"]),
    "missing nstates": ("--s0 1", ["--nstates", "--s0"]),
    "empty": ("", ["--nstates"]),
    "no states": ("--nstates 0", ["--nstates", "0"]),
    "too many states": ("--nstates 5", ["--nstates", "5"]),
    "missing state": ("--nstates 2 --s0 1", ["--s1", "state 1"]),
    "states in wrong order": ("--nstates 2 --s1 1 --s0 0 --rwm0 3", ["--s0", "--s1"]),
    "more states than said": ("--nstates 1 --s0 1 --s1 0 --rwm1 5", ["--s1", "--nstates 1"]),
    "missing transition": (
        "--nstates 2 --s0 1 --n0 2 --n0x0 0 --c0x0 5 --p0x0 1 --s1 1",
        ["--n0x1", "state 0, transition 1"],
    ),
    "more transitions than said": (
        "--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1 --n0x1 0 --c0x1 5 --p0x1 1 --s1 1",
        ["--n0x1"],
    ),
    "too many transitions": ("--nstates 2 --s0 1 --n0 5 --s1 1", ["--n0", "state 0", "5"]),
    "parameters before their transition": (
        "--nstates 2 --s0 1 --n0 1 --c0x0 5 --p0x0 1 --n0x0 0 --s1 1",
        ["--n0x0", "--c0x0"],
    ),
    "decimal comma": (TWO.format("2 --p0x0 0,5"), ["--p0x0", "'0,5'", "state 0, transition 0"]),
    "word for a probability": (TWO.format("2 --p0x0 abc"), ["--p0x0", "'abc'"]),
    "word for a behaviour": ("--nstates 1 --s0 foo", ["--s0", "foo"]),
    "probability above one": (TWO.format("2 --p0x0 1.5"), ["--p0x0", "1.5"]),
    "probability below zero": (TWO.format("2 --p0x0 -0.3"), ["--p0x0", "-0.3"]),
    "not a number": (TWO.format("2 --p0x0 nan"), ["--p0x0", "nan"]),
    "infinite": (TWO.format("3 --p0x0 1 --w0x0 1e999"), ["--w0x0"]),
    "negative target": (
        "--nstates 2 --s0 1 --n0 1 --n0x0 -1 --c0x0 5 --p0x0 1 --s1 1",
        ["--n0x0", "-1"],
    ),
    "transition of an only state": (
        "--nstates 1 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1",
        ["--n0", "state 0"],
    ),
    "alpha too large": ("--nstates 1 --s0 2 --att0 50.0", ["--att0", "50.0", "1 to 5"]),
    "alpha too small": ("--nstates 1 --s0 2 --att0 0.49", ["--att0", "0.49"]),
    "label out of range": (TWO.format("6 --p0x0 1 --l0x0 5"), ["--l0x0", "5"]),
    "fraction for a whole number": ("--nstates 1 --s0 0 --rwm0 20.7", ["--rwm0", "20.7"]),
    "parameter of another behaviour": ("--nstates 1 --s0 1 --rwm0 3", ["--rwm0", "stop"]),
    "twice": ("--nstates 1 --s0 1 --s0 1", ["--s0", "twice"]),
    "no value": ("--nstates 1 --s0", ["--s0"]),
    "flag for a value": ("--nstates 2 --s0 --rwm0 20", ["--s0", "--rwm0"]),
    "power of ten for a whole number": ("--nstates 1 --s0 0 --rwm0 2e1", ["--rwm0", "2e1"]),
    "digits of another script": ("--nstates 1 --s0 0 --rwm0 ٢", ["--rwm0"]),
    "strange flag": ("--nstates 1 --s0 0 --rwm0 33 --brd0 1", ["--brd0"]),
    "strange word": ("hello", ["hello"]),
    "endless token": ("--nstates " + "9" * 5000, ["999"]),
}


@pytest.mark.parametrize("defect", MALFORMED)
def test_malformed_text_is_refused_with_its_place(defect):
    text, words = MALFORMED[defect]
    with pytest.raises(FsmError) as error:
        parse(text)
    for word in words:
        assert word in str(error.value)


def test_tau_of_zero_is_accepted_as_published_controllers_have_it():
    assert parse("--nstates 1 --s0 0 --rwm0 0").states[0].parameters == (0,)


# Text, its canonical reading by the original, a word of what must be told.
TOLERATED = {
    "more states than said": ("--nstates 1 --s0 1 --s1 0 --rwm1 5", "--nstates 1 --s0 1", "--s1 0 --rwm1 5"),
    "decimal comma": (TWO.format("2 --p0x0 0,5"), TWO.format("2 --p0x0 0").replace("0.0", "0"), "0,5"),
    "word for a number": ("--nstates 1 --s0 foo --rwm0 3", "--nstates 1 --s0 0 --rwm0 3", "foo"),
    "probability above one": (TWO.format("2 --p0x0 1.5"), TWO.format("2 --p0x0 1.5"), "1.5"),
    "alpha too large": ("--nstates 1 --s0 2 --att0 50.0", "--nstates 1 --s0 2 --att0 50", "50"),
    "label out of range": (TWO.format("6 --p0x0 1 --l0x0 5"), TWO.format("6 --p0x0 1 --l0x0 5"), "label"),
    "first of two wins": ("--nstates 1 --s0 1 --s0 0 --rwm0 3", "--nstates 1 --s0 1", "--s0 0"),
    "fraction cut off": ("--nstates 1 --s0 0 --rwm0 20.7", "--nstates 1 --s0 0 --rwm0 20", "20.7"),
    "parameter of another behaviour": (
        "--nstates 1 --s0 1 --att0 20.0 --rep0 20.0",
        "--nstates 1 --s0 1",
        "--att0",
    ),
    "power of ten for a whole number": ("--nstates 1 --s0 0 --rwm0 1e2", "--nstates 1 --s0 0 --rwm0 100", "1e2"),
    "words before": (
        "--robots 13 --rabsi 0 --nstates 1 --s0 1 --n0 0",
        "--nstates 1 --s0 1",
        "--robots 13",
    ),
    "parameter before the condition's flag": (
        "--nstates 2 --s0 1 --n0 1 --n0x0 0 --p0x0 0.5 --c0x0 5 --s1 1",
        "--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.5 --s1 1",
        None,
    ),
}


@pytest.mark.parametrize("case", TOLERATED)
def test_lenient_reading_is_what_the_original_ran_and_says_so(case):
    text, canonical, told = TOLERATED[case]
    heard: list[str] = []
    assert to_text(parse(text, tolerate=heard.append)) == canonical
    if told is None:
        assert heard == []
        assert to_text(parse(text)) == canonical
    else:
        assert any(told in sentence for sentence in heard)
        with pytest.raises(FsmError):
            parse(text)


@pytest.mark.parametrize("value", ["1e300", "1e22", "123456789012345678", "-1e15", "999999999999999"])
def test_large_tolerated_numbers_are_written_as_they_are_read(value):
    pfsm = parse(f"--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 0 --p0x0 {value} --s1 1", tolerate=lambda _: None)
    text = to_text(pfsm)
    assert len(text) < 100
    assert parse(text, tolerate=lambda _: None) == pfsm


@given(st.lists(st.sampled_from([*TWO.format("3 --p0x0 7 --w0x0 2.5").split(), "-1", "x", "9" * 30]), max_size=30))
def test_no_text_makes_the_reader_fail_otherwise(tokens):
    for tolerate in (None, lambda _: None):
        with contextlib.suppress(FsmError):
            parse(" ".join(tokens), tolerate=tolerate)


def test_wrong_flavour_names_the_modules_it_has():
    with pytest.raises(FsmError, match=r"phototaxis.*chocolate"):
        parse("--nstates 1 --s0 6", "chocolate")
    with pytest.raises(FsmError, match="flavour"):
        parse("--nstates 1 --s0 1", "vanilla ice")


class TestFile:
    def test_header_and_line(self, tmp_path):
        pfsm = parse(PUBLISHED["chocolate"]["C4"], "chocolate")
        path = tmp_path / "fsm.txt"
        path.write_text(fsm_file_text(pfsm, {"mission": "aac", "score": "3.5"}))
        file = read_fsm(path)
        assert file.pfsm == pfsm
        assert file.header == {"mission": "aac", "score": "3.5"}

    def test_bare_line_with_target_runner_score(self, tmp_path):
        path = tmp_path / "fsm_log.txt"
        path.write_text("\n --fsm-config --nstates 1 --s0 1 \n score -3.5e1\n")
        assert to_text(read_fsm(path).pfsm) == "--nstates 1 --s0 1"

    def test_flavour_option_overrides(self, tmp_path):
        path = tmp_path / "fsm.txt"
        path.write_text(PUBLISHED["chocolate"]["C5"])
        with pytest.raises(FsmError, match=r"fsm.txt:1: "):
            read_fsm(path)
        assert read_fsm(path, "chocolate").pfsm.flavour == "chocolate"

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            (b"", "one line"),
            (b"# mission: x\n", "one line"),
            (b"--nstates 1 --s0 1\n--nstates 1 --s0 1\n", "line 1, line 2"),
            (b"# a\n\n--nstates 1 --s0 7\n", "fsm.txt:3"),
            (b"\xff\xfe\x00", "expected UTF-8 text, found the byte 0xff"),
            (b"# a comment\n--nstates \xff", ":2: expected UTF-8 text, found the byte 0xff"),
            (b"#" * 100_000, "at most"),
        ],
    )
    def test_bad_files(self, tmp_path, content, words):
        path = tmp_path / "fsm.txt"
        path.write_bytes(content)
        with pytest.raises(FsmError, match=words):
            read_fsm(path)

    def test_no_file(self, tmp_path):
        with pytest.raises(FsmError, match="folder"):
            read_fsm(tmp_path)
        with pytest.raises(FsmError, match="no such file"):
            read_fsm(tmp_path / "nothing")
        with pytest.raises(FsmError, match="/dev/zero"):
            read_fsm(Path("/dev/zero"))
