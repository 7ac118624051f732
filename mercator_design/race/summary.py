"""What an iterated race tells of itself: its elites, where it stands, what each iteration did."""

from dataclasses import dataclass

from mercator_design.race.tests import Concordance


@dataclass(frozen=True, kw_only=True, slots=True)
class Elite:
    """A configuration that survived and what it cost on the instances it has seen."""

    configuration: int
    mean: float
    sd: float  # of the sample; NaN for a single result
    n_results: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Progress:
    """Where a race stands."""

    iteration: int  # from 1; the post-selection is one more than `iterations`
    iterations: int
    alive: int
    used: int
    budget: int
    best: Elite | None  # None before the first costs


@dataclass(frozen=True, kw_only=True, slots=True)
class IterationSummary:
    """What one iteration did, for reports."""

    iteration: int
    postselection: bool
    budget: int
    used: int
    n_configurations: int
    n_new: int
    n_instances: int  # raced on in this iteration
    n_alive: int
    elites: tuple[Elite, ...]  # best first
    soft_restart: bool
    stop_reason: str
    concordance: Concordance
    newcomers_differ: bool = True  # as far as its instances can tell
    stagnant: int = 0  # iterations up to this one without a gain (race/stagnation.py)
    note: str = ""  # what a user should know

    @property
    def best(self) -> int:
        """The number of its best configuration."""
        return self.elites[0].configuration
