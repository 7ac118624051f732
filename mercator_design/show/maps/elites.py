"""The maps of a race's elites on the same instances, as a table and as data for JSON."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mercator_design.errors import printable
from mercator_design.mapping.trial import MapTrial
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software
from mercator_design.race.analysis.pairs import compared
from mercator_design.scores import ScoreRange
from mercator_design.show.text.columns import aligned
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.architectures import text_of

_SHARE = ScoreRange(0.0, 1.0)
_FIGURES = ("score", "f1", "fine_f1", "coverage", "error", "yaw", "maps")


class MappedElites:
    """Trials of elites on the same instances.

    Attributes:
        best: The number of the elite whose maps have the best mean F1 in cells of 5 cm; of equal ones the first.
        p_values: Of the paired t-tests of F1 with the best, by the other's number, with Holm's correction; none of a
            single instance.
    """

    def __init__(
        self,
        software: Mapping[int, Software],
        trials: Mapping[int, Sequence[MapTrial]],
        seeds: Sequence[int],
        mission: Mission,
        robot_model: RobotModel,
    ) -> None:
        """Compare the trials of each elite, in the order of the seeds."""
        self.software, self.trials, self.seeds = software, trials, seeds
        self.mission, self.robot_model = mission, robot_model
        means = {number: self.mean(number, "f1") or 0.0 for number in trials}
        self.best = max(means, key=lambda number: means[number])
        scores = {number: dict(enumerate(one.f1 for one in of)) for number, of in trials.items()}
        pairs = [(self.best, number) for number in trials if number != self.best]
        self.p_values = {pair.second: pair.p_value for pair in compared(scores, pairs, _SHARE)}

    def mean(self, number: int, figure: str) -> float | None:
        """The mean of a figure over the instances that have it."""
        values = [value for one in self.trials[number] if (value := getattr(one, figure)) is not None]
        return float(np.mean(values)) if values else None

    def data(self, *, seed: int) -> dict[str, Any]:
        """All figures, for JSON."""
        return {
            "mission": self.mission.name,
            "robot_model": self.robot_model.name,
            "seed": seed,
            "seeds": list(self.seeds),
            "best": self.best,
            "elites": [
                {
                    "configuration": number,
                    "fsm": text_of(self.software[number]),
                    **{figure: self.mean(number, figure) for figure in _FIGURES},
                    "p_value": self.p_values.get(number),
                    "runs": [one._asdict() for one in of],
                }
                for number, of in self.trials.items()
            ],
        }

    def table(self, *, seed: int) -> str:
        """The figures of each elite, a line each."""
        head = ("elite", "score", "F1 5 cm", "F1 2.5 cm", "walls", "ATE [mm]", "yaw [deg]", "maps", "p")
        rows: list[Sequence[object]] = [head]
        for number in self.trials:
            score, f1, fine, walls, error, yaw, maps = (self.mean(number, figure) for figure in _FIGURES)
            p_value = "best map" if number == self.best else self.p_values.get(number)
            rows.append(
                (
                    *(number, f"{score:.5g}", f"{f1:.3f}{self._spread(number)}", f"{fine:.3f}"),
                    f"{100.0 * (walls or 0.0):.1f} %",
                    None if error is None else f"{1e3 * error:.1f}",
                    None if yaw is None else f"{math.degrees(yaw):.2f}",
                    f"{maps:.3g}",
                    f"{p_value:.2g}" if isinstance(p_value, float) else p_value,
                )
            )
        runs = len(self.seeds)
        instances = f"{runs} fresh instance{'s' * (runs != 1)} of master seed {seed}"
        about = f"{self.mission.name}, {self.robot_model.name}: maps of {instances}"
        return "\n".join([printable(about), *aligned(rows)])

    def _spread(self, number: int) -> str:
        """The standard deviation of F1 over instances."""
        values = [one.f1 for one in self.trials[number]]
        return f" ± {np.std(values, ddof=1):.3f}" if len(values) > 1 else ""
