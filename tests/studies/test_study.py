"""mdesign study: cells, resuming, growing, refusals, parts."""

import fcntl
import json
import re
import shutil
from pathlib import Path

import jsonschema
import pytest
import yaml

import mercator_design as md
from mercator_design.cli.contents import kind_of_name
from mercator_design.config import shipped
from mercator_design.config.loading import parse
from mercator_design.errors import StudyError
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.software.files import read_fsm
from mercator_design.studies.assessment import ASSESSMENT, read_assessment
from mercator_design.studies.folder import Part, StudyFolder
from mercator_design.studies.layout import Cell
from mercator_design.studies.plan import StudyPlan, load_plan
from mercator_design.studies.reading import read_status, study_table
from mercator_design.studies.resolving import resolve
from mercator_design.studies.running import StudyRun
from mercator_design.studies.sampling import sampled_reality
from tests.tiers import some

pytestmark = pytest.mark.together

PLAN = """
schema: 1
budgets: [40]
repetitions: 2
methods:
  halving: {}
  random: {method: random, options: {instances: 5}}
missions:
  - {mission: aggregation, set: [duration=1, robots=2], name: near}
  - {mission: foraging, set: [duration=1, robots=2]}
assess: {runs: 3, realities: [mercator-pseudo-reality, {sample: 2, width: 0.5}]}
"""


def plan_file(folder, text=PLAN):
    file = folder / "small.yaml"
    file.write_text(text)
    return file


def contents(folder):
    """What must not depend on how a study came to its end."""
    files = [path for pattern in ("**/fsm.txt", f"**/{ASSESSMENT}") for path in folder.glob(pattern)]
    table = study_table(folder)
    return {
        **{str(path.relative_to(folder)): path.read_bytes() for path in files},
        "runs": table.runs.to_csv(),
        "designs": table.designs.to_csv(),
    }


@pytest.fixture(scope="module")
def done(tmp_path_factory, mdesign_once):
    """A study that has ended; tests copy its folder before they change it."""
    folder = tmp_path_factory.mktemp("studies")
    mdesign_once("study", plan_file(folder), "-o", folder / "done")
    return folder / "done"


@pytest.fixture
def copied(done, tmp_path):
    shutil.copytree(done, tmp_path / "done")
    return tmp_path / "done"


def refusal(mdesign, *arguments):
    code, _, err = mdesign(*arguments)
    assert code == 2, err
    assert "Traceback" not in err
    return err


def test_cells_are_races_with_folders_of_their_own(done):
    cells = read_status(done).cells
    assert len(cells) == 8
    assert {one.state for one in cells} == {"done"}
    seeds = {
        (one.cell.method, one.cell.repetition): json.loads(
            (done / "cells" / one.cell.path / "provenance.json").read_text()
        )["race"]["seed"]
        for one in cells
    }
    assert seeds == {(method, number): number for method in ("halving", "random") for number in (1, 2)}


def test_every_design_is_assessed_on_the_same_fresh_instances(done, mdesign):
    runs = study_table(done).runs
    assert len(runs) == 8 * 3 * 3
    assert (runs.groupby("reality").size() == 24).all()
    assert list(runs["reality"].unique()) == ["design", "mercator-pseudo-reality", "sampled-0.5"]
    for reality, options in (("design", ()), ("mercator-pseudo-reality", ("--robot-model", "mercator-pseudo-reality"))):
        folder = done / "cells" / "near" / "halving" / "40" / "2"
        code, out, _ = mdesign("evaluate", folder / "fsm.txt", "-n", 3, "--json", "--quiet", *options)
        assert code == 0
        assert tuple(json.loads(out)["scores"]) == read_assessment(folder).scores[reality]


def test_options_of_a_method_are_those_of_its_races(done):
    start = json.loads((done / "cells/near/random/40/1/provenance.json").read_text())["race"]
    assert start["options"]["instances"] == 5


