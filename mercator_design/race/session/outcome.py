"""The outcome of an experiment: a score or a failure, and whether the race continues after it."""

from typing import Literal

from mercator_design.errors import MercatorError, RaceError, lack_of_memory
from mercator_design.race.executors.executor import Failed, Rejected
from mercator_design.race.session.events import ExperimentDone, Measurement, TestDone
from mercator_design.scores import EXPECTED, is_score

OnFailure = Literal["stop", "reject"]


class ExperimentFailed(RaceError):  # noqa: N818 - as TimeoutExpired, it says what happened
    """An experiment failed, and failures stop the race."""

    def __init__(self, finished: ExperimentDone | TestDone, result: Measurement | Failed) -> None:
        what = f"experiment {finished.experiment}" if isinstance(finished, ExperimentDone) else "a test"
        super().__init__(
            f"{what} (configuration {finished.configuration}, instance of seed {finished.seed}) failed: "
            f"{finished.failure}"
        )
        self.finished = finished
        if isinstance(result, Failed) and isinstance(result.error, MercatorError):
            self.exit_code = result.error.exit_code


def is_fatal(result: Measurement | Failed, on_failure: OnFailure) -> bool:
    """Whether a race stops at the result of an experiment.

    A lack of memory is not the fault of a configuration: it always stops the race, which can then be resumed.
    """
    if not read_result(result)[2]:
        return False
    error = result.error if isinstance(result, Failed) else None
    return (on_failure == "stop" and not isinstance(error, Rejected)) or lack_of_memory(error) is not None


def read_result(result: Measurement | Failed) -> tuple[float | None, str, str]:
    """Score, digest and failure of a result; a score that is not a number is a failure."""
    if isinstance(result, Failed):
        return None, "", result.reason
    if not is_score(result.score):
        return None, "", f"{EXPECTED}, found {result.score}"
    return result.score, result.outcome, ""
