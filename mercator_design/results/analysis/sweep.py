"""The scores of designs while one setting of their mission or robots varies: scalability, flexibility, robustness.

All designs run on the same fresh instances at each value. A run has a digest of all that its score depends on, so a
sweep takes from an earlier table what it need not run again.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from typing import TYPE_CHECKING, Any, NamedTuple

from mercator_design.config.schema import unit_of
from mercator_design.config.writing import digest_of
from mercator_design.designer import Experimenter
from mercator_design.errors import FsmError, SimulationError
from mercator_design.jit import kernels_digest
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.plugins.loading import loaded_plugins
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.executors.executor import Executor, ExecutorStopped, Failed
from mercator_design.results.analysis.evaluation import Experimenters
from mercator_design.results.analysis.settings import OF_ROBOTS, Setting
from mercator_design.scores import ScoreRange
from mercator_design.software.architectures import text_of

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("key", "value", "method", "design", "instance", "seed", "score", "failure", "digest")
"""Of a table of runs; a value or design without any score has one row, with its failure and without an instance."""
OBJECTIVE = "objective"
"""A further column, before the score, if a mission has several objectives without weights: then each has rows."""


class SweptRun(NamedTuple):
    """A run, or why there is none.

    scores: By each objective that designs are compared by (`Mission.compared_by`); empty if there is no run.
    """

    setting: int  # its place in the sweep
    design: int
    instance: int | None
    scores: tuple[float, ...] = ()
    failure: str = ""


class SweptDesign(NamedTuple):
    """Control software, with the method that made it: designs of one method are one curve."""

    name: str
    software: Software
    method: str


class CurvePoint(NamedTuple):
    """The mean score of a method's designs at a value, with its confidence interval at 95 %.

    objective: What scores are by, if a mission has several objectives without weights; else empty.
    designs: How many have scores. Of several, the interval is that of the mean over designs, each with its mean over
        instances; of a single one, that of its mean over instances.
    failure: Why there is no score, or why some runs have none; empty if all have.
    """

    objective: str
    method: str
    value: Any
    mean: float | None
    low: float | None
    high: float | None
    designs: int
    runs: int
    failure: str


@dataclass(frozen=True, kw_only=True)
class SettingSweep:
    """The runs of a sweep: each design at each value on each instance.

    key: The path of the setting that varies.
    settings: The mission and robots at each value of the setting.
    designs: The control software that is measured.
    seeds: The seeds of the instances.

    Raises:
        SimulationError: There is no value, design or seed, or two designs have one name.
    """

    key: str
    settings: Sequence[Setting]
    designs: Sequence[SweptDesign]
    seeds: Sequence[int]

    def __post_init__(self) -> None:
        for name in ("settings", "designs", "seeds"):
            if not getattr(self, name):
                raise SimulationError(f"a sweep: expected at least one of its {name}")
        if len({one.name for one in self.designs}) < len(self.designs):
            raise SimulationError("a sweep: expected designs of different names")

    @cached_property
    def objectives(self) -> dict[str, ScoreRange]:
        """The names of the objectives, each with the range of its scores at the first value that has it."""
        return dict(item for own in reversed(self._ranges) for item in own.items())

    @cached_property
    def _ranges(self) -> list[dict[str, ScoreRange]]:
        """For each value the names of its objectives, with the ranges of their scores; none for an impossible value."""
        return [{} if one.simulator is None else one.simulator.mission.compared_by() for one in self.settings]

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table of runs."""
        place = COLUMNS.index("score")
        return (*COLUMNS[:place], OBJECTIVE, *COLUMNS[place:]) if any(self.objectives) else COLUMNS

    @property
    def unit(self) -> str:
        """The unit of the values of the setting, such as "s" for duration; empty if they have none."""
        simulator = next((one.simulator for one in self.settings if one.simulator is not None), None)
        *above, name = self.key.removeprefix(OF_ROBOTS).split(".")
        place: Any = getattr(simulator, "robot_model" if self.key.startswith(OF_ROBOTS) else "mission", None)
        for step in above:
            place = getattr(place, step, None)
        return unit_of(type(place), name)

    @property
    def definition(self) -> dict[str, Any]:
        """Digests of all that the scores depend on, as plain data.

        A sweep that continues another one may have more values, designs and seeds.
        """
        found = [one.simulator for one in self.settings]
        return {
            "key": self.key,
            "program": [kernels_digest(), *(f"{name} {digest}" for name, digest in sorted(loaded_plugins().items()))],
            "values": {
                setting.label: one and [one.mission.digest, digest_of(one.robot_model)]
                for setting, one in zip(self.settings, found, strict=True)
            },
            "designs": {
                one.name: digest_of([digest_of(flavour_of(one.software.flavour)), text_of(one.software)])
                for one in self.designs
            },
            "seeds": [*self.seeds],
        }

    def differences(self, earlier: Mapping[str, Any]) -> list[str]:
        """The reasons why this sweep does not continue an earlier one with a definition; none if it continues it."""
        now, key = self.definition, earlier["key"]
        if key != self.key:
            return [f"--over: expected {key}, found {self.key}"]
        found = ["the program or its plugins: expected those of the earlier runs"] * (
            now["program"] != earlier["program"]
        )
        for value, digests in earlier["values"].items():
            if value not in now["values"]:
                found.append(f"--over {key}: expected also the earlier value {value}")
            elif digests != now["values"][value]:
                found.append(f"{key}={value}: expected the mission and the robots of the earlier runs, found others")
        for name, digest in earlier["designs"].items():
            if digest not in now["designs"].values():
                is_lost = name not in now["designs"]
                found.append(f"{name}: expected {'also this earlier design' if is_lost else 'the earlier design'}")
        n = len(earlier["seeds"])
        if now["seeds"][:n] != earlier["seeds"]:
            is_fewer = earlier["seeds"][: len(self.seeds)] == now["seeds"]
            found.append(f"-n: expected at least {n}" if is_fewer else "--seed: expected that of the earlier runs")
        return found

    @property
    def size(self) -> int:
        """The number of runs, impossible ones not counted."""
        return len(self.seeds) * sum(not self.refusal(k, d) for k, d in self._pairs)

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return [(k, d) for k in range(len(self.settings)) for d in range(len(self.designs))]

    def refusal(self, setting: int, design: int) -> str:
        """Why a design cannot run at a value; empty if it can."""
        simulator, software = self.settings[setting].simulator, self.designs[design].software
        if simulator is None:
            return self.settings[setting].failure
        try:
            simulator.check(software)
        except FsmError as error:
            return str(error)
        return ""

    def digest(self, setting: int, design: int) -> str:
        """A digest of all but the seeds that the scores of a design at a value depend on; empty if it is impossible."""
        simulator, software = self.settings[setting].simulator, self.designs[design].software
        if simulator is None:
            return ""
        plugins = sorted(loaded_plugins().items())
        parts = (simulator.mission.digest, digest_of(simulator.robot_model), kernels_digest(), plugins)
        text = (*parts, digest_of(flavour_of(software.flavour)), text_of(software))
        return hashlib.sha256(repr(text).encode()).hexdigest()[:16]

    def run(
        self,
        executor: Executor,
        known: Mapping[tuple[str, int], tuple[float, ...]] | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Iterator[SweptRun]:
        """Run all that is not known, and yield each run when it has ended; known ones come first.

        Args:
            executor: Runs the experiments, within its context.
            known: Scores by each objective, by digest and seed.
            stopped: Returns whether to stop; called before each experiment.

        Raises:
            ExecutorStopped: See `stopped`; running experiments have finished.
            RaceError: The executor has lost its workers.
        """
        todo: list[SweptRun] = []
        for k, d in self._pairs:
            if refusal := self.refusal(k, d):
                yield SweptRun(k, d, None, failure=refusal)
                continue
            digest = self.digest(k, d)
            for instance, seed in enumerate(self.seeds):
                scores = (known or {}).get((digest, seed), ())
                if len(scores) == len(self._ranges[k]):
                    yield SweptRun(k, d, instance, scores)
                else:
                    todo.append(SweptRun(k, d, instance))
        experimenters = {
            (k, flavour): Experimenter(one.simulator, flavour_of(flavour))
            for k, one in enumerate(self.settings)
            if one.simulator is not None
            for flavour in {design.software.flavour for design in self.designs}
        }
        numbers = {pair: number for number, pair in enumerate(experimenters)}
        designs = [self.designs[one.design].software for one in todo]
        items = (
            (numbers[one.setting, design.flavour], design, self.seeds[one.instance or 0])
            for one, design in zip(todo, designs, strict=True)
        )
        function = Experimenters([*experimenters.values()])
        for place, result in executor.run(function, takewhile(lambda _: not stopped(), items)):
            if isinstance(result, Failed):
                yield todo[place]._replace(failure=result.reason)
            else:
                is_by_each = len(self._ranges[todo[place].setting]) > 1
                yield todo[place]._replace(scores=result.scores if is_by_each else (result.score,))
        if stopped():
            raise ExecutorStopped

    def rows(self, runs: Sequence[SweptRun]) -> list[tuple[Any, ...]]:
        """The rows of runs, with `columns`, in the order of values, designs, instances and objectives."""
        found = []
        digests = {pair: self.digest(*pair) for pair in {(one.setting, one.design) for one in runs}}
        for one in sorted(runs, key=lambda one: (one.setting, one.design, one.instance or 0)):
            design = self.designs[one.design]
            seed = None if one.instance is None else self.seeds[one.instance]
            label = self.settings[one.setting].label
            start = (self.key, label, design.method, design.name, one.instance, seed)
            end = (one.failure, digests[one.setting, one.design])
            for name, score in zip(self._ranges[one.setting], one.scores, strict=True) if one.scores else [("", None)]:
                found.append((*start, *([name] if any(self.objectives) else []), score, *end))
        return found

    def table(self, runs: Sequence[SweptRun]) -> "pd.DataFrame":
        """The rows of runs, tidy; `value` has numbers if all values are numbers, and a run without score has NaN."""
        import pandas as pd

        table = pd.DataFrame(self.rows(runs), columns=list(self.columns))
        if self.is_numeric:
            table["value"] = table["value"].astype(float)
        return table.astype({"instance": "Int64", "seed": "Int64", "score": "float64"})

    @property
    def is_numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(one.value, int | float) and not isinstance(one.value, bool) for one in self.settings)

    def curves(self, runs: Sequence[SweptRun]) -> list[CurvePoint]:
        """The points of each method's curve by each objective, method by method, in the order of the values."""
        methods = list(dict.fromkeys(one.method for one in self.designs))
        return [
            self._point(objective, method, k, runs)
            for objective in self.objectives or [""]
            for method in methods
            for k in range(len(self.settings))
        ]

    def _point(self, objective: str, method: str, setting: int, runs: Sequence[SweptRun]) -> CurvePoint:
        ranges = self._ranges[setting]
        own = [one for one in runs if one.setting == setting and self.designs[one.design].method == method]
        failures = list(dict.fromkeys(one.failure for one in own if one.failure))
        scores: dict[int, list[float]] = {}
        for one in sorted(own, key=lambda one: (one.design, one.instance or 0)):
            if one.scores and objective in ranges:
                scores.setdefault(one.design, []).append(one.scores[[*ranges].index(objective)])
        where = (objective, method, self.settings[setting].value)
        n = sum(map(len, scores.values()))
        if not scores:
            return CurvePoint(*where, None, None, None, 0, 0, "; ".join(failures))
        possible = ranges[objective]
        means = [Scores(tuple(each), possible).mean for each in scores.values()]
        found = Scores(tuple(means) if len(means) > 1 else tuple(*scores.values()), possible)
        return CurvePoint(*where, found.mean, *found.interval, len(means), n, "; ".join(failures))
