"""A race for the parameters of any program that irace's scenario.txt describes."""

import hashlib
import json
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar, Self

from mercator_design import __version__
from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import Executor, ExecutorStopped
from mercator_design.race.irace import configurations, scenario_text
from mercator_design.race.irace.scenario import Scenario, read_scenario
from mercator_design.race.irace.scenario_options import in_names_of_irace, of_races
from mercator_design.race.irace.target_runner import RunnerCall
from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.table import METHODS, Method
from mercator_design.race.session.evaluation import results_of, test_of
from mercator_design.race.session.events import ExperimentDone, TestDone
from mercator_design.race.session.outcome import ExperimentFailed, OnFailure, is_fatal
from mercator_design.race.session.task import RaceResult, Start, Task
from mercator_design.race.space.parameter import Configuration
from mercator_design.seeds import generator

_WRITTEN_SEPARATELY = {"parameterFile", "configurationsFile", "instances", "testInstances"} | {
    f"{kind}Instances{what}" for kind in ("train", "test") for what in ("Dir", "File")
}


class Tuner(Task[RunnerCall]):
    """Finds the parameters with the lowest mean cost of a scenario's program.

    Args:
        scenario: The scenario.
        method: A name of `METHODS`.

    Raises:
        RaceError: if the budget is too small.
    """

    WINNER = "best.txt"
    START: ClassVar = {}
    speculates = False  # a run may be expensive
    predicts = False  # programs may keep files by the number

    def __init__(self, scenario: Scenario, method: str = "irace") -> None:
        self.scenario = scenario
        self.name = scenario.name
        self.method = method
        self.function = scenario.target
        if scenario.target.evaluator is not None:
            self.evaluate = scenario.target.evaluate
        try:
            self.optimizer = self._race()
        except RaceError as error:
            raise RaceError(f"{scenario.path}: {in_names_of_irace(error)}") from None
        self.optimizer.notes += scenario.notes

    def _race(self) -> Optimizer:
        scenario = self.scenario
        is_race = self.method == "irace"
        make: Method = partial(IteratedRace, options=scenario.options) if is_race else METHODS[self.method]
        race = make(scenario.space, budget=scenario.budget, seed=scenario.seed, initial=scenario.initial)
        if not is_race:
            race.notes += [f"{name} has no effect on {self.method}" for name in of_races(scenario.settings)]
        return race

    @classmethod
    def restore(cls, folder: Path, start: Start) -> Self:
        return cls(read_scenario(folder / "scenario.txt", name=start["name"]), start["method"])

    def start(self) -> dict[str, Any]:
        """The start has nothing of the target runner, so that it may be corrected and moved."""
        scenario = self.scenario
        return {
            "task": "scenario",
            "name": self.name,
            "mercator_design": __version__,
            "space_digest": _digest(scenario.parameters),
            "instances_digest": _digest(json.dumps(scenario.instances)),
            "initial_digest": _digest(json.dumps(scenario.initial)),
            **super().start(),
        }

    def files(self) -> dict[str, bytes]:
        """A scenario of which no file is outside of the folder; irace can read it, too."""
        scenario = self.scenario
        settings = {name: value for name, value in scenario.settings.items() if name not in _WRITTEN_SEPARATELY}
        target = scenario.target
        settings |= {"maxExperiments": scenario.budget, "seed": scenario.seed}
        settings |= {"targetRunner": str(target.runner), "execDir": str(target.folder)}
        if target.launcher is not None:
            settings["targetRunnerLauncher"] = str(target.launcher)
        if target.evaluator is not None:
            settings["targetEvaluator"] = str(target.evaluator)
        settings |= {"parameterFile": "parameters.txt", "instances": scenario.instances}
        settings.pop("minExperiments", None)
        if scenario.test_instances:
            settings["testInstances"] = scenario.test_instances
        files = {"parameters.txt": scenario.parameters}
        if scenario.initial:
            settings["configurationsFile"] = "configurations.txt"
            files["configurations.txt"] = configurations.to_text(scenario.space, scenario.initial)
        files["scenario.txt"] = scenario_text.to_text(settings)
        return {name: text.encode() for name, text in files.items()}

    def runs(self, experiments: int, tests: int) -> list[str]:
        """How often the target runner ran."""
        n = len(self.scenario.target.started)
        parts = [f"{experiments} experiments"] * (experiments > 0) + [f"{tests} tests"] * (tests > 0)
        if n > experiments + tests:
            parts.append(f"{n - experiments - tests} speculative or repeated")
        return [f"Runs       the target runner ran {n} times now: {', '.join(parts)}"]

    def stop(self) -> None:
        """End all running programs."""
        self.scenario.target.stop.set()

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> RunnerCall:
        """As `Problem.item`; tests use the test instances in turn, or the instances of the race with other seeds."""
        scenario, number = self.scenario, experiment.instance
        instances = (scenario.test_instances or scenario.instances) if test else scenario.instances
        place = number % len(instances) if test else self.place(number)
        return RunnerCall(
            configuration=experiment.configuration,
            instance_id=f"{place + 1}t" if instances is scenario.test_instances else f"{place + 1}",
            seed=self.test_seed(number) if test else self.seed(number),
            instance=instances[place],
            arguments=scenario.space.command_line(configuration),
        )

    def test(
        self,
        configurations: Sequence[Configuration],
        executor: Executor,
        *,
        on_failure: OnFailure = "stop",
        stopped: Callable[[], bool] = lambda: False,
    ) -> list[list[float]]:
        """The costs of configurations on all test instances, a row for each configuration.

        Target runners get the numbers of the configurations from 1, as in irace.

        Args:
            configurations: The configurations; they need not be of a race.
            executor: Runs the tests.
            on_failure: Whether a test that fails stops all tests, or has an infinite cost.
            stopped: Returns whether to stop; called before each test.

        Raises:
            ExperimentFailed: see `on_failure`.
            ExecutorStopped: see `stopped`.
        """
        n, numbered = len(self.scenario.test_instances), dict(enumerate(configurations, start=1))
        tests = [Experiment(number, instance) for number in numbered for instance in range(n)]
        failed: list[ExperimentFailed] = []
        costs = [[math.inf] * n for _ in configurations]
        results = results_of(self, executor, tests, numbered, [], lambda: bool(failed) or stopped())
        for where, result in results:
            test = test_of(self, where, result)
            if is_fatal(result, on_failure):
                failed.append(ExperimentFailed(test, result))
            elif test.score is not None:
                costs[where.configuration - 1][where.instance] = test.score
        if stopped():
            raise ExecutorStopped
        if failed:
            raise failed[0]
        return costs

    def winner_text(self, result: RaceResult, header: Mapping[str, str]) -> str:
        """The file has all elites, the winner first, in irace's format of configurations."""
        numbers = dict.fromkeys([result.configuration, *(elite.configuration for elite in self.optimizer.elites)])
        best = [self.optimizer.configurations[number] for number in numbers]
        comments = [f"{key}: {value}" for key, value in header.items()]
        return configurations.to_text(self.scenario.space, best, comments)

    def is_winner(self, file: Path, configuration: Configuration) -> bool:
        return configurations.read_configurations(file, self.scenario.space)[0][:1] == [configuration]

    def command_of_failed(self, one: ExperimentDone | TestDone, folder: Path, header: Mapping[str, str]) -> str:  # noqa: ARG002
        """The command of the target runner in its folder, and of the evaluator if there is one."""
        experiment = Experiment(one.configuration, one.instance)
        configuration = self.optimizer.configurations[one.configuration]
        call = self.item(experiment, configuration, test=isinstance(one, TestDone))
        target = self.scenario.target
        command = self.shell_command(target.command(call))
        if self.evaluate is None:
            return command
        return f"{command} && {self.shell_command(target.evaluation(call, [one.configuration]))}"

    def shell_command(self, command: list[str]) -> str:
        """The shell command that runs a command of the scenario in its folder."""
        return f"cd {shlex.quote(str(self.scenario.target.folder))} && {shlex.join(command)}"

    def place(self, instance: int) -> int:
        """The index of the scenario's instance for an instance of the race; each round uses all instances once."""
        n, options = len(self.scenario.instances), self.scenario.options
        if not options.sample_instances:
            return instance % n
        return _order(self.optimizer.seed, instance // n, n, options.block_size)[instance % n]

    @staticmethod
    def command(start: Start, folder: Path) -> str:
        """The command has neither budget nor seed: they are in the scenario."""
        return shlex.join(["mdesign", "tune", str(folder / "scenario.txt"), "--method", start["method"]])

    @staticmethod
    def about(start: Start) -> list[str]:
        return [f"Scenario   {start['name']}, seed {start['seed']}; scores are costs: lower is better"]

    @staticmethod
    def columns(start: Start, configurations: Sequence[Configuration]) -> dict[str, list[Any]]:  # noqa: ARG004
        """A column for each parameter."""
        names = dict.fromkeys(name for configuration in configurations for name in configuration)
        return {name: [configuration.get(name) for configuration in configurations] for name in names}


@lru_cache(maxsize=64)
def _order(seed: int, turn: int, n: int, block_size: int) -> tuple[int, ...]:
    """The random order of instances in a round: blocks are shuffled, instances within a block are not."""
    blocks = generator(seed, f"instances, turn {turn}").permutation(n // block_size).tolist()
    return tuple(block * block_size + place for block in blocks for place in range(block_size))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