def test_the_same_command_runs_nothing_again(copied, tmp_path, mdesign):
    before = {path: path.stat().st_mtime_ns for path in copied.glob("cells/**/*")}
    assert mdesign("study", plan_file(tmp_path), "-o", copied)[0] == 0
    assert {path: path.stat().st_mtime_ns for path in copied.glob("cells/**/*")} == before


@pytest.mark.swept
@pytest.mark.parametrize("n_experiments", some([41, 350, 1, 0, 25, 130], 2))
def test_a_stopped_study_is_resumed_to_the_same_tables(n_experiments, done, tmp_path, mdesign):
    """The thorough tier kills processes; what differs there is only when."""
    study, count = resolve(load_plan(plan_file(tmp_path))), [0]

    def stopped():
        count[0] += 1
        return count[0] > n_experiments

    with (
        StudyFolder.open(tmp_path / "again", study) as folder,
        ThreadExecutor(2) as executor,
        pytest.raises(ExecutorStopped),
    ):
        StudyRun(study, folder, executor, stopped=stopped).run()
    assert mdesign("study", plan_file(tmp_path), "-o", tmp_path / "again")[0] == 0
    assert contents(tmp_path / "again") == contents(done)


def test_what_is_new_in_a_study_runs_alone(copied, tmp_path, mdesign):
    before = {path: path.read_bytes() for path in copied.glob(f"cells/**/{ASSESSMENT}")}
    journals = {path: path.read_bytes() for path in copied.glob("cells/**/journal.jsonl")}
    text = PLAN.replace("repetitions: 2", "repetitions: 3").replace(
        "halving: {}", "halving: {}\n  irace: {method: random}"
    )
    text = text.replace("runs: 3", "runs: 4").replace("[mercator-pseudo", "[mercator-argos, mercator-pseudo")
    text = text.replace("missions:", "missions:\n  - {mission: shelter, set: [duration=1, robots=2]}")
    assert mdesign("study", plan_file(tmp_path, text), "-o", copied)[0] == 0
    assert {path: path.read_bytes() for path in journals} == journals
    assert len(study_table(copied).runs) == 3 * 3 * 3 * 4 * 4
    for path, text in before.items():
        old, new = json.loads(text), read_assessment(path.parent)
        assert {key: list(new.scores[key][:3]) for key in old["scores"]} == old["scores"]
    mdesign("study", plan_file(tmp_path), "-o", copied)  # what is taken away is kept, but is not in the tables
    assert len(study_table(copied).runs) == 8 * 3 * 3
    assert (copied / "cells" / "shelter").exists()


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("duration=1, robots=2], name", "duration=2, robots=2], name", "missions.near.mission.duration"),
        ("instances: 5", "instances: 6", "methods.random.options.instances"),
        ("halving: {}", "halving: {method: random}", "methods.halving.method"),
        ("width: 0.5", "width: 0.6, name: sampled-0.5", "realities.sampled-0.5.width"),
    ],
)
def test_a_changed_definition_is_refused(old, new, place, copied, tmp_path, mdesign):
    before = contents(copied)
    err = refusal(mdesign, "study", plan_file(tmp_path, PLAN.replace(old, new)), "-o", copied)
    assert f"{copied}: {place}: expected " in err
    assert contents(copied) == before


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda scores: scores["design"].__setitem__(0, scores["design"][0] + 0.5), "expected the checksum "),
        (lambda scores: scores.pop("design"), "expected the checksum "),
        (None, 'expected an event that ends in its checksum ("crc")'),
    ],
)
def test_an_edited_assessment_is_refused(change, expected, copied, tmp_path, mdesign):
    file = copied / "cells/near/halving/40/1" / ASSESSMENT
    data = json.loads(file.read_text())
    if change is not None:
        change(data["scores"])
    separators = None if change is None else (",", ":")
    file.write_text(json.dumps(data, separators=separators) + "\n")
    for command in (("study", plan_file(tmp_path), "-o", copied), ("study", "report", copied)):
        err = refusal(mdesign, *command)
        assert f"{file}: it was damaged or changed after it was written: {expected}" in err
        assert "delete it to assess the design again" in err


