"""The scores of control software on instances."""

from dataclasses import dataclass

from mercator_design.race.elimination.summary import Scores


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Scores of a PFSM, and the seeds of the instances."""

    scores: Scores
    seeds: tuple[int, ...]

    def __repr__(self) -> str:
        return f"<Evaluation: {self.scores.summary}>"
