"""The report of a race: its numbers are those of the race, texts of others appear as text, it needs nothing else."""

import contextlib
import errno
import json
import os
import random
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import ttest_rel

from mercator_design.api import fresh_instances
from mercator_design.cli.races import reporting
from mercator_design.errors import MercatorError, RaceError
from mercator_design.fsm.text import parse, to_text
from mercator_design.race.elimination.statistics import holm
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis import comparison as comparisons
from mercator_design.results.analysis.comparison import (
    ALONE,
    COMPARISON,
    RANDOM,
    Contestant,
    WinnerComparison,
    compare_winner,
    read_comparison,
    winner_tests,
)
from mercator_design.results.experiments.winner import WinnerRuns, run_again
from mercator_design.results.facts import Facts
from mercator_design.results.files import read_journal
from mercator_design.results.listing import run_of
from mercator_design.scores import ScoreRange
from mercator_design.show.report import importance as importances
from mercator_design.show.report import page as pages
from mercator_design.show.report import request as requests
from mercator_design.show.report.comparison import verdict
from mercator_design.show.report.page import REPORT, report_page
from tests.race.damage import damaged
from tests.tiers import cases, some

pytestmark = pytest.mark.together

RACE = ["race", "aggregation", "--budget", "240", "--set", "robots=2", "--set", "duration=3", "-j", "2"]
NASTY = "<script>alert(1)</script>\u202e\x1b[31m\u0000'\"&" + "x" * 10_000


