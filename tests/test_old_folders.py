"""Run folders with journals of format 1, as mercator_design 0.1.0 wrote them: read, checked as well as they can be."""

import json
import zipfile
from pathlib import Path

import pytest

from mercator_design.race.session.journal import read
from mercator_design.results.files import JOURNAL
from tests.race.lines import events_in, journal_of

RECORDED = Path(__file__).parent / "data" / "old_runs.zip"
DIGESTS = {
    "mission": "6ce7c9dd4bd100772b1034a16213f59fdcee221aecb5149a0befbd011bcc729a",
    "tuning": json.loads(zipfile.ZipFile(RECORDED).read("tuning/provenance.json"))["journal"],
}


@pytest.fixture
def old(tmp_path, monkeypatch):
    with zipfile.ZipFile(RECORDED) as archive:
        archive.extractall(tmp_path)
    runner = tmp_path / "sharpen" / "target-runner"
    runner.chmod(0o755)
    scenario = tmp_path / "tuning" / "scenario.txt"
    scenario.write_text(scenario.read_text().replace('"sharpen', f'"{tmp_path}/sharpen'))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", DIGESTS)
def test_they_are_read(mdesign, old, name):
    reading = read(old / name / JOURNAL)
    assert (reading.record.start["format"], reading.torn) == (1, "")
    assert reading.record.digest() == DIGESTS[name]
    assert "finished" in mdesign("runs", "list", old)[1]
    code, out, err = mdesign("runs", "show", name)
    assert (code, err) == (0, "")
    assert f"Digest     {DIGESTS[name]}" in out
    assert "Note" not in out.partition("iteration  budget")[0]
    for table in ("experiments", "configurations", "tests"):
        assert mdesign("runs", "show", name, "--csv", table)[0] == 0


def test_another_simulator_does_not_go_on_with_them(mdesign, old):
    for words in (["race", "--resume", "mission"], ["runs", "verify", "mission"]):
        code, out, err = mdesign(*words)
        assert (code, out) == (1, "")
        assert "raced with" in err
        assert "this version cannot continue, verify or ablate the race" in err


def test_a_race_that_was_stopped_goes_on_in_its_format(mdesign, old):
    """To the same end; lines that are added are as those before."""
    journal = old / "tuning" / JOURNAL
    whole = journal.read_bytes()
    lines = whole.splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:60]))
    assert mdesign("tune", "--resume", "tuning")[0] == 0
    record = read(journal).record
    assert (record.digest(), record.start["format"]) == (DIGESTS["tuning"], 1)
    assert b'"after"' not in journal.read_bytes()
    code, out, _ = mdesign("runs", "verify", "tuning", "-n", 5)
    assert code == 0
    assert "5 of" in out


@pytest.mark.parametrize(
    ("event", "key", "value", "words"),
    [
        ("experiment", "configuration", 99, "experiment: expected a configuration that is in the journal before"),
        ("experiment", "score", "1", "experiment.score: expected a number or null"),
        ("experiment", None, None, "expected 59 experiments to have the numbers 0 to 58"),
        ("configuration", None, None, "expected a configuration that is in the journal before"),
    ],
)
def test_damage(mdesign, old, event, key, value, words):
    """A line that is missing is found where others need it; not where nothing does, as lines are not chained."""
    events = events_in((old / "mission" / JOURNAL).read_bytes())
    place = next(k for k, one in enumerate(events) if one["event"] == event)
    if key is None:
        del events[place]
    else:
        events[place][key] = value
    (old / "mission" / JOURNAL).write_bytes(journal_of(events))
    for verb in ("show", "importance"):
        code, out, err = mdesign("runs", verb, "mission")
        assert (code, out) == (1, "")
        assert words in err
