"""The options of irace's scenarios: all options of irace 4.4, and which of them are supported.

An option that is not supported is refused unless it has its default; the message says what to do instead.
"""

import difflib
import re
from collections.abc import Mapping
from typing import Literal, NamedTuple

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.irace.scenario_text import Setting
from mercator_design.race.irace.target_runner import CMDLINE
from mercator_design.race.space.r_operators import MAX_INTEGER

_IS_R = "R cannot be run here"
_NO_CAPPING = "capping is not supported: leave it out, or run irace itself"
_ONE_RUNNER = "use targetRunner, a program, and parallel, the number of programs that run at the same time"

Kind = Literal["flag", "count", "part", "share", "text", "path", "object"]


class Option(NamedTuple):
    kind: Kind
    default: Setting = None
    refused: str = ""  # why only the default is supported, and what to do instead
    ignored: str = ""  # why it has no effect
    ours: str = ""  # the name in `RaceOptions`


OPTIONS: Mapping[str, Option] = {
    "scenarioFile": Option("path", "scenario.txt", refused="give the scenario's file to mdesign tune"),
    "execDir": Option("path", "."),
    "parameterFile": Option("path", "parameters.txt"),
    "parameters": Option("object", refused=f"{_IS_R}: write the parameters to a file, and name it as parameterFile"),
    "initConfigurations": Option("object", refused=f"{_IS_R}: write them to a file, and name it as configurationsFile"),
    "configurationsFile": Option("path"),
    "logFile": Option("path", "irace.Rdata", ignored="journal.jsonl, in the folder of the results, has all events"),
    "recoveryFile": Option("path", refused="resume a race with mdesign tune --resume DIRECTORY"),
    "instances": Option("object"),
    "trainInstancesDir": Option("path"),
    "trainInstancesFile": Option("path"),
    "sampleInstances": Option("flag", True, ours="sample_instances"),
    "testInstancesDir": Option("path"),
    "testInstancesFile": Option("path"),
    "testInstances": Option("object"),
    "testNbElites": Option("count", 1),
    "testIterationElites": Option("flag", False),
    "testType": Option("text", ""),
    "firstTest": Option("count", 5, ours="first_test"),
    "blockSize": Option("count", 1, ours="block_size"),
    "eachTest": Option("count", 1, ours="each_test"),
    "targetRunner": Option("path", "target-runner"),
    "targetRunnerLauncher": Option("path"),
    "targetCmdline": Option("text", CMDLINE),
    "targetRunnerRetries": Option("count", 0),
    "targetRunnerTimeout": Option("count", 0),
    "targetRunnerData": Option("object", refused=f"{_IS_R}: let targetRunner read a file"),
    "targetRunnerParallel": Option("object", refused=f"{_IS_R}: {_ONE_RUNNER}"),
    "targetEvaluator": Option("path"),
    "deterministic": Option("flag", False),
    "maxExperiments": Option("count", 0),
    "minExperiments": Option("count"),
    "maxTime": Option("count", 0, refused="a budget counts experiments: use maxExperiments"),
    "budgetEstimation": Option("part", 0.05, ignored="it is about maxTime"),
    "minMeasurableTime": Option("part", 0.01, ignored="it is about maxTime"),
    "parallel": Option("count", 0),
    "loadBalancing": Option("flag", True, ignored="an idle worker takes the next experiment"),
    "mpi": Option("flag", False, refused=_ONE_RUNNER),
    "batchmode": Option("text", "0", refused="let targetRunner wait for its job (as sbatch --wait does)"),
    "quiet": Option("flag", False, ignored="use mdesign tune --quiet"),
    "debugLevel": Option("count", 0, ignored="the journal has all events"),
    "seed": Option("count"),
    "softRestart": Option("flag", True, ours="soft_restart"),
    "softRestartThreshold": Option("part", 1e-4, ours="soft_restart_threshold"),
    "elitist": Option("flag", True, ours="elitist"),
    "elitistNewInstances": Option("count", 1, ours="elitist_new_instances"),
    "elitistLimit": Option("count", 2, ours="elitist_limit"),
    "repairConfiguration": Option("object", refused=f"{_IS_R}: use [forbidden] in parameterFile"),
    "iterationCallback": Option("object", refused=f"{_IS_R}: the journal can be read while the race runs"),
    "capping": Option("flag", False, refused=_NO_CAPPING),
    "cappingAfterFirstTest": Option("flag", False, refused=_NO_CAPPING),
    "cappingType": Option("text", "median", refused=_NO_CAPPING),
    "boundType": Option("text", "candidate", refused=_NO_CAPPING),
    "boundMax": Option("count", 0, refused=_NO_CAPPING),
    "boundDigits": Option("count", 0, refused=_NO_CAPPING),
    "boundPar": Option("count", 1, refused=_NO_CAPPING),
    "boundAsTimeout": Option("flag", True, refused=_NO_CAPPING),
    "postselection": Option("share", True, ours="postselection"),
    "aclib": Option("flag", False, refused="let targetRunner be a program that prints the cost alone"),
    "nbIterations": Option("count", 0, ours="iterations"),
    "nbExperimentsPerIteration": Option("count", 0, ours="experiments_per_iteration"),
    "minNbSurvival": Option("count", 0, ours="survivors"),
    "nbConfigurations": Option("count", 0, ours="n_configurations"),
    "mu": Option("count", 5, ours="mu"),
    "confidence": Option("part", 0.95, ours="confidence"),
}
_BEFORE_IRACE_4 = {
    "digits": "since irace 4 it is in parameterFile: [global], and below it digits = N",
    "forbiddenFile": "since irace 4 they are in parameterFile, below [forbidden]",
    "forbiddenExps": "since irace 4 they are in parameterFile, below [forbidden]",
    "dependencyFile": "a bound in parameterFile may depend on other parameters",
}
TESTS: Mapping[str, str] = {
    "": "friedman",
    "f-test": "friedman",
    "t.none": "t-test",
    "t.holm": "t-test-holm",
    "t.bonferroni": "t-test-bonferroni",
}
"""irace's names of the tests, with ours."""
EXPECTED: Mapping[Kind, str] = {
    "flag": "0 or 1",
    "count": f"a whole number, 0 to {MAX_INTEGER}",
    "part": "a number from 0 to 1",
    "share": "0, 1 or a share of the budget",
    "text": "text in quotes",
    "path": "a path in quotes",
    "object": "texts, as c(...)",
}


def in_names_of_irace(error: RaceError) -> str:
    """The message of an error on an option of the race, with irace's names of options."""
    message = str(error)
    if not message.startswith("race option "):
        return message
    names = {option.ours: name for name, option in OPTIONS.items() if option.ours}
    names |= {"test": "testType", "instances": "deterministic"}
    name, _, rest = message.removeprefix("race option ").partition(":")
    return f"{names.get(name, name)}:" + re.sub(r"\w+_\w+", lambda word: names.get(word[0], word[0]), rest)


def of_races(settings: Mapping[str, Setting]) -> list[str]:
    """The settings that have no effect on a method that is not an iterated race."""
    of_races = {name for name, option in OPTIONS.items() if option.ours} | {"testType", "deterministic"}
    return [name for name in settings if name in of_races - {"sampleInstances"}]


def unknown(name: str) -> str:
    """The message on an unknown option."""
    if name in _BEFORE_IRACE_4:
        return f"{name} is no option of irace 4: {_BEFORE_IRACE_4[name]}"
    lower = {option.lower(): option for option in OPTIONS}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    hint = f"; did you mean {lower[close[0]]}?" if close else "; begin the name of your own variable with a dot"
    return f"expected an option of irace, found {excerpt(name)}{hint}"