def test_a_winner_that_was_edited_before_its_assessment_is_refused(copied, tmp_path, mdesign):
    folder = copied / "cells/near/halving/40/1"
    (folder / ASSESSMENT).unlink()
    before = (folder / "fsm.txt").read_bytes()
    (folder / "fsm.txt").write_text("--nstates 1 --s0 1\n")
    err = refusal(mdesign, "study", plan_file(tmp_path), "-o", copied)
    assert (
        f"{folder / 'fsm.txt'}: expected the design that the race beside it made, found other control software: delete "
        in err
    )
    (folder / "fsm.txt").unlink()
    assert mdesign("study", plan_file(tmp_path), "-o", copied)[0] == 0
    assert (folder / "fsm.txt").read_bytes() == before


def test_names_that_differ_only_in_case_share_no_folder(copied, tmp_path, mdesign):
    """Some disks take their folders for one."""
    ignored = "expected names that differ not only in case, which some disks ignore, found "
    for old, new, expected in (
        ("  random: {", "  Halving: {", f"small.yaml:5: methods: {ignored}halving and Halving"),
        ("name: near}", "name: Foraging}", f"small.yaml:10: missions[1]: {ignored}Foraging and foraging: give one"),
    ):
        assert expected in refusal(mdesign, "study", plan_file(tmp_path, PLAN.replace(old, new)), "-o", copied)
    renamed = plan_file(tmp_path, PLAN.replace("halving: {}", "Halving: {}"))
    assert f"{copied}: methods: {ignored}halving and Halving" in refusal(mdesign, "study", renamed, "-o", copied)


def test_robot_models_of_a_study_have_different_names(tmp_path, mdesign):
    for name, text in (("a.yaml", "name: Bot"), ("b.yaml", "name: bot"), ("c.yaml", "name: bot\nbody: {mass: 3.0}")):
        (tmp_path / name).write_text(f"base: mercator\n{text}\n")
    for models, expected in (
        ("a.yaml, ./b.yaml", "found near@Bot and near@bot"),
        ("b.yaml, ./c.yaml", "expected robot models of different names, found near@bot twice"),
    ):
        plan = plan_file(tmp_path, f"{PLAN}robot_models: [./{models}]\n")
        assert expected in refusal(mdesign, "study", plan)


def test_a_folder_belongs_to_one_study(copied, tmp_path, mdesign):
    err = refusal(mdesign, "study", plan_file(tmp_path, PLAN + "name: other\n"), "-o", copied)
    assert "expected the study other with seed 1, found the study small with seed 1" in err
    err = refusal(mdesign, "study", plan_file(tmp_path, PLAN + "seed: 7\n"), "-o", copied)
    assert "with seed 7" in err
    assert "found other files in it" in refusal(mdesign, "study", plan_file(tmp_path), "-o", tmp_path)


def test_a_folder_of_another_version_is_refused(copied, tmp_path, mdesign):
    file = copied / "study.json"
    data = json.loads(file.read_text())
    file.write_text(json.dumps({**data, "program": {**data["program"], "kernels": "0"}, "mercator_design": "0.0.1"}))
    err = refusal(mdesign, "study", plan_file(tmp_path), "-o", copied)
    assert "cannot add to this study of 0.0.1: program.kernels" in err
    file.write_text(json.dumps({**data, "format": 2}))
    assert "expected format 1, found 2" in refusal(mdesign, "study", "status", copied)


def test_a_cell_with_another_race_is_refused(copied, tmp_path, mdesign):
    folder = copied / "cells/near/halving/40/1"
    shutil.rmtree(folder)
    shutil.copytree(copied / "cells/near/halving/40/2", folder)
    assert f"{folder}: seed: expected 1" in refusal(mdesign, "study", plan_file(tmp_path), "-o", copied)


