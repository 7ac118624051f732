import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mercator_design.race.executors.executor import Rejected, attempt
from mercator_design.race.irace.target_runner import RunnerCall, Target, TargetFailed
from tests.processes import LIMIT, wait_until

CALL = RunnerCall(configuration=7, instance_id="2", seed=42, instance="a.tsp --opt 'x y'", arguments="--a 1 --b=two")


@pytest.fixture
def program(tmp_path):
    """Writes a shell program."""

    def write(text, name="runner"):
        file = tmp_path / name
        file.write_text(f"#!/bin/sh\n{text}\n")
        file.chmod(0o755)
        return file

    return write


def waiting_for(file):
    return wait_until(lambda: file.exists() and file.read_text())


def test_what_a_runner_is_called_with(tmp_path, program):
    runner = program("pwd > where; for word; do echo \"$word\"; done > words; echo 3.5 '#no'\n", "r")
    target = Target(runner=program('pwd > where; for word; do echo "$word"; done > words; echo 3.5'), folder=tmp_path)
    assert target(CALL).score == 3.5
    assert (tmp_path / "where").read_text().strip() == str(tmp_path)
    words = ["7", "2", "42", "a.tsp", "--opt", "x y", "--a", "1", "--b=two"]
    assert (tmp_path / "words").read_text().splitlines() == words
    assert Target(runner=runner, folder=tmp_path).command(CALL) == [str(runner), *words]


@pytest.mark.parametrize(
    ("cmdline", "expected"),
    [
        ("{instance} {seed} {targetRunnerArgs}", "L R a.tsp --opt 'x y' 42 --a 1 --b=two"),
        ("-x {targetRunner} --seed={seed} {instanceID} {instance} {targetRunnerArgs}{bound}",
         "L -x R --seed=42 2 a.tsp --opt 'x y' --a 1 --b=two"),
    ],
)  # fmt: skip
def test_a_launcher_runs_the_runner(cmdline, expected):
    target = Target(runner=Path("R"), launcher=Path("L"), cmdline=cmdline, folder=Path())
    assert target.command(CALL) == shlex.split(expected)


def test_braces_of_an_instance_are_not_a_template():
    call = replace(CALL, instance="a{bound}{targetRunnerArgs}.txt")
    target = Target(runner=Path("R"), cmdline="{instance} {unknown} {seed}", folder=Path())
    assert target.command(call) == ["R", "a{bound}{targetRunnerArgs}.txt", "{unknown}", "42"]


@pytest.mark.parametrize(
    ("text", "cost"),
    [
        ("echo 1", 1.0),
        ("echo; echo ' -1e3  0.5 '", -1000.0),
        ("echo a warning >&2; echo 2", 2.0),
        ("echo 0x1A", 26.0),
        ("echo -0x1.8p1 1", -3.0),
    ],
)
def test_what_is_a_cost(tmp_path, program, text, cost):
    assert Target(runner=program(text), folder=tmp_path)(CALL).score == cost


@pytest.mark.parametrize("cost", ["Inf", "-Inf", "inf"])
def test_an_infinite_cost_rejects(tmp_path, program, cost):
    with pytest.raises(Rejected, match="configuration 7"):
        Target(runner=program(f"echo {cost}"), folder=tmp_path)(CALL)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("true", "expected a cost, or a cost and a time; it printed ''"),
        ("echo 1 2 3", "expected a cost, or a cost and a time; it printed '1 2 3'"),
        ("echo best is 3", "expected numbers; it printed 'best is 3'"),
        ("echo NaN", "expected a number as the cost; it printed 'NaN'"),
        ("echo 1_000", "expected numbers; it printed '1_000'"),
        ("echo oh; echo no >&2; exit 3", r"expected exit status 0, found exit status 3; it printed 'oh\\nno'"),
        ("kill -SEGV $$", "found SIGSEGV"),
    ],
)
def test_what_is_none(tmp_path, program, text, message):
    with pytest.raises(TargetFailed, match=message) as error:
        Target(runner=program(text), folder=tmp_path)(CALL)
    assert f"the command was: {tmp_path / 'runner'} 7 2 42 a.tsp --opt 'x y' --a 1 --b=two" in str(error.value)


def test_a_command_is_shown_to_its_end(tmp_path, program):
    runner = program("head -c 5000 /dev/zero; exit 1")
    target = Target(runner=runner, folder=tmp_path)
    failed = attempt(target, CALL)
    assert failed.reason.endswith(shlex.join(target.command(CALL)))
    assert len(failed.reason) < 1000


