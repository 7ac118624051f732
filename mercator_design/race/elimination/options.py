"""irace's options of an iterated race, and their valid ranges."""

from dataclasses import dataclass, fields
from numbers import Integral
from typing import get_args

from mercator_design.errors import RaceError
from mercator_design.race.elimination import budget as arithmetic
from mercator_design.race.elimination.race import RaceRules
from mercator_design.race.elimination.statistics import TestName


@dataclass(frozen=True, kw_only=True, slots=True)
class RaceOptions:
    """irace's options, with the same meaning and the same defaults.

    Args:
        test: What eliminates configurations: "friedman", "t-test", "t-test-holm" or "t-test-bonferroni"
            (testType).
        confidence: Of the test.
        first_test: Blocks of instances before the first test, a multiple of each_test.
        each_test: Blocks between tests.
        block_size: Instances in a block: they are run together and in their order. With the default, 1, a block is an
            instance.
        mu: Instances to plan the number of configurations with, a multiple of block_size; raised to first_test's, so
            that 0 means the number of instances before the first test.
        elitist: Elites keep their results, and are protected until newcomers have run on the same instances.
        elitist_new_instances: New blocks that a later elitist race begins with.
        elitist_limit: Tests without elimination that end an elitist race; 0 for no limit.
        iterations: Replaces irace's number of iterations (nbIterations).
        survivors: Replaces irace's number of survivors that ends a race (minNbSurvival).
        n_configurations: Number in each iteration, fewer than the budget would allow (nbConfigurations). An iteration
            whose share of the budget is too small for them is skipped.
        experiments_per_iteration: Budget of each iteration instead of an even share (nbExperimentsPerIteration).
        instances: Number of instances, if it is finite: then a configuration runs at most once on each, and a race ends
            when it has used all (deterministic). A multiple of block_size; only with elitist races.
        sample_instances: Revisit old instances in random order, not in their first order (sampleInstances). The order
            of new instances is that of their numbers.
        soft_restart: Widen the elites' distributions when they have become too narrow to sample anything new.
        soft_restart_threshold: Part of a domain's width below which values are the same to a soft restart.
        postselection: Spend the remaining budget on a race among the best of all iterations. A number between 0 and 1
            is the share of the whole budget that is kept for it.

    Raises:
        RaceError: An option is out of range.
    """

    test: TestName = "friedman"
    confidence: float = 0.95
    first_test: int = 5
    each_test: int = 1
    block_size: int = 1
    mu: int = 5
    elitist: bool = True
    elitist_new_instances: int = 1
    elitist_limit: int = 2
    iterations: int | None = None
    survivors: int | None = None
    n_configurations: int | None = None
    experiments_per_iteration: int | None = None
    instances: int | None = None
    sample_instances: bool = True
    soft_restart: bool = True
    soft_restart_threshold: float = 1e-4
    postselection: float = True

    def __post_init__(self) -> None:
        self._require("test", " or ".join(get_args(TestName)), self.test in get_args(TestName))
        self._require("confidence", "between 0 and 1", 0 < self.confidence < 1)
        for one in fields(self):
            if one.default is None or type(one.default) is int:
                is_whole = isinstance(value := getattr(self, one.name), Integral) or value is one.default
                self._require(one.name, "a whole number", is_whole)
        for name in (
            "each_test",
            "block_size",
            "iterations",
            "survivors",
            "n_configurations",
            "experiments_per_iteration",
        ):
            count = getattr(self, name)
            self._require(name, "1 or more", count is None or count >= 1)
        even = self.first_test % self.each_test == 0
        expected = f"1 or more and a multiple of each_test ({self.each_test})"
        self._require("first_test", expected, self.first_test >= 1 and even)
        first, whole_blocks = self._instances_of_first_test, f"a multiple of block_size ({self.block_size})"
        even = self.mu % self.block_size == 0
        self._require("mu", f"0 or more and {whole_blocks}", self.mu >= 0 and (even or self.mu < first))
        for name in ("elitist_new_instances", "elitist_limit", "soft_restart_threshold"):
            self._require(name, "0 or more", getattr(self, name) >= 0)
        self._require("postselection", "0 to 1", 0 <= self.postselection <= 1)
        total = self.instances
        self._require("instances", whole_blocks, total is None or total % self.block_size == 0)
        hint = "; add instances, or set first_test"
        self._require("instances", f"{first} or more, for the first test", total is None or total >= first, hint)
        self._require("instances", "none if elitist is off", self.elitist or self.instances is None)

    def _require(self, name: str, expected: str, is_valid: bool, hint: str = "") -> None:
        if not is_valid:
            raise RaceError(f"race option {name}: expected {expected}, found {getattr(self, name)}{hint}")

    @property
    def planned_mu(self) -> int:
        """Mu, or the number of instances before the first test if that is larger."""
        return max(self.mu, self._instances_of_first_test)

    @property
    def instances_each_test(self) -> int:
        """Instances between tests."""
        return self.each_test * self.block_size

    @property
    def new_instances(self) -> int:
        """New instances that a later elitist race begins with."""
        return self.elitist_new_instances * self.block_size

    def kept(self, budget: int) -> int:
        """How much of a budget iterations leave to the race among the best of all, if they do not end earlier."""
        return round(self.postselection % 1 * budget) if self.elitist else 0

    def minimum_budget(self, n_variable: int, iterations: int | None = None) -> int:
        """The smallest budget for some iterations; by default for all, which irace requires."""
        usual = arithmetic.n_iterations(n_variable)
        return arithmetic.minimum_budget(
            iterations or self.iterations or usual,
            self.survivors or usual,
            mu=self.planned_mu,
            each_test=self.instances_each_test,
            n_new=self.new_instances,
            elitist=self.elitist,
        )

    def rules(self) -> RaceRules:
        """The rules of one race."""
        return RaceRules(
            test=self.test,
            confidence=self.confidence,
            first_test=self._instances_of_first_test,
            each_test=self.instances_each_test,
            elitist_limit=self.elitist_limit if self.elitist else 0,
        )

    @property
    def _instances_of_first_test(self) -> int:
        return self.first_test * self.block_size
