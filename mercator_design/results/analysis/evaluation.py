"""The scores of control software on instances."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

from mercator_design.designer import Experimenter
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Scored
from mercator_design.modules.architecture import Software
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.events import Measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM, and the seeds of the instances.

    by_objective: By the name of each objective, if the mission has several; then `scores` are the weighted costs, or
        those by the first objective.
    """

    scores: Scores
    seeds: tuple[int, ...]
    by_objective: Mapping[str, Scores] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Evaluation: {self.summary}>"

    @property
    def summary(self) -> str:
        """Mean, confidence interval and number; of several objectives a part for each."""
        parts = [f"{name} {scores.summary}" for name, scores in self.by_objective.items()]
        return "; ".join(parts) or self.scores.summary

    @classmethod
    def of(cls, mission: Mission, found: Sequence[Scored], seeds: Sequence[int]) -> Self:
        """The evaluation of experiments of a mission."""
        scores = Scores(tuple(one.score for one in found), mission.possible_scores())
        several = mission.objective_names if mission.objectives else ()
        ranges = mission.possible_by_objective() if several else ()
        by_objective = {
            name: Scores(tuple(one.by_objective[k] for one in found), ranges[k]) for k, name in enumerate(several)
        }
        return cls(scores=scores, seeds=tuple(seeds), by_objective=by_objective)


class Experimenters:
    """Runs an experiment in one of several simulators; an item is its number, control software and seed."""

    def __init__(self, experimenters: Sequence[Experimenter]) -> None:
        self._experimenters = tuple(experimenters)

    def __call__(self, item: tuple[int, Software, int]) -> Measurement:
        """As an `Experimenter`."""
        number, software, seed = item
        return self._experimenters[number]((software, seed))

    def in_steps(self, item: tuple[int, Software, int]) -> Generator[None, None, Measurement]:
        """As an `Experimenter`."""
        number, software, seed = item
        return self._experimenters[number].in_steps((software, seed))