def test_a_cell_that_was_raced_with_other_defaults_is_refused(copied, tmp_path, mdesign):
    file = copied / "cells/near/random/40/1/provenance.json"
    data = json.loads(file.read_text())
    name, value = next((name, one) for name, one in data["race"]["options"].items() if name != "instances")
    data["race"]["options"][name] = f"not {value}"
    file.write_text(json.dumps(data))
    err = refusal(mdesign, "study", plan_file(tmp_path), "-o", copied)
    assert f"options.{name}: expected {value}, as the study says, found a race with not {value}" in err


def test_two_processes_do_not_share_a_study(copied, tmp_path, mdesign):
    with StudyFolder.open(copied, resolve(load_plan(plan_file(tmp_path)))):
        assert "is working on this study" in refusal(mdesign, "study", plan_file(tmp_path), "-o", copied)
    assert mdesign("study", plan_file(tmp_path), "-o", copied)[0] == 0


def test_parts_share_a_study(done, tmp_path, mdesign):
    plan, folder = plan_file(tmp_path), tmp_path / "parts"
    study = resolve(load_plan(plan))
    cells = [set(study.layout.part(number, 3)) for number in (1, 2, 3)]
    assert set.union(*cells) == set(study.layout.cells)
    assert sum(map(len, cells)) == 8
    (folder / "locks").mkdir(parents=True)
    other = folder / "locks" / "part-1-of-2"
    other.touch()
    with StudyFolder.open(folder, study, Part(1, 3)), other.open() as tried:
        fcntl.flock(tried, fcntl.LOCK_SH)  # as another part that looks whether one of two runs
        assert mdesign("study", plan, "-o", folder, "--part", "2/3")[0] == 0
        for part in ("1/3", "1/2"):
            assert "is working on this study" in refusal(mdesign, "study", plan, "-o", folder, "--part", part)
        assert "is working on this study" in refusal(mdesign, "study", plan, "-o", folder)
        code, out, _ = mdesign("study", "status", folder, "--json")
        assert (code, json.loads(out)["counts"]["done"]) == (0, 3)
    for part in ("1/3", "3/3"):
        assert mdesign("study", plan, "-o", folder, "--part", part)[0] == 0
    assert contents(folder) == contents(done)
    assert "expected K/N" in refusal(mdesign, "study", plan, "-o", folder, "--part", "4/3")


MADE = """
schema: 1
methods: {hand: {files: [a.txt, b.txt]}}
missions: [{mission: aggregation, set: [duration=1, robots=2]}]
assess: {runs: 2}
"""
WALK, STOP = "--nstates 1 --s0 0 --rwm0 20", "--nstates 1 --s0 1"


def test_hand_made_files_are_designs(tmp_path, mdesign):
    for name, text in (("a.txt", WALK), ("b.txt", STOP)):
        (tmp_path / name).write_text(text + "\n")
    assert mdesign("study", plan_file(tmp_path, MADE), "-o", tmp_path / "made")[0] == 0
    table = study_table(tmp_path / "made")
    assert table.designs[["budget", "repetition", "runs"]].to_numpy().tolist() == [[0, 1, 2], [0, 2, 2]]
    (tmp_path / "b.txt").write_text(WALK + "\n")
    err = refusal(mdesign, "study", plan_file(tmp_path, MADE), "-o", tmp_path / "made")
    assert "methods.hand.files.2: expected" in err


