"""A race or study in a process of this service: the reason of its stop, and the consequences of its end for the job."""

import errno
import logging
import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

from mercator_design.errors import RaceError, StudyError
from mercator_design.serve.jobs.job import Job
from mercator_design.serve.jobs.processes import RaceProcess, last_error
from mercator_design.serve.jobs.work import WorkStatus

_log = logging.getLogger(__name__)

NO_SPACE = "waits until there is space on the disk"
"""Message of a job that found the disk full."""
_MIN_EXPERIMENTS = 10
"""Minimum number of experiments for an estimate of the remaining time."""
_MAX_DEATHS = 3
"""Maximum number of deaths of a job's process without progress."""
_INTERRUPTED = (75, 130)
"""Exit codes of a race that can be resumed."""
_FULL = tuple(map(os.strerror, (errno.ENOSPC, errno.EDQUOT)))

StopReason: TypeAlias = Literal["", "wish", "disk", "time", "service"]


@dataclass(slots=True)
class RunningRace:
    """A race or study in a process of this service."""

    job: Job
    process: RaceProcess
    status: WorkStatus
    output: Path  # of its messages
    unsaved_since: float  # its time from then on is not yet in the job's file
    budget: int  # with which it was started; the job's may have been extended since
    n_before: int  # experiments
    read_at: float = -math.inf  # when its journal was looked at
    first_progress: tuple[float, int] | None = None  # when it was seen, and the experiments then
    stopped_for: StopReason = ""
    stopped_at: float = 0.0

    def stop(self, why: StopReason, clock: float) -> None:
        """Terminate the process, unless that was done before."""
        if not self.stopped_for:
            self.stopped_for, self.stopped_at = why, clock
            self.process.terminate()

    def seconds(self, clock: float) -> float:
        """Total run time of the job's races [s]."""
        return round(self.job.seconds + clock - self.unsaved_since, 1)

    def job_at(self, clock: float) -> Job:
        """The job, with the seconds until now."""
        return replace(self.job, seconds=self.seconds(clock))

    def left(self, clock: float) -> float | None:
        """Estimated remaining time [s], from the pace since the first experiment here; None if unknown."""
        done = self.status.n_experiments
        if self.first_progress is None and done > self.n_before:
            self.first_progress = (clock, done)
        since, n_then = self.first_progress or (clock, done)
        if done - n_then < _MIN_EXPERIMENTS or clock == since:
            return None
        return max(0, self.budget - done) * (clock - since) / (done - n_then)

    @property
    def message(self) -> str:
        """Message on its next state; empty if there is none."""
        wish = "go on" if self.job.wish == "run" else self.job.wish
        stops = {"wish": f"stopping, to {wish}", "disk": "stopping: the disk is nearly full"}
        return stops.get(self.stopped_for, "")

    def read_on(self) -> None:
        """Read what is new in its folder. The process itself reports damage."""
        try:
            self.status.read_on()
        except (RaceError, StudyError) as error:
            _log.warning("%s", error)

    def reason_to_wait(self, code: int, shortage: str) -> str:
        """Reason for which the job waits after the end of its process; empty if it does not wait."""
        if self.stopped_for == "disk":
            return shortage or NO_SPACE
        if not self.stopped_for and code > 0 and any(one in last_error(self.output) for one in _FULL):
            return NO_SPACE
        return ""

    def is_interrupted(self, code: int) -> bool:
        """Whether the process ended, with this exit code, before the race and its report were complete."""
        return code != 0 and (bool(self.stopped_for) or code < 0 or code in _INTERRUPTED)

    def failure(self, code: int, deaths: int, hours: float) -> str:
        """Reason for which the job fails after the end of its process; empty if it goes on.

        Args:
            code: The exit code; negative: the signal that has killed it.
            deaths: Number of deaths of the job's processes without progress.
            hours: Time limit of a job [h].
        """
        if self.stopped_for == "time":
            return f"it has run for {hours:g} h, the limit of this service; resume it to go on"
        if self.stopped_for or code in _INTERRUPTED:
            return ""
        if code < 0:
            return f"its process was killed {deaths} times, by signal {-code}" if deaths >= _MAX_DEATHS else ""
        if code == 0 and self.budget < self.job.request.budget and self.status.is_finished(self.budget):
            return ""  # the budget was extended while it ran
        return last_error(self.output) or f"its process ended with code {code}"
