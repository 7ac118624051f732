"""Studies whose file names plugins: no verb needs --plugin; what resumes a study is the command that was given."""

import json
import shlex

import pytest

import mercator_design as md
from mercator_design.cli.terminal import Interrupt
from mercator_design.errors import StudyError
from mercator_design.plugins.loading import loaded_plugins, snapshot
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.studies.folder import PLAN
from mercator_design.studies.plan import load_plan
from mercator_design.studies.running import StudyRun

pytestmark = [pytest.mark.usefixtures("registries"), pytest.mark.together]

PLUGIN = '''
from mercator_design import objective


@objective
def northernmost(trace):
    """How far north the northernmost robot starts, and the number of cycles."""
    return trace.cycles + float(trace.poses[0, :, 1].max())
'''
MISSION = """
schema: 1
robots: 2
duration: 1
arena: {walls: {shape: regular_polygon, sides: 12, apothem: 1.226}}
placement: {shape: disc, radius: 1.2}
objective: {name: northernmost, direction: maximise}
"""
STUDY = """
plugins: [more/counting.py]
methods: {hand: {files: [a.txt, b.txt]}}
missions: [./counted.yaml]
assess: {runs: 2}
"""


@pytest.fixture
def plan(tmp_path):
    for name, text in {
        "more/counting.py": PLUGIN,
        "counted.yaml": MISSION,
        "a.txt": "--nstates 1 --s0 0 --rwm0 20\n",
        "b.txt": "--nstates 1 --s0 1\n",
        "plugged.yaml": STUDY,
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path / "plugged.yaml"


def test_a_study_runs_its_plugins(plan, tmp_path, mdesign):
    folder = tmp_path / "done"
    assert mdesign("study", plan, "-o", folder, "--no-report")[0] == 0
    assert [*loaded_plugins()] == ["counting.py"]
    assert load_plan(folder / PLAN).seen_from(tmp_path) == load_plan(plan).seen_from(tmp_path)
    assert str(tmp_path) not in (folder / PLAN).read_text()
    assert [*json.loads((folder / "study.json").read_text())["program"]["plugins"]] == ["counting.py"]


def test_validation_runs_them(plan, mdesign):
    code, out, err = mdesign("validate", plan)
    assert code == 0, err
    assert "valid study, 2 designs, 4 experiments" in out


def test_python_runs_them(plan):
    assert len(md.study(plan, jobs=1).runs) == 4


def test_other_verbs_need_none(plan, tmp_path, mdesign):
    folder, forget = tmp_path / "done", snapshot()
    md.study(plan, folder=folder, jobs=1)
    forget()
    assert loaded_plugins() == {}
    code, out, _ = mdesign("study", "status", folder, "--json")
    assert (code, json.loads(out)["counts"]["done"]) == (0, 2)
    assert mdesign("study", "report", folder)[0] == 0
    assert loaded_plugins() == {}


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("counting.py]", "missing.py]", "plugged.yaml:2: plugins[0]: "),
        ("[more/counting.py]", "[more/counting.py, more/counting.py]", "plugins: expected each value once"),
    ],
)
def test_wrong_ones_are_refused(old, new, expected, plan, mdesign):
    plan.write_text(STUDY.replace(old, new))
    code, _, err = mdesign("study", plan)
    assert code == 2
    assert expected in err
    assert "counted.yaml" not in err  # what may be of the plugin is not reported


def test_a_changed_one_is_refused(plan, tmp_path):
    forget = snapshot()
    md.study(plan, folder=tmp_path / "done", jobs=1)
    forget()
    file = tmp_path / "more" / "counting.py"
    file.write_text(PLUGIN.replace("trace.cycles", "2 * trace.cycles"))
    with pytest.raises(StudyError, match=r"program\.plugins\.counting\.py: expected "):
        md.study(plan, folder=tmp_path / "done", jobs=1)


def test_what_resumes_is_the_command_that_was_given(plan, tmp_path, mdesign, monkeypatch):
    told = []
    monkeypatch.setattr(Interrupt, "check", lambda self, message: told.append(message))

    def stop(self):
        raise ExecutorStopped

    monkeypatch.setattr(StudyRun, "run", stop)
    options = ["--plugin", tmp_path / "more" / "counting.py", "--part", "1/2", "--executor", "processes", "-j", 1]
    options += ["--set", "assess.runs=3", "-o", tmp_path / "a folder"]
    with pytest.raises(ExecutorStopped):
        mdesign("study", plan, *options)
    given = shlex.join(["mdesign", "study", str(plan), *map(str, options)])
    assert told[0] == f"{tmp_path / 'a folder'}: the 0 experiments so far are kept; to resume: {given}"