def test_hand_made_files_are_of_one_flavour(tmp_path, mdesign):
    (tmp_path / "a.txt").write_text(WALK + "\n")
    (tmp_path / "b.txt").write_text(f"# flavour: chocolate\n{STOP}\n")
    err = refusal(mdesign, "study", plan_file(tmp_path, MADE))
    assert "small.yaml:3: methods.hand: " in err
    assert "expected control software of flavour watermelon, as the others, found chocolate" in err


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("methods: {a: {method: halvin}}\nmissions: [aggregation]\nbudgets: [40]\nrepetitions: 2", 'found "halvin"'),
        (
            "methods: {a: {options: {frist: 1}}}\nmissions: [aggregation]\nbudgets: [40]\nrepetitions: 2",
            "did you mean 'first'?",
        ),
        ("methods: {a: {}}\nmissions: [aggregation]\nbudgets: [40]", "repetitions: missing key"),
        ("methods: {a: {}}\nmissions: [aggregation]\nrepetitions: 2", "budgets: missing key"),
        ("methods: {a: {}}\nmissions: [aggregatio]\nbudgets: [40]\nrepetitions: 2", "did you mean 'aggregation'?"),
        (
            "methods: {a: {}}\nmissions: [aggregation, aggregation]\nbudgets: [40]\nrepetitions: 2",
            "found aggregation twice",
        ),
        (
            "methods: {a: {flavour: melon}}\nmissions: [aggregation]\nbudgets: [40]\nrepetitions: 2",
            "methods.a: flavour: ",
        ),
        (
            "methods: {a: {}}\nmissions: [aggregation]\nbudgets: [4]\nrepetitions: 2",
            "expected at least 20 experiments, found 4",
        ),
        (
            "methods: {a: {flavour: chocolate}}\nmissions: [aggregation]\nbudgets: [40]\nrepetitions: 2",
            "on aggregation: chocolate",
        ),
        (
            "methods: {a: {}}\nmissions: [aggregation]\nbudgets: [40]\nrepetitions: 2\n"
            "assess: {realities: [epuck, nowhere]}",
            "small.yaml:5: assess.realities[1]: nowhere: no such robot model",
        ),
        (
            "methods: {a: {}}\nmissions: [{sample: foraging}]\nbudgets: [40]\nrepetitions: 2",
            "missions[0].seeds: expected",
        ),
    ],
)
def test_mistakes_name_their_places(text, expected, tmp_path, mdesign):
    err = refusal(mdesign, "study", plan_file(tmp_path, text + "\n"))
    assert "small.yaml:" in err
    assert expected in err
    assert not (tmp_path / "studies").exists()


def test_one_repetition_is_said_to_give_no_statistics(tmp_path, mdesign):
    text = PLAN.replace("repetitions: 2", "repetitions: 1")
    code, _, err = mdesign("study", plan_file(tmp_path, text), "-o", tmp_path / "one", "--dry-run")
    assert code == 0
    assert "gives no statistics" in err


def test_a_dry_run_says_what_would_run(copied, tmp_path, mdesign):
    code, out, _ = mdesign("study", plan_file(tmp_path), "-o", tmp_path / "new", "--dry-run", "-j", 2)
    assert code == 0
    assert "8 designs: 2 methods x 2 missions x 1 budgets x 2 repetitions" in out
    assert f"Left       {8 * (40 + 9)} experiments" in out
    assert not (tmp_path / "new").exists()
    _, out, _ = mdesign("study", plan_file(tmp_path), "-o", copied, "--dry-run")
    assert "Left       0 experiments" in out
    fewer = plan_file(
        tmp_path,
        PLAN.replace("runs: 3, realities: [mercator-pseudo-reality, ", "runs: 2, realities: [mercator-varied, "),
    )
    assert f"Left       {8 * 2} experiments" in mdesign("study", fewer, "-o", copied, "--dry-run")[1]
    assert "no difference on a single mission: 2 designs of each method are too few for 2 tests" in out
    _, out, _ = mdesign("study", plan_file(tmp_path, PLAN.replace("repetitions: 2", "repetitions: 20")), "--dry-run")
    assert "standard deviations of a method's designs" in out


