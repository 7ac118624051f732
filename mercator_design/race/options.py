"""The options of an iterated race, with irace's defaults, and what is and is not allowed."""

from dataclasses import dataclass
from typing import get_args

from mercator_design.errors import RaceError
from mercator_design.race.race import RaceRules
from mercator_design.race.tests import TestName


@dataclass(frozen=True, kw_only=True, slots=True)
class RaceOptions:
    """irace's options of the same meaning, and what this race does that irace does not; `irace()` gives irace's.

    Args:
        surrogate: Part of the newcomers that a surrogate proposes; irace's sampling model draws the others.
        repeated: Whether a configuration that has run may be sampled again, as another one.
        test: What eliminates configurations: "friedman", "t-test", "t-test-holm" or "t-test-bonferroni"
            (testType).
        confidence: Of the test.
        first_test: Instances before the first test, a multiple of each_test.
        each_test: Instances between tests.
        mu: Instances to plan the number of configurations with; raised to first_test.
        elitist: Elites keep their results, and are protected until newcomers have caught up.
        elitist_new_instances: New instances that a later elitist race begins with, a multiple of each_test.
        elitist_limit: Tests without elimination that end an elitist race; 0 for no limit.
        iterations: How many to make instead of irace's number (nbIterations).
        survivors: How many configurations end a race instead of irace's number (minNbSurvival).
        soft_restart: Widen the elites' distributions when they have become too narrow to sample anything new.
        soft_restart_threshold: Part of a domain's width below which values are the same to a soft restart.
        postselection: Spend what is left of the budget on a race among the best of all iterations.

    Raises:
        RaceError: An option is out of its range.
    """

    surrogate: float = 0.8
    repeated: bool = False
    test: TestName = "friedman"
    confidence: float = 0.95
    first_test: int = 3
    each_test: int = 1
    mu: int = 5
    elitist: bool = True
    elitist_new_instances: int = 1
    elitist_limit: int = 2
    iterations: int | None = None
    survivors: int | None = None
    soft_restart: bool = True
    soft_restart_threshold: float = 1e-4
    postselection: bool = True

    def __post_init__(self) -> None:
        _require("surrogate", self.surrogate, "between 0 and 1", valid=0 <= self.surrogate <= 1)
        _require("test", self.test, " or ".join(get_args(TestName)), valid=self.test in get_args(TestName))
        _require("confidence", self.confidence, "between 0 and 1", valid=0 < self.confidence < 1)
        _require("each_test", self.each_test, "1 or more", valid=self.each_test >= 1)
        multiple = f"a multiple of each_test ({self.each_test})"
        even = self.first_test % self.each_test == 0
        _require("first_test", self.first_test, f"2 or more and {multiple}", valid=self.first_test >= 2 and even)
        _require("mu", self.mu, "1 or more", valid=self.mu >= 1)
        even = self.elitist_new_instances % self.each_test == 0
        valid = self.elitist_new_instances >= 0 and even
        _require("elitist_new_instances", self.elitist_new_instances, f"0 or {multiple}", valid=valid)
        _require("elitist_limit", self.elitist_limit, "0 or more", valid=self.elitist_limit >= 0)
        for name, count in (("iterations", self.iterations), ("survivors", self.survivors)):
            _require(name, count, "1 or more", valid=count is None or count >= 1)
        threshold = self.soft_restart_threshold
        _require("soft_restart_threshold", threshold, "0 or more", valid=threshold >= 0)

    @classmethod
    def irace(cls) -> "RaceOptions":
        """Exactly irace's algorithm."""
        return cls(surrogate=0.0, repeated=True, first_test=5)

    @property
    def planned_mu(self) -> int:
        """Mu, but no less than first_test."""
        return max(self.mu, self.first_test)

    def rules(self, *, first_test: int | None = None, elitist_limit: int | None = None) -> RaceRules:
        """The rules of one race, with its own first test or limit if it has them."""
        limit = self.elitist_limit if elitist_limit is None else elitist_limit
        return RaceRules(
            test=self.test,
            confidence=self.confidence,
            first_test=first_test or self.first_test,
            each_test=self.each_test,
            elitist_limit=limit if self.elitist else 0,
        )


def _require(name: str, found: object, expected: str, *, valid: bool) -> None:
    if not valid:
        raise RaceError(f"race option {name}: expected {expected}, found {found}")
