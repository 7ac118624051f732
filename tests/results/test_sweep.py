"""Sweeps of a setting: what varies, which runs there are, holes, curves, files, and what is run again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import mercator_design as md
from mercator_design.cli.races.sweep import curve_names
from mercator_design.cli.races.sweep import sweep as verb
from mercator_design.config.writing import dump, plain
from mercator_design.errors import MissionError, SimulationError
from mercator_design.fsm import parse
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis.settings import scaled, settings_of
from mercator_design.results.analysis.sweep import COLUMNS, SettingSweep, SweptDesign, SweptRun
from mercator_design.show.sweeps import FIGURES, sweep_figure, sweep_text
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from tests.sim.worlds import mission

pytestmark = pytest.mark.together("kernels")  # compiled once

WALK, STAY = parse("--nstates 1 --s0 0 --rwm0 20"), parse("--nstates 1 --s0 1")
SMALL = mission(duration=2)


def swept(key="robots", values=(1, 2), designs=(("walk", WALK, "walk"),), seeds=(1, 2), **given):
    settings = settings_of(SMALL, None, key, values, **given)
    return SettingSweep(key=key, settings=settings, designs=[SweptDesign(*one) for one in designs], seeds=seeds)


def ran(task, known=None):
    with ThreadExecutor(2) as executor:
        return list(task.run(executor, known))


def test_runs_are_those_of_the_mission_with_the_value():
    table = md.sweep(SMALL, {"walk": WALK, "stay": STAY}, "robots", [1, 3], seeds=[4, 5], jobs=2)
    assert list(table.columns) == list(COLUMNS)
    assert table[["value", "method", "seed"]].to_numpy().tolist() == [
        [value, method, seed] for value in (1.0, 3.0) for method in ("walk", "stay") for seed in (4, 5)
    ]
    expected = Simulator(mission(duration=2, robots=3)).run(WALK, 5).score
    assert table.query("value == 3 and method == 'walk' and seed == 5")["score"].item() == expected


def test_a_value_that_does_not_fit_is_a_hole_with_its_reason():
    table = md.sweep(SMALL, {"walk": WALK}, "robots", [1, 500], seeds=[1])
    hole = table[table["value"] == 500]
    assert hole["score"].isna().all()
    assert hole["instance"].isna().all()
    assert "the robots do not fit" in hole["failure"].item()
    assert table[table["value"] == 1]["failure"].item() == ""


def test_a_design_without_its_senses_is_a_hole():
    blind = replace(load_robot_model("mercator"), neighbours=None)
    task = SettingSweep(
        key="robots",
        settings=settings_of(SMALL, blind, "robots", [1]),
        designs=[SweptDesign("walk", WALK, "walk"), SweptDesign("pull", parse("--nstates 1 --s0 2 --att0 3"), "pull")],
        seeds=[1],
    )
    runs = ran(task)
    assert [one.scores == () for one in sorted(runs, key=lambda one: one.design)] == [False, True]
    assert "needs neighbours" in sweep_text(task, task.curves(runs))
    assert task.size == 1


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("robot_model.failures.share", 0.5, lambda one: one.robot_model.failures.share),
        ("robot_model.drive.noise.sd", 1e-05, lambda one: one.robot_model.drive.noise.sd),
        ("robot_model.lidar.noise", {"distribution": "gaussian", "sd": 0.1}, None),
        ("duration", 3.0, lambda one: one.mission.duration),
        ("robot_model", "epuck", lambda one: one.robot_model.name),
    ],
)
def test_keys_of_missions_and_robot_models(key, value, found):
    (one,) = settings_of(SMALL, None, key, [value])
    assert one.failure == ""
    if found is not None:
        assert found(one.simulator) == value


def test_assignments_hold_for_all_values():
    settings = settings_of(SMALL, None, "robots", [1, 2], overrides=["robot_model.failures.share=0.5", "duration=5"])
    assert {one.simulator.robot_model.failures.share for one in settings} == {0.5}
    assert {one.simulator.mission.duration for one in settings} == {5.0}


@pytest.mark.parametrize("key", ["robot_model.failures.shar", "robot_model.drive", "robts", "arena.scale"])
def test_wrong_keys_and_values_name_their_place(key):
    (one,) = settings_of(SMALL, None, key, ["x"])
    assert one.simulator is None
    assert one.failure.startswith(("unknown key", "expected"))  # who shows it names key and value
    (one,) = settings_of(SMALL, None, "duration", [3], overrides=[f"{key}=x"])
    assert one.failure.startswith(f"--set {key}=x: ")


def test_a_scaled_arena_is_the_same_in_another_size():
    for name in ("foraging", "map_rooms", "chocolate_spc", "cleaning", "grid_exploration", "mate_spd8"):
        one = md.load_mission(name)
        (twice,) = settings_of(one, None, "arena.scale", [2.0])
        assert twice.failure == "", name
        found = twice.simulator.mission
        assert found.arena.area == pytest.approx(4.0 * one.arena.area)
        assert found.arena.wall_height == one.arena.wall_height
        points = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
        before, after = (each.realise_floor(np.random.default_rng(1)) for each in (one, found))
        from mercator_design.missions.floor_kernels import colour_at

        assert [colour_at(before, x, y) for x, y in points] == [colour_at(after, 2 * x, 2 * y) for x, y in points], name
    assert scaled(plain(one), 1.0) == plain(one)
    assert one.lights == () or scaled(plain(one), 2.0)["lights"][0]["position"][2] == one.lights[0].position[2]


def test_kept_density_gives_each_robot_the_same_room():
    settings = settings_of(mission(robots=2), None, "robots", [2, 8], keeps_density=True)
    assert settings[0].simulator.mission.arena.area == pytest.approx(mission().arena.area)
    assert settings[1].simulator.mission.arena.area == pytest.approx(4.0 * mission().arena.area)
    with pytest.raises(MissionError, match="density"):
        settings_of(SMALL, None, "duration", [1], keeps_density=True)


def test_the_unit_of_a_curve_is_the_design_if_there_are_several():
    task = swept(values=(1,), designs=(("a", WALK, "both"), ("b", STAY, "both")))
    (point,) = task.curves(
        [SweptRun(0, d, k, (score,)) for d, k, score in ((0, 0, 1.0), (0, 1, 3.0), (1, 0, 6.0), (1, 1, 8.0))]
    )
    assert (point.mean, point.designs, point.runs) == (4.5, 2, 4)
    half = 12.706204736 * np.std([2.0, 7.0], ddof=1) / np.sqrt(2)  # Student's t of one degree of freedom
    possible = task.settings[0].simulator.mission.possible_scores()
    assert (point.low, point.high) == pytest.approx(possible.clipped(4.5 - half, 4.5 + half))
    (alone,) = swept(values=(1,)).curves([SweptRun(0, 0, 0, (1.0,)), SweptRun(0, 0, 1, (3.0,))])
    assert alone.designs == 1
    assert alone.high == pytest.approx(2.0 + 12.706204736)


def test_what_is_known_is_not_run_again():
    task = swept()
    runs = ran(task)
    known = {
        (task.digest(one.setting, one.design), task.seeds[one.instance]): (one.scores[0] + 1000.0,) for one in runs
    }
    assert task.rows(ran(task, known)) == task.rows([one._replace(scores=(one.scores[0] + 1000.0,)) for one in runs])
    other = swept(values=(1, 3))
    assert {one.scores[0] < 1000.0 or one.setting == 0 for one in ran(other, {**known})} == {True}


def test_a_failed_experiment_is_a_row_with_its_reason():
    class Fails(ThreadExecutor):
        def run(self, function, items):
            return super().run(lambda item: 1 / 0 if item[2] == 2 else function(item), items)

    task = swept(values=(1,))
    with Fails(1) as executor:
        runs = list(task.run(executor))
    assert [one.scores == () for one in sorted(runs, key=lambda one: one.instance)] == [False, True]
    assert "ZeroDivisionError" in task.curves(runs)[0].failure
    assert task.curves(runs)[0].runs == 1


@pytest.mark.parametrize("name", ["settings", "designs", "seeds"])
def test_nothing_to_sweep_is_an_error(name):
    with pytest.raises(SimulationError, match=name):
        replace(swept(), **{name: ()})
    with pytest.raises(SimulationError, match="different names"):
        swept(designs=(("a", WALK, "a"), ("a", STAY, "b")))


@pytest.mark.parametrize("values", [(1, 2, 500), ("mercator", "epuck")])
def test_figures_are_the_same_each_time(values):
    task = swept(key="robots" if values[0] == 1 else "robot_model", values=values)
    runs = ran(task)
    first, again = (sweep_figure(task, task.curves(runs), ".pdf") for _ in range(2))
    assert first == again
    assert first.startswith(b"%PDF")


def test_each_of_several_objectives_has_rows_a_curve_and_a_panel(fsm, tmp_path):
    out = tmp_path / "out"
    given = (fsm, "--mission", "frugal_aggregation", "--set", "duration=2", "-o", out, "-n", "2", "-q")
    shown = call(*given, "--over", "robots=2,500").output
    assert "robots_in_zone (maximise)" in shown
    assert "path_length (minimise)" in shown
    runs = pd.read_csv(out / "runs.csv")
    assert runs["objective"].fillna("").tolist() == [*["robots_in_zone", "path_length"] * 2, ""]
    settings = settings_of(md.load_mission("frugal_aggregation", ["duration=2"]), None, "robots", [2])
    scored = settings[0].simulator.run(WALK, int(runs["seed"][0])).scored
    assert runs["score"][:2].tolist() == [*scored.by_objective]
    curves = pd.read_csv(out / "curves.csv")
    assert curves.groupby("objective")["mean"].count().to_dict() == {"robots_in_zone": 1, "path_length": 1}
    assert curves.query("value == 2")["runs"].tolist() == [2, 2]
    data = json.loads((out / "sweep.json").read_text())
    assert data["objectives"] == {"robots_in_zone": "maximise", "path_length": "minimise"}
    changed = (out / "runs.csv").read_text().replace(repr(float(runs["score"][1])), "123.5")
    (out / "runs.csv").write_text(changed)
    assert call(*given, "--over", "robots=2,500").exit_code == 0
    assert pd.read_csv(out / "runs.csv")["score"][1] == 123.5  # was taken as it was
    task = SettingSweep(key="robots", settings=settings, designs=[SweptDesign("walk", WALK, "walk")], seeds=(1,))
    assert b"path_length" in sweep_figure(task, task.curves(ran(task)), ".svg")


@pytest.mark.parametrize(
    ("key", "title"),
    [
        ("duration", "duration [s]"),
        ("robots", "robots"),
        ("arena.scale", "arena.scale"),
        ("arena.wall_height", "arena.wall_height [m]"),
        ("robot_model.body.mass", "robot_model.body.mass [kg]"),
    ],
)
def test_the_axis_has_the_unit_of_the_setting(key, title):
    task = swept(key=key, values=(1, 2))
    runs = [SweptRun(k, 0, 0, (1.0,)) for k, one in enumerate(task.settings) if one.simulator is not None]
    assert f"<!-- {title} -->".encode() in sweep_figure(task, task.curves(runs), ".svg")


@pytest.fixture
def fsm(tmp_path):
    file = tmp_path / "walk.txt"
    file.write_text("--nstates 1 --s0 0 --rwm0 20\n")
    return file


def call(*arguments):
    return CliRunner().invoke(verb, [*map(str, arguments)], catch_exceptions=False)


def test_the_command_writes_its_files_and_continues(fsm, tmp_path):
    out = tmp_path / "out"
    given = (fsm, "--mission", "grid_exploration", "--set", "duration=2", "-o", out, "-n", "2", "--progress", "none")
    assert call(*given, "--over", "robots=1,500").exit_code == 0
    first = pd.read_csv(out / "runs.csv")
    assert first["value"].tolist() == [1, 1, 500]
    assert json.loads((out / "sweep.json").read_text())["command"]  # and not in the picture
    assert {*FIGURES, "curves.csv", "runs.csv", "sweep.json"} == {one.name for one in out.iterdir()}
    changed = (out / "runs.csv").read_text().replace(str(first["score"][0]), "123.5")
    (out / "runs.csv").write_text(changed)
    shown = call(*given, "--over", "robots=1,2,500", "--json")
    assert json.loads(shown.stdout)["values"] == [1, 2, 500]
    again = pd.read_csv(out / "runs.csv")
    assert again["score"][0] == 123.5  # was taken as it was
    assert again["value"].tolist() == [1, 1, 2, 2, 500]
    (out / "runs.csv").write_text("nonsense\n")
    with pytest.raises(md.MercatorError, match="expected a table of runs"):
        call(*given, "--over", "robots=1,2,500")


def test_a_folder_with_another_sweep_is_refused_with_what_differs(fsm, tmp_path):
    out, other = tmp_path / "out", tmp_path / "other.txt"
    other.write_text("--nstates 1 --s0 1\n")
    given = ("--mission", "grid_exploration", "-o", out, "-q")
    usual = ("--set", "duration=2", "-n", "2", "--over", "robots=1,2")
    assert call(fsm, *given, *usual).exit_code == 0
    before = (out / "runs.csv").read_bytes()
    for designs, changed, message in (
        ([fsm], ("--set", "duration=2", "-n", "2", "--over", "robots=2,3"), "expected also the earlier value 1"),
        ([fsm], ("--set", "duration=2", "-n", "2", "--over", "duration=1"), "--over: expected robots, found duration"),
        ([fsm], ("--set", "duration=2", "-n", "1", "--over", "robots=1,2"), "-n: expected at least 2"),
        ([fsm], (*usual, "--seed", "7"), "--seed: expected that of the earlier runs"),
        ([fsm], ("--set", "duration=3", *usual[2:]), "robots=1: expected the mission and the robots"),
        ([other], usual, "walk.txt: expected also this earlier design"),
    ):
        wrong = call(*designs, *given, *changed)
        assert wrong.exit_code == 2
        assert message in " ".join(wrong.stderr.split())
        assert (out / "runs.csv").read_bytes() == before
    assert call(other, fsm, *given, "--set", "duration=2", "-n", "3", "--over", "robots=2,1,3").exit_code == 0
    assert len(pd.read_csv(out / "runs.csv")) == 2 * 3 * 3
    fsm.write_text("--nstates 1 --s0 0 --rwm0 21\n")
    wrong = call(fsm, other, *given, "--set", "duration=2", "-n", "3", "--over", "robots=2,1,3")
    assert "walk.txt: expected the earlier design" in " ".join(wrong.stderr.split())


@pytest.mark.parametrize(("name", "text"), [("notes.txt", "mine"), ("sweep.json", "[]"), ("sweep.json", "{")])
def test_a_folder_with_other_files_is_refused(fsm, tmp_path, name, text):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text(text)
    wrong = call(fsm, "--mission", "grid_exploration", "-o", tmp_path / "out", "--over", "robots=1")
    assert wrong.exit_code == 2
    assert "expected" in wrong.stderr
    assert [one.name for one in (tmp_path / "out").iterdir()] == [name]


def test_winners_of_a_study_are_curves_of_their_methods(fsm, tmp_path):
    for method, repetition, wheels in (("a", 1, 5), ("a", 2, 50), ("b", 1, 20)):
        cell = tmp_path / "study" / "cells" / "grid_exploration" / method / "500" / str(repetition)
        cell.mkdir(parents=True)
        (cell / "fsm.txt").write_text(f"--nstates 1 --s0 0 --rwm0 {wheels}\n")
    given = ("--mission", "grid_exploration", "--set", "duration=2", "-o", tmp_path / "out", "-n", "2", "-q")
    assert call(tmp_path / "study", *given, "--over", "robots=1").exit_code == 0
    curves = pd.read_csv(tmp_path / "out" / "curves.csv")
    assert curves[["method", "designs", "runs"]].to_numpy().tolist() == [["a", 2, 4], ["b", 1, 2]]
    (tmp_path / "study" / "cells" / "other").mkdir()
    wrong = call(tmp_path / "study", "-o", tmp_path / "out", "--over", "robots=1")
    assert wrong.exit_code == 2
    assert "grid_exploration, other" in wrong.stderr


def test_winners_of_several_budgets_are_curves_of_their_own(fsm, tmp_path):
    study = tmp_path / "study"
    for cell in ("a/100/1", "a/200/1", "a/200/2", "b/200/1"):
        (study / "cells" / "grid_exploration" / cell).mkdir(parents=True)
        (study / "cells" / "grid_exploration" / cell / "fsm.txt").write_text(fsm.read_text())
    given = ("--mission", "grid_exploration", "--set", "duration=2", "-o", tmp_path / "out", "-n", "1", "-q")
    assert call(study, fsm, *given, "--over", "robots=1").exit_code == 0
    curves = pd.read_csv(tmp_path / "out" / "curves.csv")
    found = curves[["method", "designs"]].to_numpy().tolist()
    assert found == [["a/100", 1], ["a/200", 2], ["b", 1], ["walk", 1]]


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (("x/agg/halving/200/1/fsm.txt", "x/agg/irace/200/1/fsm.txt"), ("halving/200/1", "irace/200/1")),
        (("a/1/fsm.txt", "b/1/fsm.txt", "a/2/fsm.txt"), ("a/1", "b/1", "2")),
        (("1/fsm.txt", "x/1/fsm.txt"), ("1", "x/1")),
        (("x/a.txt", "x/a.yaml", "x/a/fsm.txt"), ("a.txt", "a.yaml", "a")),
        (("/x/walk.txt", "/y/walk.txt", "fsm.txt"), ("x/walk", "y/walk", "fsm")),
    ],
)
def test_curves_have_the_shortest_names_that_differ(files, names):
    assert tuple(curve_names([*map(Path, files)], {}).values()) == names


def test_methods_of_two_studies_are_not_one_curve():
    winners = {Path(f"{study}/cells/m/irace/200/1/fsm.txt"): Path(study, "irace") for study in ("one", "two")}
    files = [*winners, Path("irace.txt")]
    assert [*curve_names(files, winners).values()] == ["one/irace", "two/irace", "irace"]


def test_designs_of_folders_of_one_name_are_two_curves(tmp_path):
    folders = [tmp_path / method / "200" / "1" for method in ("halving", "irace")]
    for folder, wheels in zip(folders, (5, 50), strict=True):
        folder.mkdir(parents=True)
        (folder / "fsm.txt").write_text(f"--nstates 1 --s0 0 --rwm0 {wheels}\n")
    given = ("--mission", "grid_exploration", "--set", "duration=2", "-o", tmp_path / "out", "-n", "2", "-q")
    assert call(*folders, *given, "--over", "robots=1").exit_code == 0
    curves = pd.read_csv(tmp_path / "out" / "curves.csv")
    assert curves[["method", "designs"]].to_numpy().tolist() == [["halving/200/1", 1], ["irace/200/1", 1]]


@pytest.mark.parametrize("given", [("--mission", "agg"), ()])
def test_a_mission_of_a_study_is_known_by_its_name_there(fsm, tmp_path, given):
    cells = tmp_path / "study" / "cells" / "agg"
    for cell in ("a/100/1", "hand/0/1"):  # a hand-made design has no mission beside it
        (cells / cell).mkdir(parents=True)
        (cells / cell / "fsm.txt").write_text(fsm.read_text())
    raced = md.load_mission("aggregation", ["duration=3", "robots=2"])
    (cells / "a/100/1/mission.yaml").write_text(dump(raced))
    shown = call(tmp_path / "study", *given, "-o", tmp_path / "out", "-n", "1", "-q", "--over", "duration=2,3")
    assert shown.exit_code == 0, shown.output
    scores = pd.read_csv(tmp_path / "out" / "runs.csv").query("value == 3 and method == 'a'")
    assert scores["score"].item() == Simulator(raced).run(WALK, int(scores["seed"].item())).score
    (tmp_path / "study" / "cells" / "stop").mkdir()
    wrong = call(tmp_path / "study", "--mission", "foraging", "-o", tmp_path / "out", "--over", "robots=1")
    assert wrong.exit_code == 2
    assert "one of: agg, stop" in wrong.stderr
    other = tmp_path / "other" / "cells" / "agg" / "a" / "100" / "1"
    other.mkdir(parents=True)
    (other / "fsm.txt").write_text(fsm.read_text())
    (other / "mission.yaml").write_text(dump(md.load_mission("aggregation")))
    both = (tmp_path / "study", tmp_path / "other")
    wrong = call(*both, "--mission", "agg", "-o", tmp_path / "out", "--over", "robots=1")
    assert wrong.exit_code == 2
    assert "another mission agg" in wrong.stderr


def test_designs_that_are_equal_are_not_run_again(fsm, tmp_path):
    twin = tmp_path / "twin.txt"
    twin.write_text(fsm.read_text())
    out = tmp_path / "out"
    given = (
        fsm,
        twin,
        "--mission",
        "grid_exploration",
        "--set",
        "duration=2",
        "-o",
        out,
        "-n",
        "1",
        "--over",
        "robots=1",
    )
    assert call(*given).exit_code == 0
    table = pd.read_csv(out / "runs.csv")
    assert len({*table["digest"]}) == 1
    table.assign(score=123.5).to_csv(out / "runs.csv", index=False)
    assert call(*given).exit_code == 0
    assert pd.read_csv(out / "runs.csv")["score"].tolist() == [123.5, 123.5]  # was taken as it was


@pytest.mark.parametrize(
    "over",
    [
        *("robots", "=1", "robots=", "robots=[", "robots=1,1", "robots=1,,2"),
        *("robots=2026-13-45", "duration=2026-01-01", "duration=1,.inf", "robots=!!binary aGVsbG8="),
    ],
)
def test_wrong_values_are_wrong_usage(fsm, tmp_path, over):
    wrong = call(fsm, "--mission", "grid_exploration", "-o", tmp_path / "out", "--over", over)
    assert wrong.exit_code == 2
    assert "--over" in wrong.stderr


@pytest.mark.parametrize(
    ("given", "messages"),
    [
        (["--over", "robts=1,2"], ("robts: unknown key; did you mean 'robots'?",)),
        (["--over", "robots=600"], ("robots=600: the robots do not fit",)),
        (["--over", "robots=600,700"], ("robots=600: the robots do not fit", "robots=700: the robots do not fit")),
        (["--over", "robots=1,2", "--set", "robot_model.failures.shar=1"], ("--set robot_model.failures.shar=1: ",)),
    ],
)
def test_no_possible_value_is_an_error_that_names_key_and_value_once(fsm, tmp_path, given, messages):
    with pytest.raises(MissionError) as error:
        call(fsm, "--mission", "grid_exploration", "-o", tmp_path / "out", *given)
    assert len(error.value.messages) == len(messages)
    for found, begin in zip(error.value.messages, messages, strict=True):
        assert found.startswith(begin)
        assert found.count(begin.partition(":")[0]) == 1
