"""A race that a process of ours runs: why it is stopped, and what its end means for its job."""

import errno
import logging
import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

from mercator_design.errors import RaceError
from mercator_design.serve.jobs.job import Job
from mercator_design.serve.jobs.processes import RaceProcess, last_error
from mercator_design.serve.jobs.races import RaceStatus

_log = logging.getLogger(__name__)

NO_SPACE = "waits until there is space on the disk"
"""What a job waits for that found the disk full."""
_MIN_EXPERIMENTS = 10
"""Experiments by whose pace the remaining time is estimated: before them, a race compiles."""
_MAX_DEATHS = 3
"""Deaths of a job's process without progress after which the job fails."""
_INTERRUPTED = (75, 130)
"""Exit codes of a race that can be resumed."""
_FULL = tuple(map(os.strerror, (errno.ENOSPC, errno.EDQUOT)))

Why: TypeAlias = Literal["", "wish", "disk", "time", "service"]


@dataclass(slots=True)
class Running:
    """A race that a process of ours runs."""

    job: Job
    process: RaceProcess
    status: RaceStatus
    output: Path  # of its messages
    unsaved_since: float  # its time from then on is not yet in the job's file
    budget: int  # with which it was started; the job's may have been extended since
    n_before: int  # experiments
    read_at: float = -math.inf  # when its journal was looked at
    first_progress: tuple[float, int] | None = None  # when it was seen, and the experiments then
    stopped_for: Why = ""
    stopped_at: float = 0.0

    def stop(self, why: Why, clock: float) -> None:
        """Ask it to stop, unless it was asked before."""
        if not self.stopped_for:
            self.stopped_for, self.stopped_at = why, clock
            self.process.terminate()

    def seconds(self, clock: float) -> float:
        """That the job's races have run, with this one."""
        return round(self.job.seconds + clock - self.unsaved_since, 1)

    def job_at(self, clock: float) -> Job:
        """The job, with the seconds until now."""
        return replace(self.job, seconds=self.seconds(clock))

    def left(self, clock: float) -> float | None:
        """Seconds that the race still takes, by its pace since its first experiment here; None if not known yet."""
        done = self.status.view.n_experiments
        if self.first_progress is None and done > self.n_before:
            self.first_progress = (clock, done)
        since, n_then = self.first_progress or (clock, done)
        if done - n_then < _MIN_EXPERIMENTS or clock == since:
            return None
        return max(0, self.budget - done) * (clock - since) / (done - n_then)

    @property
    def message(self) -> str:
        """What it is about to do."""
        wish = "go on" if self.job.wish == "run" else self.job.wish
        stops = {"wish": f"stopping, to {wish}", "disk": "stopping: the disk is nearly full"}
        return stops.get(self.stopped_for, "")

    def read_on(self) -> None:
        """Read what is new in its journal; the race itself reports what is wrong there."""
        try:
            self.status.read_on()
        except RaceError as error:
            _log.warning("%s", error)

    def wait(self, code: int, shortage: str) -> str:
        """What its job waits for, when the process has ended before the race; empty if it does not wait."""
        if self.stopped_for == "disk":
            return shortage or NO_SPACE
        if not self.stopped_for and code > 0 and any(one in last_error(self.output) for one in _FULL):
            return NO_SPACE
        return ""

    def is_interrupted(self, code: int) -> bool:
        """Whether the process has ended with something left to do, with this exit code: the race, or its report."""
        return code != 0 and (bool(self.stopped_for) or code < 0 or code in _INTERRUPTED)

    def failure(self, code: int, deaths: int, hours: float) -> str:
        """Why its job fails, when the process has ended before the race; empty if it goes on.

        Args:
            code: The exit code; negative: the signal that has killed it.
            deaths: Of processes of the job without progress.
            hours: That a job may run.
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
