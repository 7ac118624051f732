"""What came of an experiment: a score, or a failure, and whether a race goes on after it."""

from typing import Literal

from mercator_design.errors import MercatorError, RaceError, lack_of_memory
from mercator_design.race.running.events import ExperimentDone, Measurement, TestDone
from mercator_design.race.running.executors import Failed, Rejected
from mercator_design.scores import EXPECTED, is_score

OnFailure = Literal["stop", "reject"]


class ExperimentFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """An experiment failed, and no failure is accepted."""

    def __init__(self, finished: ExperimentDone | TestDone, error: Exception | None) -> None:
        what = f"experiment {finished.experiment}" if isinstance(finished, ExperimentDone) else "a test"
        super().__init__(
            f"{what} (configuration {finished.configuration}, instance of seed {finished.seed}) failed: "
            f"{finished.failure}"
        )
        self.finished = finished
        if isinstance(error, MercatorError):
            self.exit_code = error.exit_code


def is_fatal(result: Measurement | Failed, on_failure: OnFailure) -> bool:
    """Whether a race stops at what came of an experiment.

    That there was no memory says nothing of a configuration: it stops every race, which can then be resumed.
    """
    if not read_result(result)[2]:
        return False
    error = error_of(result)
    return (on_failure == "stop" and not isinstance(error, Rejected)) or lack_of_memory(error) is not None


def error_of(result: Measurement | Failed) -> Exception | None:
    """What it raised, if it did."""
    return result.error if isinstance(result, Failed) else None


def read_result(result: Measurement | Failed) -> tuple[float | None, str, str]:
    """Score, digest and failure; what is no score is a failure."""
    if isinstance(result, Failed):
        return None, "", result.reason
    if not is_score(result.score):
        return None, "", f"{EXPECTED}, found {result.score}"
    return result.score, result.outcome, ""