def test_a_dry_run_closes_an_executor_of_others(tmp_path, mdesign, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "executor_of_test.py").write_text("""
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

class Noting(ThreadPoolExecutor):
    def shutdown(self, *given, **options):
        super().shutdown(*given, **options)
        Path(__file__).with_name("closed").touch()
""")
    code, _, err = mdesign("study", plan_file(tmp_path), "--dry-run", "--executor", "executor_of_test:Noting")
    assert code == 0, err
    assert (tmp_path / "closed").exists()


def test_robot_models_are_a_factor(tmp_path):
    plan = load_plan(plan_file(tmp_path, PLAN + "robot_models: [mercator, mercator-argos]\n"))
    layout = resolve(plan).layout
    assert list(layout.missions) == ["near", "near@mercator-argos", "foraging", "foraging@mercator-argos"]
    assert layout.missions["near@mercator-argos"].robot_model == "mercator-argos"


def test_a_plan_is_read_again_as_it_is_written(done, tmp_path):
    written = load_plan(done / "study.yaml")
    assert written == load_plan(plan_file(tmp_path))
    assert isinstance(written, StudyPlan)
    assert parse((done / "study.yaml").read_text(), StudyPlan, error=StudyError) == written


def test_a_study_with_own_files_runs_from_its_folder_alone(tmp_path, mdesign):
    own, moved = tmp_path / "own", tmp_path / "elsewhere" / "moved"
    text = shipped.missions()["aggregation"].read_text().replace("duration: 120", "duration: 1")
    files = {"short.yaml": text, "other/short.yaml": text.replace("robots: 3", "robots: 2"), "made/walk.txt": WALK}
    for name, content in files.items():
        (own / name).parent.mkdir(parents=True, exist_ok=True)
        (own / name).write_text(content + "\n")
    plan = MADE.replace("[a.txt, b.txt]", "[made/walk.txt]")
    plan = re.sub("missions: .*", "missions: [short.yaml, {mission: other/short.yaml, name: other}]", plan)
    plan_file(own, plan)
    assert mdesign("study", own / "small.yaml", "-o", own / "done")[0] == 0
    assert mdesign("study", own / "done/study.yaml", "-o", own / "done")[0] == 0  # whose copies are of themselves
    moved.parent.mkdir()
    shutil.move(own / "done", moved)
    shutil.rmtree(own)
    written = load_plan(moved / "study.yaml")
    assert [Path(file).relative_to(moved).as_posix() for file in written.files.values()] == [
        "files/short.yaml", "files/2/short.yaml", "files/walk.txt"
    ]  # fmt: skip
    before = contents(moved)
    code, _, err = mdesign("study", moved / "study.yaml", "-o", moved, "--set", "assess.runs=3")
    assert code == 0, err
    assert contents(moved) != before
    assert mdesign("study", "report", moved)[0] == 0
    assert 'href="cells/other/hand/0/1/fsm.txt"' in (moved / "report.html").read_text()


def test_a_study_that_needs_other_files_copies_none(tmp_path, mdesign):
    (tmp_path / "model.yaml").write_text(shipped.robot_models()["mercator"].read_text())
    text = shipped.missions()["aggregation"].read_text()
    (tmp_path / "own.yaml").write_text(text.replace("robot_model: mercator", "robot_model: ./model.yaml"))
    plan = plan_file(tmp_path, PLAN.replace("mission: aggregation", "mission: ./own.yaml"))
    with StudyFolder.open(tmp_path / "done", resolve(load_plan(plan))):
        stored = load_plan(tmp_path / "done/study.yaml").files["missions[0]"]
        assert Path(stored).resolve() == tmp_path / "own.yaml"
        assert not (tmp_path / "done/files").exists()


def test_cells_of_first_repetitions_come_first(tmp_path):
    cells = resolve(load_plan(plan_file(tmp_path))).layout.cells
    assert [cell.repetition for cell in cells] == [1] * 4 + [2] * 4
    assert cells[0] == Cell("near", "halving", 40, 1)
    assert cells[0].path == Path("near/halving/40/1")


