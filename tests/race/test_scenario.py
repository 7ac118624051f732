"""What the options of irace's scenario.txt come to; that none of them is passed over in silence."""

import os
import shlex
from pathlib import Path

import pytest

from mercator_design.errors import RaceError
from mercator_design.race import RaceOptions
from mercator_design.race.irace.scenario import read_scenario
from mercator_design.race.irace.scenario_options import OPTIONS
from mercator_design.race.irace.scenario_text import Assignment
from mercator_design.race.irace.target_runner import RunnerCall

SPACE = 'x "--x " r (0, 1)\nrule "--rule " c (slow, fast)\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "parameters.txt").write_text(SPACE)
    for name in ("target-runner", "other"):
        (tmp_path / name).write_text("#!/bin/sh\necho 1\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "list.txt").write_text("# instances\n\nb --opt 1  # the first\na\n")
    (tmp_path / "data" / "sub").mkdir(parents=True)
    for name in ("z", "sub/y", ".hidden"):
        (tmp_path / "data" / name).write_text("")
    (tmp_path / "start.txt").write_text("x rule\n0.5 fast\n")
    return tmp_path


@pytest.fixture
def scenario(folder):
    """Reads a scenario with these lines, and with all that is needed beside them."""

    def read(text, *given, needed='maxExperiments = 500\ninstances = c("i", "j")\n'):
        (folder / "scenario.txt").write_text(needed + text)
        return read_scenario(folder / "scenario.txt", given)

    return read


def test_what_is_not_set_is_irace_s(scenario, folder):
    one = scenario("")
    assert one.options == RaceOptions()
    assert (one.budget, one.seed, one.jobs) == (500, 1, 1)
    assert (one.name, one.instances, one.test_instances) == (folder.name, ("i", "j"), ())
    assert (one.target.runner, one.target.folder) == (folder / "target-runner", folder)
    assert one.notes == ()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('testType = "t-test"', {"test": "t-test"}),
        ('testType = "F-test"', {"test": "friedman"}),
        ('testType = "t-test-holm"', {"test": "t-test-holm"}),
        ('testType = "t.none"', {"test": "t-test"}),
        ('testType = "t.holm"', {"test": "t-test-holm"}),
        ('testType = "T.Bonferroni"', {"test": "t-test-bonferroni"}),
        ("firstTest = 1\nmu = 0", {"first_test": 1, "mu": 0}),
        ("eachTest = 5", {"each_test": 5, "first_test": 5, "elitist_new_instances": 1}),
        ("eachTest = 2", {"each_test": 2, "first_test": 6}),
        ("maxExperiments = 0x200", {"mu": 5}),
        ("firstTest = 6\neachTest = 2\nelitistNewInstances = 2",
         {"first_test": 6, "each_test": 2, "elitist_new_instances": 2}),
        ("blockSize = 2\nmu = 10", {"block_size": 2, "mu": 10}),
        ("elitist = 0", {"elitist": False}),
        ("elitistLimit = 0", {"elitist_limit": 0}),
        ("nbIterations = 3\nminNbSurvival = 2\nnbConfigurations = 9\nnbExperimentsPerIteration = 100",
         {"iterations": 3, "survivors": 2, "n_configurations": 9, "experiments_per_iteration": 100}),
        ("nbIterations = 0", {"iterations": None}),
        ("deterministic = 1\nfirstTest = 2\nsampleInstances = 0", {"instances": 2, "sample_instances": False}),
        ("softRestart = FALSE\nsoftRestartThreshold = 0.01", {"soft_restart": False, "soft_restart_threshold": 0.01}),
        ('confidence = "0.9"\npostselection = 0', {"confidence": 0.9, "postselection": False}),
    ],
)  # fmt: skip
def test_options_of_the_race(scenario, text, expected):
    options = scenario(text).options
    assert {name: getattr(options, name) for name in expected} == expected


def test_the_first_test_follows_on_those_after_it(scenario, folder):
    assert scenario("eachTest = 5").notes == ()
    assert scenario("eachTest = 2").notes == (
        f"{folder / 'scenario.txt'}:3: eachTest: firstTest is 6, a multiple of it",
    )