def test_a_program_that_cannot_be_run(tmp_path):
    (tmp_path / "runner").write_text("#!/nowhere/sh\n")
    (tmp_path / "runner").chmod(0o755)
    with pytest.raises(TargetFailed, match=r"cannot be run: .*runner: No such file"):
        Target(runner=tmp_path / "runner", folder=tmp_path)(CALL)


def test_quotes_that_are_not_closed(tmp_path, program):
    call = RunnerCall(configuration=1, instance_id="1", seed=1, instance="it's", arguments="")
    with pytest.raises(TargetFailed, match="quotes are closed"):
        Target(runner=program("echo 1"), folder=tmp_path)(call)


def test_it_is_tried_again(tmp_path, program):
    runner = program("echo x >> tries; [ $(wc -l < tries) -ge 3 ] && echo 4")
    assert Target(runner=runner, folder=tmp_path, retries=2)(CALL).score == 4
    (tmp_path / "tries").unlink()
    with pytest.raises(TargetFailed):
        Target(runner=runner, folder=tmp_path, retries=1)(CALL)


def test_the_evaluator_gives_the_cost(tmp_path, program):
    evaluator = program('echo "$@" > asked; cat result', "evaluator")
    target = Target(runner=program("echo 5 > result"), evaluator=evaluator, folder=tmp_path)
    assert target(CALL).score == 0
    assert not (tmp_path / "asked").exists()
    assert target.evaluate(CALL, [3, 7]).score == 5
    assert (tmp_path / "asked").read_text() == "7 2 42 a.tsp --opt x y 2 3 7\n"
    with pytest.raises(TargetFailed, match="expected nothing or a time"):
        Target(runner=program("echo 1 2"), evaluator=evaluator, folder=tmp_path)(CALL)
    (tmp_path / "result").write_text("Inf")
    with pytest.raises(Rejected, match="the target evaluator rejects it"):
        target.evaluate(CALL, [7])


def is_running(process):
    state = subprocess.run(
        ["/bin/ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True, check=False
    ).stdout
    return bool(state.strip()) and not state.startswith("Z")


def gone(process):
    return wait_until(lambda: not is_running(process))


SLOW = "sleep 6000 & echo $! > child; wait"


def test_too_long_ends_the_whole_group(tmp_path, program):
    started = time.monotonic()
    with pytest.raises(TargetFailed, match=r"took longer than 1 s"):
        Target(runner=program(SLOW), folder=tmp_path, timeout=1)(CALL)
    assert time.monotonic() - started < LIMIT
    assert gone(int((tmp_path / "child").read_text()))


def stopped(target, child):
    """What a run says that is stopped when its child is there, and the child."""
    failures = []

    def run():
        with pytest.raises(TargetFailed) as error:
            target(CALL)
        failures.append(str(error.value))

    thread = threading.Thread(target=run)
    thread.start()
    process = int(waiting_for(child))
    target.stop.set()
    thread.join(timeout=LIMIT)
    return failures, process


def test_stopped_ends_the_whole_group(tmp_path, program):
    failures, child = stopped(Target(runner=program(SLOW), folder=tmp_path, retries=5), tmp_path / "child")
    assert failures == ["was stopped"]
    assert gone(child)


def test_what_it_leaves_behind_ends_with_it(tmp_path, program):
    started = time.monotonic()
    runner = program("sleep 6000 & echo $! > child; echo 3")
    assert Target(runner=runner, folder=tmp_path)(CALL).score == 3
    assert time.monotonic() - started < LIMIT
    assert gone(int((tmp_path / "child").read_text()))


def test_what_is_left_of_it_may_leave_the_group(tmp_path, program):
    leave = "import os, time; os.setsid(); print(os.getpid(), file=open('child', 'w'), flush=True); time.sleep(600)"
    runner = program(f'{sys.executable} -c "{leave}" & until [ -s child ]; do sleep 0.05; done; echo 3')
    score = Target(runner=runner, folder=tmp_path)(CALL).score
    os.kill(int((tmp_path / "child").read_text()), signal.SIGKILL)
    assert score == 3


def test_what_left_the_group_is_not_waited_for(tmp_path, program):
    leave = "import os, time; os.setsid(); print(os.getpid(), file=open('child', 'w'), flush=True); time.sleep(600)"
    runner = program(f'{sys.executable} -c "{leave}" & sleep 600')
    failures, child = stopped(Target(runner=runner, folder=tmp_path), tmp_path / "child")
    os.kill(child, signal.SIGKILL)
    assert failures == ["was stopped"]