def test_sampled_realities_lie_around_the_design_model():
    model = load_robot_model("epuck")
    drawn = [sampled_reality(model, 0.5, seed) for seed in range(200)]
    assert sampled_reality(model, 0.5, 3) == drawn[3]
    spreads = [one.drive.noise.sd for one in drawn]
    assert min(spreads) >= 0.0
    assert max(spreads) <= 0.05 + 0.5 * 0.15
    losses = [one.neighbours.loss for one in drawn]
    assert 0.825 <= min(losses) < 0.83
    assert 0.87 < max(losses) <= 0.875
    assert all(one.reference_model == model.reference_model for one in drawn)
    assert all(one.lidar is None for one in drawn)
    lidar = sampled_reality(load_robot_model("mercator"), 0.5, 3)
    assert lidar.drive.noise is not None
    assert lidar.drive.maximum_speed == pytest.approx(0.3 / 0.12 * drawn[3].drive.maximum_speed)


def test_validate_knows_studies(tmp_path, mdesign):
    code, out, _ = mdesign("validate", plan_file(tmp_path))
    assert (code, out.partition(": ")[2]) == (0, "valid study, 8 designs, 392 experiments\n")
    code, _, err = mdesign("validate", plan_file(tmp_path, PLAN.replace("repetitions: 2\n", "repetitions: 1\n")))
    assert code == 0
    assert "one design of each method on a mission gives no statistics" in err
    code, _, err = mdesign("validate", plan_file(tmp_path, PLAN.replace("repetitions: 2\n", "")))
    assert code == 3
    assert "repetitions: missing key" in err
    code, _, err = mdesign("validate", plan_file(tmp_path, PLAN + "repetitions: 3\n"))
    assert code == 3
    assert "duplicate key 'repetitions'" in err
    assert "unknown key" not in err


def test_a_shipped_study_is_known_by_its_name(mdesign, monkeypatch):
    assert mdesign("validate", "maple")[:2] == (0, "maple: valid study, 40 designs, 412000 experiments\n")
    assert mdesign("schema", "maple")[1] == mdesign("schema", "study")[1]
    assert mdesign("schema", "aggregation")[1] == mdesign("schema")[1]
    known = {**shipped.missions(), **shipped.robot_models(), **shipped.studies()}
    assert all(map(kind_of_name, known)), "no name is of two shipped files"
    monkeypatch.setattr(shipped, "studies", lambda: {"aggregation": known["maple"]})
    for verb in ("validate", "schema"):
        code, _, err = mdesign(verb, "aggregation")
        assert code == 3
        assert "aggregation: expected the name of one shipped file, found a mission and a study" in err


