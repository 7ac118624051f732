"""irace's target runner: a program that runs one experiment and prints its cost.

It is run without a shell, in the folder of the experiments (execDir) and in its own process group. If it takes too long
or is interrupted, the whole group is killed.
"""

import contextlib
import errno
import math
import os
import re
import shlex
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mercator_design.errors import RaceError
from mercator_design.race.executors.executor import Rejected
from mercator_design.race.session.events import Measurement
from mercator_design.race.space.r_operators import number

CMDLINE = "{configurationID} {instanceID} {seed} {instance} {bound} {targetRunnerArgs}"
"""irace's default of targetCmdline."""
REQUIRED = ("seed", "instance", "targetRunnerArgs")
_CHECK_EVERY = 0.1
"""Seconds between two checks whether to stop."""
_GRACE = 1.0
"""Seconds in which processes that a program has started may print after its end."""
_MAX_SHOWN = 300
"""Characters of a program's output in a message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunnerCall:
    """The arguments of a run of the target runner."""

    configuration: int
    instance_id: str
    seed: int
    instance: str
    arguments: str  # switches and values, joined by blanks


class TargetFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """A target runner failed; the message has its output and its command."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A target runner, and how it is called.

    runner: The program.
    launcher: A program that runs the target runner, if that is not executable.
    cmdline: The template of the arguments, irace's targetCmdline.
    evaluator: A program that prints the cost of a configuration, after the runner has run for all alive configurations.
    folder: The folder in which it runs.
    timeout: Time limit of a run [s]; 0: none.
    retries: How often a failed run is tried again.
    stop: Set to end all running programs.
    started: The configurations with which the runner was started.
    """

    runner: Path
    launcher: Path | None = None
    cmdline: str = CMDLINE
    evaluator: Path | None = None
    folder: Path
    timeout: float = 0.0
    retries: int = 0
    stop: threading.Event = field(default_factory=threading.Event, compare=False)
    started: list[int] = field(default_factory=list, compare=False)

    def command(self, call: RunnerCall) -> list[str]:
        """The program and its arguments.

        Raises:
            TargetFailed: A quote of a value or an instance is not closed.
        """
        words = {
            "configurationID": str(call.configuration),
            "instanceID": call.instance_id,
            "seed": str(call.seed),
            "instance": call.instance,
            "bound": "",
            "targetRunnerArgs": call.arguments,
            "targetRunner": shlex.quote(str(self.runner)),
        }
        line = self.cmdline
        if self.launcher is not None and "{targetRunner}" not in line:
            line = f"{{targetRunner}} {line}"
        line = re.sub(r"\{(\w+)\}", lambda found: words.get(found[1], found[0]), line)  # not in what is put in
        return [str(self.launcher or self.runner), *_split(line)]

    def evaluation(self, call: RunnerCall, alive: Sequence[int]) -> list[str]:
        """The evaluator and its arguments; `alive` has the configurations that have run on the instance."""
        words = [str(call.configuration), call.instance_id, str(call.seed), *_split(call.instance)]
        return [str(self.evaluator), *words, str(len(alive)), *map(str, alive)]

    def evaluate(self, call: RunnerCall, alive: Sequence[int]) -> Measurement:
        """The cost of an experiment that has run; the evaluator may compare it with others.

        Raises:
            Rejected: As `__call__`.
            TargetFailed: The evaluator failed or printed no cost.
        """
        command = self.evaluation(call, alive)
        return _accepted(call, _cost(*self._numbers(command), command), "target evaluator")

    def __call__(self, call: RunnerCall) -> Measurement:
        """The cost of an experiment; if there is an evaluator, the experiment only runs, and the cost is 0.

        Raises:
            Rejected: The cost is infinite: the target runner rejects the configuration.
            TargetFailed: The target runner failed or printed no cost.
        """
        for left in range(self.retries, -1, -1):
            try:
                cost = self._run(call)
            except TargetFailed:
                if not left or self.stop.is_set():
                    raise
            else:
                break
        return _accepted(call, cost, "target runner")

    def _run(self, call: RunnerCall) -> float:
        command = self.command(call)
        self.started.append(call.configuration)
        numbers, printed = self._numbers(command)
        if self.evaluator is None:
            return _cost(numbers, printed, command)
        if len(numbers) > 1:
            raise _failed("expected nothing or a time, as a targetEvaluator gives the cost", printed, command)
        return 0.0

    def _numbers(self, command: list[str]) -> tuple[list[float], str]:
        """The output of a program, as numbers and as text."""
        printed = self._output(command)
        try:
            return [float(number(word)) for word in printed.split()], printed
        except ValueError:
            raise _failed("expected numbers", printed, command) from None

    def _output(self, command: list[str]) -> str:
        """The output of a program on stdout."""
        try:
            process = subprocess.Popen(  # noqa: S603 - the user's program, without a shell
                command,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            if error.errno in {errno.ENOMEM, errno.EAGAIN}:  # not the fault of the target runner
                raise MemoryError(f"{command[0]}: {error.strerror}") from None
            why = f"{error.filename or command[0]}: {error.strerror}"
            raise TargetFailed(f"cannot be run: {why}; the command was: {shlex.join(command)}") from None
        deadline = time.monotonic() + self.timeout if self.timeout else math.inf
        with process:
            try:
                out, err = self._wait(process, deadline)
            except BaseException:
                _kill(process)
                raise
        if self.stop.is_set() and process.returncode:
            raise TargetFailed("was stopped")
        if process.returncode < 0 and time.monotonic() >= deadline:
            raise _failed(f"took longer than {self.timeout:g} s", out + err, command)
        if process.returncode:
            ended = f"exit status {process.returncode}" if process.returncode > 0 else _signal(-process.returncode)
            raise _failed(f"expected exit status 0, found {ended}", out + err, command)
        return out

    def _wait(self, process: "subprocess.Popen[str]", deadline: float) -> tuple[str, str]:
        """The output of a program and its child processes on stdout and stderr, until all end or are killed."""
        killed = ended = False
        while True:
            try:
                return process.communicate(timeout=_CHECK_EVERY)
            except subprocess.TimeoutExpired as late:
                if not ended and process.poll() is not None:
                    ended, deadline = True, min(deadline, time.monotonic() + _GRACE)
                if killed and ended:  # a process that has left the group may keep the pipes open
                    return _decoded(late.output), _decoded(late.stderr)
                if self.stop.is_set() or time.monotonic() >= deadline:
                    _kill(process)
                    killed = True


def _cost(numbers: list[float], printed: str, command: list[str]) -> float:
    if not 1 <= len(numbers) <= 2:
        raise _failed("expected a cost, or a cost and a time", printed, command)
    if math.isnan(numbers[0]):
        raise _failed("expected a number as the cost", printed, command)
    return numbers[0]


def _accepted(call: RunnerCall, cost: float, who: str) -> Measurement:
    if math.isinf(cost):
        raise Rejected(f"configuration {call.configuration}: the {who} rejects it by a cost of {cost}")
    return Measurement(cost, "")


def _decoded(printed: bytes | None) -> str:
    """The output so far, which subprocess gives as bytes."""
    return (printed or b"").decode(errors="replace")


def _kill(process: "subprocess.Popen[str]") -> None:
    """Kill a program and its child processes, if it has not ended."""
    with contextlib.suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)


def _split(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError as error:
        raise TargetFailed(f"expected arguments whose quotes are closed, found {line!r}: {error}") from None


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _failed(what: str, printed: str, command: list[str]) -> TargetFailed:
    shown = repr(printed.strip()[-_MAX_SHOWN:])
    if len(shown) > _MAX_SHOWN:
        shown = f"'... {shown[-_MAX_SHOWN:]}"
    return TargetFailed(f"{what}; it printed {shown}; the command was: {shlex.join(command)}")
