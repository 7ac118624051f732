"""How an iterated race spends its budget: how many iterations, and how many configurations each of them races."""

from dataclasses import dataclass

from mercator_design.errors import RaceError
from mercator_design.race.elimination import budget as arithmetic
from mercator_design.race.elimination.options import RaceOptions


@dataclass(frozen=True, slots=True)
class IterationPlan:
    """The next iteration.

    number: From 1.
    budget: How many experiments it may make.
    n_configurations: How many race, elites included.
    """

    number: int
    budget: int
    n_configurations: int


class Planner:
    """Plans one iteration after the other from the remaining budget.

    If irace would refuse a small budget, fewer iterations are planned, as irace does when it has a time budget.

    n_iterations: Expected number of iterations.
    survivors: How many configurations end a race.
    max_configurations: Maximum number of configurations in one race; None: no limit.
    note: How the plan differs from irace's, if it does.
    """

    def __init__(self, options: RaceOptions, n_variable: int, budget: int) -> None:
        """Plan a race.

        Args:
            options: The options of the race.
            n_variable: Number of variable parameters.
            budget: Experiments in all.

        Raises:
            RaceError: The budget is not enough for one iteration, or n_configurations for a race.
        """
        self._options, self._n_variable = options, n_variable
        self.survivors = options.survivors or arithmetic.n_iterations(n_variable)
        self.max_configurations: int | None = None
        self.note: str | None = None
        self.n_iterations = self._plan(budget)
        self._n_new_instances = options.new_instances
        self._before = 0  # iterations before the budget was extended; they are not counted
        wanted = options.n_configurations
        if wanted is not None and wanted <= self.survivors:
            raise RaceError(
                f"race option n_configurations: expected more than the {self.survivors} survivors that end a race, "
                f"found {wanted}"
            )

    def extend(self, left: int, iteration: int) -> None:
        """Plan the budget that was added after an iteration like that of a new race.

        The next iteration counts as a second one, because it begins with elites.
        """
        self._before = iteration - 1
        try:
            self.n_iterations = iteration + self._plan(left)
        except RaceError:  # too small for a first iteration, perhaps not for one that has elites
            self.n_iterations = iteration + 1
        self._n_new_instances = self._options.new_instances

    def age(self, iteration: int) -> int:
        """An iteration's number since the budget was last extended."""
        return iteration - self._before

    def n_new(self, n_seen: int) -> int:
        """New instances that a later elitist race begins with, after n_seen instances."""
        total = self._options.instances
        return self._n_new_instances if total is None else min(self._n_new_instances, total - n_seen)

    def next(self, number: int, *, left: int, n_elites: int, n_seen: int) -> IterationPlan | str:
        """Plan an iteration, or return why there is none.

        Args:
            number: Of the iteration.
            left: The remaining budget.
            n_elites: Number of elites.
            n_seen: Number of instances seen.
        """
        options = self._options
        if left <= 0:
            return "the whole budget is used"
        if number > self.n_iterations and options.iterations is not None:
            return f"all {self.n_iterations} iterations are done"
        share = arithmetic.iteration_budget(left, number, max(number, self.n_iterations))
        budget = min(options.experiments_per_iteration or share, left)
        n = self._n_configurations(budget, self.age(number), n_elites, n_seen)
        wanted = options.n_configurations
        if wanted is not None and n < wanted:
            if budget == share < left:
                return self.next(number + 1, left=left, n_elites=n_elites, n_seen=n_seen)
            return f"the budget left is too small to race {wanted} configurations"
        n = n if wanted is None else wanted
        if n <= self.survivors:
            return f"the budget left is too small to race more than {self.survivors} configurations"
        if n <= n_elites:
            return "the budget left is too small to sample configurations"
        mu = options.planned_mu
        needed = n * mu
        if options.elitist:
            needed = (n - n_elites) * mu + n_elites * min(self.n_new(n_seen), mu)
        if needed > budget:
            return "the budget left is too small to test configurations"
        return IterationPlan(number, budget, n)

    def _plan(self, budget: int) -> int:
        """The number of iterations for a budget."""
        options, n_variable = self._options, self._n_variable
        wanted = options.iterations or arithmetic.n_iterations(n_variable)
        needed = {count: options.minimum_budget(n_variable, count) for count in range(wanted, 0, -1)}
        fitting = next((count for count, experiments in needed.items() if experiments <= budget), None)
        if fitting is None:
            raise RaceError(
                f"budget: expected at least {needed[1]} experiments for {n_variable} parameters "
                f"({needed[wanted]} for all {wanted} iterations), found {budget}"
            )
        self.max_configurations = self.note = None
        if fitting < wanted:
            self.max_configurations = 2 * self.survivors
            further = "" if options.iterations else ", and more follow while budget is left"
            self.note = (
                f"a budget of {budget} is planned for {fitting} instead of {wanted} iterations, with at most "
                f"{self.max_configurations} configurations in each{further}; "
                f"{needed[wanted]} experiments would allow all {wanted}"
            )
        return fitting

    def _n_configurations(self, budget: int, age: int, n_elites: int, n_seen: int) -> int:
        """The largest number that the budget allows; if it is too small, without new instances, then with one."""
        options = self._options
        is_keeping = options.elitist and n_elites > 0

        def fitting(growth: int, mu: int) -> int:
            return arithmetic.n_configurations(
                budget,
                growth,
                mu=mu,
                each_test=options.instances_each_test,
                n_elites=n_elites if is_keeping else 0,
                n_old=n_seen if is_keeping else 0,
                n_new=self.n_new(n_seen) if is_keeping else 0,
            )

        n = fitting(age, options.planned_mu)
        if n <= self.survivors:
            self._n_new_instances = 0  # from now on
            n = fitting(age, options.planned_mu)
        if n <= self.survivors:
            n = fitting(1, 1)
        if self.max_configurations is None or options.n_configurations:
            return n
        return min(n, self.max_configurations)