def test_the_schema_of_studies(mdesign):
    code, out, _ = mdesign("schema", "study")
    schema = json.loads(out)
    assert code == 0
    jsonschema.validate(yaml.safe_load("name: x" + PLAN), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(yaml.safe_load("repetition: 3" + PLAN), schema)


def test_a_race_with_several_seeds_is_a_study(tmp_path, monkeypatch, mdesign):
    monkeypatch.chdir(tmp_path)
    race = ("race", "aggregation", "--budget", 40, "--set", "duration=1", "--set", "robots=2", "--test-runs", 2)
    assert mdesign(*race, "--seeds", "3-4")[0] == 0
    assert sorted(study_table(tmp_path / "studies/aggregation").runs["seed"].unique()) == [3, 4]
    assert mdesign(*race, "--seeds", "3-5")[0] == 0
    assert len(study_table(tmp_path / "studies/aggregation").designs) == 3
    other = refusal(mdesign, *race, "--seeds", "3-5", "--method", "random")  # the page would lose what has run
    assert "expected method halving and budget 40, as in the study there, found method random" in other
    assert len(study_table(tmp_path / "studies/aggregation").designs) == 3
    fewer = refusal(mdesign, *race, "--seeds", "3-4")
    assert (
        "expected seeds 3-5 or a larger B, as the study there has these, found seeds 3-4: give another folder" in fewer
    )
    assert len(study_table(tmp_path / "studies/aggregation").designs) == 3
    for seeds in ("5-3", "1-10001", "2147483640-2147483641"):  # a study's file has limits
        assert "expected A-B" in refusal(mdesign, *race, "--seeds", seeds)
    assert "--seed is of one race" in refusal(mdesign, *race, "--seeds", "3-5", "--seed", 3)
    code, _, _ = mdesign(*race, "--seed", 4, "-o", tmp_path / "alone")
    folder = tmp_path / "studies/aggregation/cells/aggregation/halving/40/2"
    assert code == 0
    assert read_fsm(tmp_path / "alone" / "fsm.txt").software == read_fsm(folder / "fsm.txt").software


def test_python_runs_a_study(tmp_path):
    plan = {**yaml.safe_load(PLAN), "repetitions": 1, "name": "python"}
    seen = []
    table = md.study(plan, folder=tmp_path / "study", watch=seen.append)
    assert len(table.designs) == 4 * 3
    assert (seen[-1].done, seen[-1].known) == (4 * (40 + 9), 0)
    assert [one.done for one in seen] == sorted(one.done for one in seen)
    again = md.study(plan, folder=tmp_path / "study", watch=seen.append)
    assert again.runs.equals(table.runs)
    assert seen[-1].known == seen[-1].total == seen[-1].done
    assert md.study(plan).runs.equals(table.runs)
    with pytest.raises(md.MercatorError, match="methods: expected at least one method"):
        md.study({**plan, "methods": {}})


def test_the_page_and_files_of_a_study(copied, mdesign):
    shutil.rmtree(copied / "cells/near/random/40/2")  # as of a study that is not done
    code, out, _ = mdesign("study", "report", copied)
    assert code == 0
    assert f"Report     {copied / 'report.html'}" in out
    assert len((copied / "tables/designs.csv").read_text().splitlines()) == 1 + 7 * 3
    page = (copied / "report.html").read_text()
    assert "mdesign study report" in page
    unfinished = "Unfinished: of 7 of 8 designs."
    assert unfinished in out.splitlines()
    assert page.count(unfinished) == 1
    for fact in ("random, flavour watermelon, options instances=5", "aggregation as near, with duration=1, robots=2"):
        assert f"<td>{fact}</td>" in page
    linked = [link for link in re.findall(r'href="(.+?)"', page) if link[0] != "#"]
    assert len(linked) == 7
    assert all((copied / link).is_file() for link in linked)
    assert "cells/near/random/40/1/fsm.txt" in linked
    shutil.rmtree(copied / "cells")
    assert "expected designs that are assessed, found none yet" in refusal(mdesign, "study", "report", copied)
    assert "not the folder of a study" in refusal(mdesign, "study", "report", copied.parent)


def test_several_objectives_need_methods_that_rank_by_all(tmp_path, mdesign):
    mission = tmp_path / "two.yaml"
    code, text, _ = mdesign("missions", "show", "aggregation")
    assert code == 0
    data = yaml.safe_load(text)
    first = data.pop("objective")
    data |= {"name": "two", "objectives": [first, {**first, "direction": "minimise"}], "robots": 2, "duration": 1.0}
    mission.write_text(json.dumps(data))
    text = PLAN.replace("mission: foraging", "mission: ./two.yaml")
    err = refusal(mdesign, "study", plan_file(tmp_path, text), "--dry-run")
    assert "methods.random: on two: method: expected one of halving, irace" in err
    text = text.replace("  random: {method: random, options: {instances: 5}}\n", "")
    code, _, err = mdesign("study", plan_file(tmp_path, text), "--dry-run")
    assert code == 0, err