def test_a_launcher_is_found_as_a_shell_finds_it(scenario, folder, monkeypatch):
    (folder / "bin").mkdir()
    (folder / "bin" / "snake").write_text("#!/bin/sh\n")
    (folder / "bin" / "snake").chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder / 'bin'}:/usr/bin")
    (folder / "snake").write_text("not this one")
    assert scenario('targetRunnerLauncher = "snake"').target.launcher == folder / "bin" / "snake"
    with pytest.raises(RaceError, match=r"targetRunnerLauncher: .*snake is not executable; run chmod \+x"):
        scenario('targetRunnerLauncher = "./snake"')
    assert scenario('targetEvaluator = "other"').target.evaluator == folder / "other"
    (folder / "snake").unlink()
    assert scenario('targetRunner = "snake"').target.runner == folder / "bin" / "snake"
    with pytest.raises(RaceError, match="targetRunnerLauncher: expected a file, found none at"):
        scenario('targetRunnerLauncher = "nobody-has-this"')


def test_what_irace_refuses_of_parameters_is_reported(scenario, folder):
    (folder / "parameters.txt").write_text('x "--x " r(0, 1)\n')
    assert scenario("").notes == (f"{folder / 'parameters.txt'}:1, column 11: irace expects a blank after the type",)


def test_only_what_is_set_differs(scenario):
    assert scenario("mu = 7").options == RaceOptions(mu=7)


def test_how_the_target_is_run(scenario, folder):
    one = scenario(
        'targetRunner = "./other"\ntargetRunnerLauncher = "target-runner"\nexecDir = "data"\n'
        'targetEvaluator = "other"\n'
        'targetCmdline = "{seed} {instance} {targetRunnerArgs}"\ntargetRunnerRetries = 2\ntargetRunnerTimeout = 9\n'
        "parallel = 3\nseed = 12\nsampleInstances = 0\n"
    )
    target = one.target
    assert (target.runner, target.launcher, target.evaluator) == (
        folder / "other",
        folder / "target-runner",
        folder / "other",
    )
    assert (target.folder, target.retries, target.timeout) == (folder / "data", 2, 9)
    assert target.cmdline == "{seed} {instance} {targetRunnerArgs}"
    assert one.notes == ()
    assert (one.jobs, one.seed, one.options.sample_instances) == (3, 12, False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('instances = "one"', ("one",)),
        ('instances = c("a", 2)', ("a", "2")),
        ('trainInstancesFile = "list.txt"', ("b --opt 1", "a")),
        ('trainInstancesFile = "list.txt"\ntrainInstancesDir = "data"', ("{}/data/b --opt 1", "{}/data/a")),
        ('trainInstancesDir = "./data/"', ("{}/data/sub/y", "{}/data/z")),
    ],
)
def test_instances(scenario, folder, text, expected):
    assert scenario(text, needed="maxExperiments = 500\n").instances == tuple(one.format(folder) for one in expected)


ODD = ("a b", "it's", 'say "hi"', "back\\slash", "(1)")


@pytest.mark.parametrize("kind", ["train", "test"])
def test_a_path_from_a_folder_is_one_argument(scenario, folder, kind):
    (folder / "my data").mkdir()
    for name in ODD:
        (folder / "my data" / name).write_text("")
    one = scenario(
        f'{kind}InstancesDir = "my data"', needed="maxExperiments = 500\n" + 'instances = "i"\n' * (kind == "test")
    )
    listed = one.instances if kind == "train" else one.test_instances
    calls = [RunnerCall(configuration=0, instance_id="1", seed=2, instance=each, arguments="--x 1") for each in listed]
    paths = sorted(str(folder / "my data" / name) for name in ODD)
    assert [one.target.command(call)[1:] for call in calls] == [["0", "1", "2", path, "--x", "1"] for path in paths]
    assert [one.target.evaluation(call, [0])[1:] for call in calls] == [
        ["0", "1", "2", path, "1", "0"] for path in paths
    ]
    (folder / "list.txt").write_text("'a b' --size 3\n(1)\n")
    lines = scenario(
        'trainInstancesFile = "list.txt"\ntrainInstancesDir = "my data"', needed="maxExperiments = 500\n"
    ).instances
    assert [shlex.split(line) for line in lines] == [
        [f"{folder}/my data/a b", "--size", "3"],
        [f"{folder}/my data/(1)"],
    ]