class Page(HTMLParser):
    """A page's elements, and the text of its visible ones."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.scripts, self._inside = [], "", [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag in {"script", "style"}:
            self._inside.append(tag)

    def handle_endtag(self, tag):
        if self._inside[-1:] == [tag]:
            self._inside.pop()

    def handle_data(self, data):
        if not self._inside:
            self.text += data
        elif self._inside == ["script"]:
            self.scripts.append(data)

    def all(self, attribute):
        """The attributes of the elements that have one."""
        return [attributes for _, attributes in self.elements if attribute in attributes]


@pytest.fixture(scope="module")
def raced(tmp_path_factory, mdesign_once):
    """The folder of a race with its report."""
    folder = tmp_path_factory.mktemp("report") / "race"
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MDESIGN_NO_REPORT")
        mdesign_once(*RACE, "--test-runs", 6, "-o", folder)
    return folder


@pytest.fixture(scope="module")
def facts(raced):
    return Facts.read(raced)


@pytest.fixture(scope="module")
def comparison(raced, facts):
    return read_comparison(raced, facts.record)


@pytest.fixture(scope="module")
def page(raced):
    return Page((raced / REPORT).read_text())


@pytest.fixture
def folder(raced, tmp_path):
    """A copy of the race without its report and comparison."""
    shutil.copytree(raced, tmp_path / "r")
    (tmp_path / "r" / REPORT).unlink()
    (tmp_path / "r" / COMPARISON).unlink()
    return tmp_path / "r"


@pytest.fixture
def quick(monkeypatch):
    """Leave out what takes long to draw."""
    for name in ("request", "importance"):
        monkeypatch.setattr(pages, name, lambda facts: "")


class TestNumbers:
    @pytest.mark.thorough
    def test_score_is_that_of_the_winner_on_fresh_instances(self, page, comparison, facts):
        (shown,) = page.all("data-n")
        scores = Scores(comparison.contestants[0].scores, ScoreRange(0.0, 2.0))
        low, high = scores.confidence_interval
        for key, value in (("score", scores.mean), ("low", low), ("high", high), ("n", 6)):
            assert float(shown[f"data-{key}"]) == pytest.approx(value, rel=1e-5, abs=1e-9)
        pfsm = facts.pfsm(facts.best)
        assert [facts.designer.simulator.run(pfsm, seed).score for seed in comparison.seeds] == list(scores.values)

    def test_software_is_the_winners(self, page, facts, raced):
        assert to_text(facts.pfsm(facts.best)) in page.text
        assert {one["data-state"] for one in page.all("data-state")} == {
            str(k) for k in range(len(facts.pfsm(facts.best).states))
        }
        assert (raced / "fsm.txt").read_text().splitlines()[-1] in page.text

    def test_bars_are_the_budget(self, page, facts):
        bars = [one for tag, one in page.elements if tag == "rect" and "data-name" in one]
        assert sum(float(one["data-value"]) for one in bars) == len(facts.record.experiments)

    def test_best_of_each_iteration(self, page, facts):
        points = [(float(one["data-x"]), float(one["data-y"])) for one in page.all("data-y")]
        used = 0
        for one in facts.view.incumbents:
            used += one.ended.used
            mean = Scores(tuple(one.scores.values())).mean
            assert any(x == used and y == pytest.approx(mean, rel=1e-5) for x, y in points)

    def test_cells_are_the_elites_results(self, page, facts):
        cells = [float(one["data-value"]) for tag, one in page.elements if tag == "rect" and set(one) >= {"data-value"}
                 and "data-name" not in one]  # fmt: skip
        expected = [score for one in facts.elites for _, score in sorted(facts.view.scores(one).items())]
        assert cells == pytest.approx(expected, rel=1e-5)

    def test_comparisons_with_the_winner(self, page, comparison):
        winner, *others = comparison.contestants
        tested = [ttest_rel(winner.scores, one.scores).pvalue for one in others]
        expected = holm(np.nan_to_num(np.array(tested), nan=1.0))
        assert [pair.p_value for pair in comparison.pairs()] == pytest.approx(expected.tolist())
        shown = {one["data-name"]: float(one["data-mean"]) for one in page.all("data-mean")}
        for one in comparison.contestants:
            assert shown[one.name] == pytest.approx(float(np.mean(one.scores)), rel=1e-5)
        assert {"winner", "random PFSMs", "exploration alone", "stop alone"} <= shown.keys()

    def test_replays_are_the_median_best_and_worst(self, page, comparison):
        shown = {one["data-seed"]: float(one["data-score"]) for one in page.all("data-replay")}
        scores = dict(zip(map(str, comparison.seeds), comparison.contestants[0].scores, strict=True))
        assert shown.items() <= scores.items()
        in_order = sorted(scores.values())
        replayed = [float(one["data-score"]) for one in page.all("data-replay")]
        assert replayed == [in_order[2], in_order[-1], in_order[0]]

    def test_every_section_is_there_and_its_link_has_its_heading(self, page, raced):
        sections = [one["id"] for tag, one in page.elements if tag == "section"]
        others = ["comparison", "request", "course", "elites", "importance", "origin"]
        assert sections == ["answer", "replays", *others]
        text = (raced / REPORT).read_text()
        links = re.findall(r'<a href="#(\w+)">(.*?)</a>', text)
        assert links == re.findall(r'<section id="(\w+)"><h2>(.*?)</h2>', text)
        assert [name for name, _ in links] == sections
        assert ("comparison", "Comparison on fresh instances") in links

    def test_what_scrolls_is_reached_by_keys(self, page):
        scrolling = [one for one in page.all("class") if one["class"] == "scroll"]
        assert len(scrolling) >= 8
        assert all(one.get("tabindex") == "0" for one in scrolling)

    def test_every_section_with_figures_ends_with_a_command_of_its_own(self, mdesign, raced):
        text = (raced / REPORT).read_text()
        assert text.count("<figcaption>") == text.count("<figure") >= 8
        sections = re.findall(r'<section id="(\w+)">(.*?)</section>', text, re.DOTALL)
        made = {name: re.findall(r'<p class="made">Made by <code>(.*?)</code></p>', body) for name, body in sections}
        drawn = {name for name, body in sections if "<figure" in body or 'id="replay"' in body}
        assert {name for name, commands in made.items() if commands} == drawn
        every = [command for commands in made.values() for command in commands]
        assert len(every) == len(set(every)) == len(drawn)
        for command in every:
            if command.split()[1] in {"runs", "fsm", "missions"}:
                assert mdesign(*command.split()[1:])[0] == 0


class TestAlone:
    def test_it_names_nothing_outside(self, raced, page):
        text = (raced / REPORT).read_text()
        assert "default-src 'none'" in text
        assert not re.findall(r"https?://(?!www\.w3\.org/)", text.replace("https://github.com", ""))
        assert all(one["src"].startswith("data:") for one in page.all("src"))

    def test_it_is_small(self, raced):
        assert (raced / REPORT).stat().st_size < 300_000

    def test_replays_that_do_not_fit_are_left_out(self, facts, comparison, monkeypatch):
        monkeypatch.setattr(pages, "MAX_SIZE", 0)
        for name in ("request", "importance"):
            monkeypatch.setattr(pages, name, lambda facts: "")
        assert not Page(report_page(facts, run_again(facts), comparison)).all("data-replay")


def test_importance_does_not_read_the_journal_again(facts, monkeypatch):
    monkeypatch.setattr("mercator_design.results.files.Reading", None)
    assert "share of the variance" in importances.importance(facts)


class TestAblation:
    HEAD = "step,change,mean,low,high,difference,difference_low,difference_high,p_value,fsm\n"

    @pytest.fixture
    def shown(self, folder, monkeypatch):
        """The section, if a table is there: {} is the text of the winner."""
        monkeypatch.setattr(importances, "importance_of", lambda *_: SimpleNamespace(parameters=()))

        def show(text):
            facts = Facts.read(folder)
            (folder / "ablation.csv").write_text(self.HEAD + text.format(to_text(facts.pfsm(facts.best))))
            return Page(importances.importance(facts))

        return show

    def test_its_steps_are_shown(self, shown):
        page = shown("0,the winner,2,1,3,,,,,{}\n1,without <b>,1,0,2,-1,-2,0,0.01,x\n")
        rows = [(one["data-name"], float(one["data-mean"])) for one in page.all("data-mean")]
        assert rows == [("the winner", 2), ("without <b>", 1)]
        assert "p = 0.01" in page.text

    @pytest.mark.parametrize("text", ["", "0,the winner,2,1,3,,,,,--nstates 1 --s0 1\n"])
    def test_of_another_winner_it_is_not(self, shown, text):
        page = shown(text)
        assert not page.all("data-mean")
        assert "mdesign runs ablation" in page.text

    @pytest.mark.parametrize("text", ["0,the winner,nan,1,3,,,,,{}\n", "0\n", "0,a,x,1,1,,,,,{}\n"])
    def test_damaged_ones_are_refused(self, shown, text):
        with pytest.raises(RaceError, match="expected the table of mdesign runs ablation"):
            shown(text)


@pytest.mark.usefixtures("quick")
class TestTexts:
    def test_they_appear_as_text(self, folder):
        facts = Facts.read(folder)
        usual = Page(report_page(facts, WinnerRuns()))
        record = facts.record
        record.start["name"] = record.start["mercator_design"] = NASTY
        number = max(record.experiments)
        record.view.note(replace(record.experiments[number], score=None, failure=NASTY))
        first = record.view.incumbents[0]
        record.view.incumbents[0] = first._replace(ended=replace(first.ended, note=NASTY))
        record.sessions[0] = replace(record.sessions[0], host=NASTY)
        facts = replace(facts, notes=(NASTY,), folder=folder.parent / "<b>\u202e")
        text = report_page(facts, WinnerRuns())
        assert not any(mark in text for mark in ("<script>alert", "\u202e", "\x1b", "\u0000"))
        page = Page(text)
        assert page.text.count("<script>alert(1)</script>\\u202e\\x1b[31m\\x00'\"&xx") >= 5
        assert [tag for tag, _ in page.elements if tag in {"script", "b"}] == ["script"]
        assert len(page.scripts) == len(usual.scripts)

    def test_of_the_mission(self, folder, monkeypatch):
        monkeypatch.setattr(pages, "request", requests.request)
        monkeypatch.setattr(requests, "_picture", lambda *_: "")
        mission = folder / "mission.yaml"
        described = "description: " + json.dumps("<script>alert(1)</script>\u202e")
        mission.write_text(re.sub(r"^description: .*$", lambda _: described, mission.read_text(), flags=re.MULTILINE))
        page = Page(report_page(Facts.read(folder), WinnerRuns()))
        assert "<script>alert(1)</script>\\u202e" in page.text


@pytest.mark.usefixtures("quick")
class TestStages:
    def test_a_race_that_was_stopped(self, folder, facts):
        lines = (folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
        (folder / "journal.jsonl").write_bytes(b"".join(lines[: len(lines) // 2]))
        stopped = Facts.read(folder)
        text = Page(report_page(stopped, WinnerRuns())).text
        assert not stopped.record.is_complete
        assert "The best so far" in text
        assert f"{len(stopped.record.experiments)} of 240 experiments" in text

    def test_one_that_has_just_begun(self, folder):
        lines = (folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
        (folder / "journal.jsonl").write_bytes(b"".join(lines[:3]))
        assert "No iteration has ended yet" in Page(report_page(Facts.read(folder), WinnerRuns())).text

    def test_one_whose_files_are_lost(self, folder):
        (folder / "mission.yaml").unlink()
        page = Page(report_page(Facts.read(folder), WinnerRuns()))
        assert "mission.yaml" in page.text
        assert page.all("data-state")

    @pytest.mark.swept
    def test_damaged_ones(self, folder, raced):
        """They are shown, or refused with an error of ours."""
        data = (raced / "journal.jsonl").read_bytes()
        for seed in some(cases(100), 10):
            (folder / "journal.jsonl").write_bytes(damaged(data, random.Random(seed))[0])
            with contextlib.suppress(MercatorError):
                report_page(Facts.read(folder), WinnerRuns()).encode()

    def test_one_with_the_provenance_of_another(self, folder):
        file = folder / "provenance.json"
        file.write_text(file.read_text().replace('"flavour": "watermelon"', '"flavour": "chocolate"'))
        facts = Facts.read(folder)
        assert facts.task is None
        assert "found another race" in Page(report_page(facts, WinnerRuns())).text


class TestComparison:
    @pytest.mark.usefixtures("quick")
    def test_it_is_the_same_again_and_its_experiments_run_once(self, mdesign, folder, raced):
        arguments = ("report", folder, "-o", folder / "a.html")
        assert mdesign(*arguments)[:2] == (0, f"{folder / 'a.html'}\n")
        first = (folder / COMPARISON).read_bytes()
        assert first == (raced / COMPARISON).read_bytes()
        os.utime(folder / COMPARISON, (1, 1))
        assert mdesign(*arguments)[0] == 0
        assert (folder / COMPARISON).stat().st_mtime == 1
        assert 'data-table="fresh"' in (folder / "a.html").read_text()

    def test_it_does_not_change_the_race(self, raced, facts):
        assert facts.record.digest() == facts.provenance.journal

    def test_its_winner_has_the_score_of_the_tests(self, raced, facts, comparison):
        assert comparison.seeds == tuple(fresh_instances(1, 6))  # those of `mdesign evaluate`
        assert (
            comparison.contestants[0].scores
            == facts.headline.scores.values
            == tuple(winner_tests(facts.record).values())
        )
        listed = run_of(raced, read_journal(raced))
        assert (listed["score"], listed["measured"]) == (facts.headline.scores.mean, "on 6 fresh instances")

    @pytest.mark.usefixtures("quick")
    def test_after_more_tests_or_none(self, mdesign, folder, monkeypatch):
        monkeypatch.setattr(comparisons, "MAX_OTHERS", 4)
        mdesign("report", folder, "--no-comparison")
        assert not (folder / COMPARISON).exists()
        assert f"mdesign report {folder} does that." in Page((folder / REPORT).read_text()).text
        for runs in (6, 7):
            assert mdesign("race", "--resume", folder, "--test-runs", runs)[0] == 0
            assert mdesign("report", folder)[0] == 0
            data = json.loads((folder / COMPARISON).read_text())
            assert [len(one["scores"]) for one in data["contestants"]][:3] == [runs, 4, 4]
        assert "(the others on the first 4)" in (folder / REPORT).read_text()

    @pytest.mark.usefixtures("quick")
    def test_of_a_winner_that_was_not_tested(self, mdesign, folder):
        lines = (folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
        (folder / "journal.jsonl").write_bytes(b"".join(lines[:-6]))
        assert mdesign("report", folder)[0] == 0
        assert not (folder / COMPARISON).exists()
        text = Page((folder / REPORT).read_text()).text
        assert f"it was not tested on any: mdesign race --resume {folder} --test-runs 30" in text
        assert re.search(r"of at most 2 in the race, \d+ runs", text)

    def test_it_may_be_stopped(self, folder, facts):
        with ThreadExecutor(1) as executor, pytest.raises(ExecutorStopped):
            compare_winner(folder, facts.designer, facts.record, executor, stopped=lambda: True)
        assert not (folder / COMPARISON).exists()

    def test_of_another_end_it_is_not_shown(self, folder, facts, raced):
        data = json.loads((raced / COMPARISON).read_text())
        (folder / COMPARISON).write_text(json.dumps(data | {"journal": "0"}))
        assert read_comparison(folder, facts.record) is None

    @pytest.mark.parametrize("text", ["", "[]", "{", '{"journal": "", "seeds": [1], "contestants": []}'])
    def test_damaged_ones_are_refused(self, mdesign, folder, text):
        (folder / COMPARISON).write_text(text)
        code, _, err = mdesign("report", folder)
        assert code == 1
        assert COMPARISON in err

    def test_what_it_says_depends_on_the_direction(self, facts):
        runs = tuple(range(8))
        higher = tuple(value + 5.0 + 0.1 * (value % 3) for value in runs)
        rows = [("winner", runs), (RANDOM.format("PFSM"), higher), (f"stop{ALONE}", runs)]
        contestants = tuple(Contestant(name=name, fsm="", scores=scores) for name, scores in rows)
        made = WinnerComparison(journal="", seeds=runs, contestants=contestants)
        begin, alike = "On the same fresh instances,", "it is not distinguishable from every PFSM of one state"
        assert verdict(facts, made) == f"{begin} {alike}; it is significantly worse than random PFSMs."
        other = replace(facts, task=SimpleNamespace(maximise=False))
        single = tuple(replace(one, scores=one.scores[:1]) for one in contestants)
        assert "A single fresh instance is too few" in verdict(facts, replace(made, seeds=(0,), contestants=single))
        assert verdict(other, made) == f"{begin} it is significantly better than random PFSMs; {alike}."

    def test_machines_of_one_state_are_in_the_domains(self, comparison):
        alone = [one for one in comparison.contestants if one.name.endswith(ALONE)]
        assert len(alone) >= 4
        assert all(len(parse(one.fsm).states) == 1 for one in alone)


class TestCommand:
    @pytest.mark.swept
    @pytest.mark.parametrize(
        ("error", "words"),
        some([(OSError(errno.ENOSPC, "No space left on device"), "No space left"), (KeyError("x"), "KeyError")], 1),
    )
    def test_a_report_that_fails_leaves_the_race(self, mdesign, folder, monkeypatch, error, words):
        def fail(*_, **__):
            raise error

        monkeypatch.delenv("MDESIGN_NO_REPORT")
        monkeypatch.setattr(reporting, "write_text" if isinstance(error, OSError) else "report_page", fail)
        if isinstance(error, OSError):
            monkeypatch.setattr(reporting, "report_page", lambda *_, **__: "")
        code, out, err = mdesign("race", "--resume", folder, "--no-comparison")
        assert code == 0
        assert "Winner" in out
        assert "Report  " not in out
        assert "Warning: the report is not written" in err
        assert words in err
        assert f"to write it: mdesign report {folder}" in err

    def test_where_it_is_and_that_an_option_is_above_the_environment(self, mdesign, folder, monkeypatch):
        monkeypatch.setattr(reporting, "report_page", lambda *_, **__: "page")
        code, out, _ = mdesign("race", "--resume", folder, "--no-comparison", "--report")
        assert (code, out.splitlines()[-1]) == (0, f"Report     {folder / REPORT}")
        assert (folder / REPORT).read_text() == "page"

    @pytest.mark.thorough
    def test_each_long_step_is_announced(self, mdesign, folder, monkeypatch):
        monkeypatch.delenv("MDESIGN_NO_REPORT")
        for name in ("request", "importance"):  # they take long to draw
            monkeypatch.setattr(pages, name, lambda facts: "")
        steps = [
            f"Report: reading the race of {folder} ...",
            "Report: comparing the winner with others on 6 fresh instances ...",
            "Report: running the winner again, for the replays ...",
            "Report: finding which modules explain the scores, and drawing the page ...",
        ]
        # The process of a race has its record.
        for command, said in ((("race", "--resume", folder), steps[1:]), (("report", folder), steps)):
            (folder / COMPARISON).unlink(missing_ok=True)
            err = mdesign(*command)[2]
            assert [line for line in err.splitlines() if line.startswith("Report: ")] == said
        assert "Report: " not in mdesign("race", "--resume", folder, "--quiet")[2]

    def test_none_if_not_asked_for(self, mdesign, folder):
        assert "Report  " not in mdesign("race", "--resume", folder)[1]
        assert not (folder / REPORT).exists()

    def test_no_race(self, mdesign, tmp_path):
        code, out, err = mdesign("report", tmp_path)
        assert (code, out) == (1, "")
        assert "not a run folder: provenance.json is missing" in err


def test_the_verdict_names_pfsms_of_one_state_only_where_some_ran():
    scores = [10.0 + 0.1 * k for k in range(20)]
    names = {"winner": scores, "runner-up": scores[::-1], "random networks": [0.1 * k for k in range(20)]}
    contestants = tuple(Contestant(name=name, fsm="", scores=tuple(known)) for name, known in names.items())
    comparison = WinnerComparison(journal="", seeds=tuple(range(20)), contestants=contestants)
    assert verdict(SimpleNamespace(task=None, mission=None), comparison) == (
        "On the same fresh instances, it is significantly better than random networks; it is not distinguishable from "
        "the runner-up."
    )


def test_commands_on_files_of_a_race_with_a_plugin_name_its_copy():
    facts = SimpleNamespace(start={"plugins": {"walls.py": "0123456789abcdef"}}, named=Path("r"))
    shown = Facts.command(facts, "fsm", "show", file="fsm.txt")
    assert shown == "mdesign fsm show r/fsm.txt --plugin r/plugins/walls.py"
    assert Facts.command(facts, "runs", "verify") == "mdesign runs verify r"
