"""irace's job done here: the parameters of any program, which irace's scenario.txt describes."""

import dataclasses
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
from mercator_design.race.irace import configurations, scenario_text
from mercator_design.race.irace.scenario import Scenario, read_scenario
from mercator_design.race.irace.scenario_options import in_names_of_irace, of_races
from mercator_design.race.irace.target_runner import Call
from mercator_design.race.methods.iterated import IteratedRace
from mercator_design.race.methods.optimizer import Optimizer
from mercator_design.race.methods.table import METHODS, RACES, Method
from mercator_design.race.racing.race import Experiment
from mercator_design.race.running.evaluation import results_of, test_of
from mercator_design.race.running.events import ExperimentDone, TestDone
from mercator_design.race.running.executors import Executor, ExecutorStopped
from mercator_design.race.running.outcome import ExperimentFailed, OnFailure, error_of, is_fatal
from mercator_design.race.running.task import RaceResult, Start, Task
from mercator_design.race.space.parameter import Configuration
from mercator_design.seeds import generator, instance_seed

_AS_IT_IS = {"parameterFile", "configurationsFile", "instances", "testInstances"} | {
    f"{kind}Instances{what}" for kind in ("train", "test") for what in ("Dir", "File")
}


class Tuner(Task[Call]):
    """Finds the parameters of a scenario's program that cost least.

    Args:
        scenario: What is tuned.
        method: Of `METHODS`; for one of `RACES`, the scenario was read with its options as the base.

    Raises:
        RaceError: if the budget is too small.
    """

    WINNER = "best.txt"
    START: ClassVar = {}
    speculates = False  # a run of a program may take hours of a cluster

    def __init__(self, scenario: Scenario, method: str = "irace") -> None:
        self.scenario = scenario
        self.name = scenario.name
        self.method = method
        self.function = scenario.target
        if scenario.target.evaluator is not None:
            self.evaluate = scenario.target.evaluate
        try:
            self.race = self._race()
        except RaceError as error:
            raise RaceError(f"{scenario.path}: {in_names_of_irace(error)}") from None
        self.race.notes += scenario.notes

    def _race(self) -> Optimizer:
        scenario = self.scenario
        is_race = self.method in RACES
        make: Method = partial(IteratedRace, options=scenario.options) if is_race else METHODS[self.method]
        race = make(scenario.space, budget=scenario.budget, seed=scenario.seed, initial=scenario.initial)
        if not is_race:
            race.notes += [f"{name} makes no difference to {self.method}" for name in of_races(scenario.settings)]
        return race

    @classmethod
    def restore(cls, folder: Path, start: Start) -> Self:
        """As `Task.restore`."""
        base = RACES.get(start["method"])
        return cls(read_scenario(folder / "scenario.txt", base=base, name=start["name"]), start["method"])

    def start(self) -> dict[str, Any]:
        """As `Task.start`: how the target runner is called is no part of it, so it may be mended and moved."""
        scenario = self.scenario
        return {
            "task": "scenario",
            "name": self.name,
            "mercator_design": __version__,
            "space_digest": _digest(scenario.parameters),
            "instances_digest": _digest(json.dumps(scenario.instances)),
            "initial_digest": _digest(json.dumps(scenario.initial)),
            "budget": self.race.budget,
            "seed": self.race.seed,
            "method": self.method,
            "options": dataclasses.asdict(self.race.options),
        }

    def files(self) -> dict[str, bytes]:
        """As `Task.files`: a scenario of its own, which irace reads too."""
        scenario = self.scenario
        settings = {name: value for name, value in scenario.settings.items() if name not in _AS_IT_IS}
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
        """As `Task.runs`: how often the target runner ran."""
        made = self.scenario.target.made.count
        parts = [f"{experiments} experiments"] * (experiments > 0) + [f"{tests} tests"] * (tests > 0)
        if made > experiments + tests:
            parts.append(f"{made - experiments - tests} ahead of the race or tried again")
        return [f"Runs       the target runner ran {made} times now: {', '.join(parts)}"]

    def stop(self) -> None:
        """As `Task.stop`: all runs that are under way."""
        self.scenario.target.stop.set()

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> Call:
        """As `Task.item`; tests are on test instances in turn, or if there are none on the others with other seeds."""
        scenario, number = self.scenario, experiment.instance
        instances = (scenario.test_instances or scenario.instances) if test else scenario.instances
        place = number % len(instances) if test else self.place(number)
        return Call(
            configuration=experiment.configuration,
            instance_id=f"{place + 1}t" if instances is scenario.test_instances else f"{place + 1}",
            seed=self.test_seed(number) if test else self.seed(number),
            instance=instances[place],
            arguments=scenario.space.command_line(configuration),
        )

    def test_seed(self, instance: int) -> int:
        """As `Task.test_seed`."""
        return instance_seed(self.race.seed, "test", instance)

    def test(
        self,
        configurations: Sequence[Configuration],
        executor: Executor,
        *,
        on_failure: OnFailure = "stop",
        stopped: Callable[[], bool] = lambda: False,
    ) -> list[list[float]]:
        """The costs of configurations on all test instances, a row each; they are numbered from 1, as irace does.

        Args:
            configurations: Of any race, or of none.
            executor: Runs the tests.
            on_failure: Whether a test that fails ends all, or has an infinite cost, as one by which a configuration is
                rejected.
            stopped: Asked before each test whether to stop.

        Raises:
            ExperimentFailed: see `on_failure`.
            Stopped: see `stopped`.
        """
        n = len(self.scenario.test_instances)
        tests = [Experiment(number, instance) for number in range(1, len(configurations) + 1) for instance in range(n)]
        failed: list[ExperimentFailed] = []
        costs = [[math.inf] * n for _ in configurations]

        numbered = dict(enumerate(configurations, start=1))
        results = results_of(self, executor, tests, numbered, [], lambda: bool(failed) or stopped())
        for where, result in results:
            test = test_of(self, where, result)
            if is_fatal(result, on_failure):
                failed.append(ExperimentFailed(test, error_of(result)))
            elif test.score is not None:
                costs[where.configuration - 1][where.instance] = test.score
        if stopped():
            raise ExecutorStopped
        if failed:
            raise failed[0]
        return costs

    def winner_text(self, result: RaceResult, header: Mapping[str, str]) -> str:
        """As `Task.winner_text`: irace's file of configurations, with all elites, the winner first."""
        numbers = dict.fromkeys([result.configuration, *(elite.configuration for elite in self.race.elites)])
        best = [self.race.configurations[number] for number in numbers]
        comments = [f"{key}: {value}" for key, value in header.items()]
        return configurations.to_text(self.scenario.space, best, comments)

    def is_winner(self, file: Path, configuration: Configuration) -> bool:
        """As `Task.is_winner`."""
        return configurations.read_configurations(file, self.scenario.space)[0][:1] == [configuration]

    def command_of_failed(self, one: ExperimentDone | TestDone, folder: Path, header: Mapping[str, str]) -> str:  # noqa: ARG002
        """As `Task.command_of_failed`: the target runner, in its folder, and then the evaluator if there is one."""
        experiment = Experiment(one.configuration, one.instance)
        configuration = self.race.configurations[one.configuration]
        call = self.item(experiment, configuration, test=isinstance(one, TestDone))
        command = self.command_line(call)
        return command if self.evaluate is None else f"{command} && {self.evaluation_line(call, [one.configuration])}"

    def command_line(self, call: Call) -> str:
        """What a shell is told to run an experiment."""
        target = self.scenario.target
        return f"cd {shlex.quote(str(target.folder))} && {shlex.join(target.command(call))}"

    def evaluation_line(self, call: Call, alive: Sequence[int]) -> str:
        """What a shell is told to evaluate an experiment that has run."""
        target = self.scenario.target
        return f"cd {shlex.quote(str(target.folder))} && {shlex.join(target.evaluation(call, alive))}"

    def place(self, instance: int) -> int:
        """Which of the scenario's instances an instance of the race is: all of them once, then all once more, ..."""
        n, options = len(self.scenario.instances), self.scenario.options
        if not options.sample_instances:
            return instance % n
        return _order(self.race.seed, instance // n, n, options.block_size)[instance % n]

    @staticmethod
    def command(start: Start, folder: Path) -> str:
        """As `Task.command`; budget and seed are in the scenario."""
        return shlex.join(["mdesign", "tune", str(folder / "scenario.txt"), "--method", start["method"]])

    @staticmethod
    def about(start: Start) -> list[str]:
        """As `Task.about`."""
        return [f"Scenario   {start['name']}, seed {start['seed']}; scores are costs: less is better"]

    @staticmethod
    def columns(start: Start, configurations: Sequence[Configuration]) -> dict[str, list[Any]]:  # noqa: ARG004
        """As `Task.columns`: a column for each parameter."""
        names = dict.fromkeys(name for configuration in configurations for name in configuration)
        return {name: [configuration.get(name) for configuration in configurations] for name in names}


@lru_cache(maxsize=64)
def _order(seed: int, turn: int, n: int, block_size: int) -> tuple[int, ...]:
    """Random, of blocks; within a block, instances keep theirs."""
    blocks = generator(seed, f"instances, turn {turn}").permutation(n // block_size).tolist()
    return tuple(block * block_size + place for block in blocks for place in range(block_size))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