def test_a_share_of_the_budget_for_postselection(scenario, folder):
    one = scenario("postselection = 0.05")
    assert one.options.postselection == 0.05
    assert one.notes == (
        f"{folder / 'scenario.txt'}:3: postselection: 0.05 of the budget is kept for the race among the best of all "
        "iterations, as in irace 3; irace 4 takes it for 0",
    )
    assert [scenario(f"postselection = {flag}").options.postselection for flag in (0, 1, "TRUE")] == [False, True, True]
    assert scenario("postselection = 0.05\nelitist = 0").options.kept(500) == 0


def test_test_instances_and_initial_configurations(scenario):
    one = scenario(
        'testInstancesFile = "list.txt"\ntestNbElites = 2\ntestIterationElites = 1\nconfigurationsFile = "start.txt"'
    )
    assert (one.test_instances, one.test_elites, one.test_iterations) == (("b --opt 1", "a"), 2, True)
    assert one.initial == ({"x": 0.5, "rule": "fast"},)


def test_the_command_line_wins(scenario, folder):
    given = Assignment("maxExperiments", 700, "the command line"), Assignment("execDir", str(folder / "data"), "")
    one = scenario("", *given)
    assert (one.budget, one.target.folder) == (700, folder / "data")


@pytest.mark.parametrize(("text", "budget"), [("minExperiments = 10", 96), ("minExperiments = 800", 800)])
def test_the_least_budget_is_irace_s(scenario, text, budget):
    assert scenario(text, needed='instances = "i"\n').budget == budget


VALUES = {"flag": ("1", "0"), "count": ("3", "4"), "part": ("0.5", "0.25"), "text": ('"pbs"', '"x"'),
          "path": ('"data"', '"x"'), "object": ("c(1, 2)", '"x"')}  # fmt: skip


def other_than_default(name):
    option = OPTIONS[name]
    return next(text for text in VALUES[option.kind] if text != str(int(bool(option.default))) or option.kind != "flag")


@pytest.mark.parametrize("name", [name for name, option in OPTIONS.items() if option.refused])
def test_what_cannot_be_obeyed_is_refused_unless_it_is_the_default(scenario, folder, name):
    with pytest.raises(RaceError) as error:
        scenario(f"{name} = {other_than_default(name)}")
    assert f"{folder / 'scenario.txt'}:3: {name}: expected its default" in str(error.value)
    assert OPTIONS[name].refused in str(error.value)
    default = OPTIONS[name].default
    text = {None: "NA", True: "1", False: "0"}.get(default, f'"{default}"')
    assert scenario(f"{name} = {text}").options == RaceOptions()


@pytest.mark.parametrize("name", [name for name, option in OPTIONS.items() if option.ignored])
def test_what_makes_no_difference_is_said(scenario, folder, name):
    [note] = scenario(f"{name} = {other_than_default(name)}").notes
    assert note.startswith(f"{folder / 'scenario.txt'}:3: {name} has no effect: ")


