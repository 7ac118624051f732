"""irace's target runner: a program that runs one experiment, and prints what it cost.

It is run without a shell, in the folder of the experiments (execDir), and as a process group of its own, which ends
with it if it takes too long or is interrupted.
"""

import contextlib
import errno
import math
import os
import shlex
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mercator_design.errors import RaceError
from mercator_design.race.running.events import Measurement
from mercator_design.race.running.executors import Rejected
from mercator_design.race.space.r_operators import number

CMDLINE = "{configurationID} {instanceID} {seed} {instance} {bound} {targetRunnerArgs}"
"""irace's targetCmdline unless told otherwise."""
REQUIRED = ("seed", "instance", "targetRunnerArgs")
_GLANCE = 0.1
"""Seconds from one look at whether to stop to the next."""
_GRACE = 1.0
"""Seconds that what a program leaves behind may go on to print."""
_MAX_SHOWN = 300
"""Characters of a program's output in a message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """What a target runner is called with."""

    configuration: int
    instance_id: str
    seed: int
    instance: str
    arguments: str  # switches and values, joined by blanks


class Count:
    """Of what several threads do."""

    def __init__(self) -> None:
        self.count = 0
        self._lock = threading.Lock()

    def add(self) -> None:
        with self._lock:
            self.count += 1


class TargetFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """A target runner did not do what it should; what it printed, and how to call it again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A target runner, and how it is called.

    runner: the program.
    launcher: a program that runs it, for one that cannot be executed.
    cmdline: of the arguments, irace's targetCmdline.
    evaluator: a program that prints the cost of a configuration, after the runner has run for all that are alive.
    folder: that it runs in.
    timeout: seconds after which a run has failed; 0 for none.
    retries: how often a run that failed is tried again.
    stop: set to end all runs that are under way.
    made: how often the runner was started.
    """

    runner: Path
    launcher: Path | None = None
    cmdline: str = CMDLINE
    evaluator: Path | None = None
    folder: Path
    timeout: float = 0.0
    retries: int = 0
    stop: threading.Event = field(default_factory=threading.Event, compare=False)
    made: Count = field(default_factory=Count, compare=False)

    def command(self, call: Call) -> list[str]:
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
        for name, word in words.items():
            line = line.replace(f"{{{name}}}", word)
        return [str(self.launcher or self.runner), *_split(line)]

    def evaluation(self, call: Call, alive: Sequence[int]) -> list[str]:
        """The evaluator and its arguments; alive are the configurations that have run on the instance."""
        words = [str(call.configuration), call.instance_id, str(call.seed), *_split(call.instance)]
        return [str(self.evaluator), *words, str(len(alive)), *map(str, alive)]

    def evaluate(self, call: Call, alive: Sequence[int]) -> Measurement:
        """The cost of an experiment that has run, by the evaluator, which may compare it with others.

        Raises:
            Rejected: As `__call__`.
            TargetFailed: There is none.
        """
        command = self.evaluation(call, alive)
        return _accepted(call, _cost(*self._numbers(command), command), "target evaluator")

    def __call__(self, call: Call) -> Measurement:
        """The cost of an experiment; if there is an evaluator, the experiment only runs, and the cost is 0.

        Raises:
            Rejected: It is infinite, by which a target runner rejects a configuration.
            TargetFailed: There is none.
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

    def _run(self, call: Call) -> float:
        command = self.command(call)
        self.made.add()
        numbers, printed = self._numbers(command)
        if self.evaluator is None:
            return _cost(numbers, printed, command)
        if len(numbers) > 1:
            raise _failed("expected nothing or a time, as a targetEvaluator gives the cost", printed, command)
        return 0.0

    def _numbers(self, command: list[str]) -> tuple[list[float], str]:
        """What a program prints, as numbers and as it is."""
        printed = self._output(command)
        try:
            return [float(number(word)) for word in printed.split()], printed
        except ValueError:
            raise _failed("expected numbers", printed, command) from None

    def _output(self, command: list[str]) -> str:
        """What a program prints on stdout."""
        try:
            process = subprocess.Popen(  # noqa: S603 - what the user asks for, and no shell
                command,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            if error.errno in {errno.ENOMEM, errno.EAGAIN}:  # that no process could be made is not its fault
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
        """What a program prints on stdout and stderr until it ends, or is ended, and all that it has started."""
        killed = ended = False
        while True:
            try:
                return process.communicate(timeout=_GLANCE)
            except subprocess.TimeoutExpired as late:
                if not ended and process.poll() is not None:
                    ended, deadline = True, min(deadline, time.monotonic() + _GRACE)
                if killed and ended:  # what has left its group may hold them open for ever
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


def _accepted(call: Call, cost: float, who: str) -> Measurement:
    if math.isinf(cost):
        raise Rejected(f"configuration {call.configuration}: the {who} rejects it by a cost of {cost}")
    return Measurement(cost, "")


def _decoded(printed: bytes | None) -> str:
    """What was printed so far, which subprocess gives as bytes."""
    return (printed or b"").decode(errors="replace")


def _kill(process: "subprocess.Popen[str]") -> None:
    """End a program and all that it has started, if it has not ended."""
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