def test_all_of_irace_s_options_are_known():
    """Those of irace 4.4 that a scenario may have, and one that is newer."""
    assert len(OPTIONS) == 64 + 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "deterministic = 1",
            ":3: deterministic: expected 5 or more, for the first test, found 2; add instances, or set firstTest",
        ),
        ("postselection = 1.5", ":3: postselection: expected 0, 1 or a share of the budget, found 1.5"),
        ("maxExperiment = 5", ":3: expected an option of irace, found maxExperiment; did you mean maxExperiments?"),
        ("parametersFile = 'x'", "did you mean parameterFile?"),
        ("wholly = 5", "begin the name of your own variable with a dot"),
        ("digits = 2", ":3: digits is no option of irace 4: since irace 4 it is in parameterFile: [global]"),
        ("forbiddenFile = 'x'", "below [forbidden]"),
        ("maxExperiments = 'many'", ":3: maxExperiments: expected a whole number, 0 to 2147483647, found 'many'"),
        ("maxExperiments = 1.5", "expected a whole number"),
        ("maxExperiments = '1_0_0'", "expected a whole number, 0 to 2147483647, found '1_0_0'"),
        ("maxExperiments = -1", "found -1"),
        ("maxExperiments = 0", "scenario.txt: expected a budget, maxExperiments = N, found none"),
        ("parallel = 257", ":3: parallel: expected 0 to 256, found 257"),
        (r"instances = c('a\ud800b')", r"expected a character, found '\ud800'"),
        (r"instances = 'a\0b'", r"expected a character, found '\0'"),
        ("instances = 'a\0b'", "instances: expected text without NUL bytes, found 'a\\x00b'"),
        ("elitist = 2", ":3: elitist: expected 0 or 1, found 2"),
        ("confidence = 95", ":3: confidence: expected a number from 0 to 1, found 95"),
        ("confidence = 1", ":3: confidence: expected between 0 and 1, found 1"),
        ("testType = 'z-test'", ":3: testType: expected f-test or t.none or t.holm or t.bonferroni, found z-test"),
        ("targetRunner = 3", ":3: targetRunner: expected a path in quotes, found 3"),
        ("firstTest = 0", ":3: firstTest: expected 1 or more"),
        ("firstTest = 5\neachTest = 2", ":3: firstTest: expected 1 or more and a multiple of eachTest (2), found 5"),
        ("blockSize = 3", ":3: blockSize: expected the number of instances (2) to be a multiple of it, found 3"),
        ("parameterFile = 'nowhere.txt'", ":3: parameterFile: "),
        ("parameterFile = 'data'", "expected a file, found a folder"),
        ("targetRunner = 'nowhere'", ":3: targetRunner: expected a file, found none at "),
        ("targetRunner = 'list.txt'", "list.txt is not executable; run chmod +x"),
        ("targetCmdline = '{seed} {instance}'", ":3: targetCmdline: expected {targetRunnerArgs} in it"),
        ("execDir = 'nowhere'", ":3: execDir: expected a folder, found none at "),
        ("instances = c('a', NA)", ":3: instances: expected texts, as c(...), found None"),
        ("instances = ''", "expected instances: trainInstancesDir, trainInstancesFile or instances, found none"),
        ("instances=''; trainInstancesFile = 'empty.txt'", "empty.txt: expected an instance a line, found none"),
        ("instances=''; trainInstancesFile = 'no.txt'", ":3: trainInstancesFile: expected a file, found none at "),
        ("instances=''; trainInstancesDir = 'void'", ":3: trainInstancesDir: expected files in "),
        ("instances=''; trainInstancesDir = 'no'", ":3: trainInstancesDir: expected a folder, found none at "),
        ("configurationsFile = 'wrong.txt'", "wrong.txt:2: parameter 'x': expected a number, found 'high'"),
        ("parameterFile = 'wrong.txt'", "wrong.txt:1, column 3: expected a switch in quotes"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(scenario, folder, text, message):
    (folder / "empty.txt").write_text("# nothing\n")
    (folder / "wrong.txt").write_text("x rule\nhigh fast\n")
    (folder / "void").mkdir()
    with pytest.raises(RaceError) as error:
        scenario(text)
    assert message in str(error.value)


def test_an_instance_whose_name_is_not_text_is_refused(scenario, folder):
    (folder / "void").mkdir()
    (folder / "void" / os.fsdecode(b"\xff")).touch()
    with pytest.raises(RaceError, match=r"expected text without NUL bytes, found '.*\\udcff'"):
        scenario("instances=''; trainInstancesDir = 'void'")


def test_a_missing_scenario_is_named():
    with pytest.raises(RaceError, match=r"nowhere/scenario\.txt: no such file"):
        read_scenario(Path("nowhere/scenario.txt"))
