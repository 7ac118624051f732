"""Simulate, measure and design, in a call each: the functions of `import mercator_design`."""

import dataclasses
import logging
import tempfile
import time
from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from mercator_design.config.schema import one_of
from mercator_design.designer import Designer
from mercator_design.errors import RaceError, SimulationError, excerpt
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Scored
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_names
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import Event
from mercator_design.race.session.outcome import OnFailure
from mercator_design.race.session.runner import RaceRun
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.seeds import instance_seed
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator

if TYPE_CHECKING:
    import pandas as pd

    from mercator_design.results.folder import RunFolder
    from mercator_design.show.page import ReplayPage
    from mercator_design.studies.plan import StudyPlan
    from mercator_design.studies.running import StudyProgress
    from mercator_design.studies.table import StudyTable

SWEEP_RUNS = 30
"""Instances of a sweep, by default."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedTrace(Trace):
    """The trace of an experiment that can be shown."""

    simulator: Simulator
    pfsm: Software
    seed: int

    def __repr__(self) -> str:
        return f"<SimulatedTrace of {self.simulator.mission.name}, seed {self.seed}: {self.summary}>"

    def replay(self) -> "ReplayPage":
        """The experiment as a page that plays it: shown by a notebook, and written by its `save`."""
        from mercator_design.results.experiments.experiment import ShownExperiment
        from mercator_design.show.page import ReplayPage

        return ReplayPage([ShownExperiment.simulated(self.simulator, self.pfsm, self.seed)])


def simulate(
    mission: Mission, pfsm: Software, *, seed: int = 1, robot_model: RobotModel | None = None, record: bool = False
) -> SimulatedTrace:
    """Run one experiment; `mission.scored(trace)` has its scores, and `trace.replay()` shows it.

    Args:
        mission: What the robots have to do.
        pfsm: The control software of every robot.
        seed: Of the instance: floor, starting poses and all random numbers.
        robot_model: The robots. [default: the mission's]
        record: Whether to keep what the robots perceived and did, which `Trace.measure` needs for some devices.

    Raises:
        FsmError: The PFSM needs a sensor that the robot lacks.
        MissionError: The robots do not fit, or the objective has no score for what they did.
        SimulationError: The seed is negative.
    """
    _check_minimum("seed", seed, 0)
    simulator = Simulator(mission, robot_model)
    trace = simulator.run(pfsm, seed, record=record).trace
    fields = {field.name: getattr(trace, field.name) for field in dataclasses.fields(trace)}
    return SimulatedTrace(**fields, simulator=simulator, pfsm=pfsm, seed=seed)


def fresh_instances(seed: int = 1, runs: int = 100) -> list[int]:
    """Seeds of instances that have nothing to do with those of a race; a longer series begins alike.

    Raises:
        SimulationError: A number is negative.
    """
    _check_minimum("seed", seed, 0)
    _check_minimum("runs", runs, 0)
    return [instance_seed(seed, "evaluation", instance) for instance in range(runs)]


def evaluate(
    mission: Mission,
    pfsm: Software,
    *,
    seeds: Iterable[int] | None = None,
    robot_model: RobotModel | None = None,
    jobs: int | None = None,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> Evaluation:
    """Run a PFSM on several instances.

    Args:
        mission: What the robots have to do.
        pfsm: What to measure.
        seeds: Of the instances. [default: `fresh_instances()`, as `mdesign evaluate`]
        robot_model: The robots. [default: the mission's]
        jobs: Experiments run at once. [default: the cores that it may use]
        watch: Called with the number of experiments done.

    Raises:
        FsmError: The PFSM needs a sensor that the robot lacks.
        MissionError: The robots do not fit, or the objective has no score for what they did.
        RaceError: `jobs` is below 1.
        SimulationError: There are no seeds, or one is negative.
    """
    seeds = tuple(fresh_instances() if seeds is None else seeds)
    _check_minimum("number of seeds", len(seeds), 1)
    _check_minimum("seed", min(seeds), 0)
    simulator = Simulator(mission, robot_model)
    simulator.check(pfsm)

    def measured(seed: int) -> Scored:
        return simulator.run(pfsm, seed).scored

    with ThreadExecutor(jobs) as executor:
        found = in_order(executor, measured, seeds, watch)
    return Evaluation.of(mission, found, seeds)


def sweep(
    mission: Mission,
    designs: Mapping[str, Software | Sequence[Software]],
    key: str,
    values: Sequence[Any],
    *,
    overrides: Sequence[str] = (),
    keeps_density: bool = False,
    seeds: Iterable[int] | None = None,
    robot_model: RobotModel | None = None,
    jobs: int | None = None,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> "pd.DataFrame":
    """Measure designs while one setting of their mission or robots varies, as `mdesign sweep`.

    Args:
        mission: What the robots have to do.
        designs: By the name of their method: one design, or several of the same method.
        key: What is varied, the path of a key: of the mission, as "robots"; below "robot_model", of the robot model,
            as "robot_model.failures.share"; or "arena.scale", the factor by which the arena grows.
        values: Its values.
        overrides: Assignments that hold for all values, as "duration=60".
        keeps_density: Whether the arena grows with the number of robots, which is varied.
        seeds: Of the instances. [default: `fresh_instances(runs=30)`]
        robot_model: The robots. [default: the mission's]
        jobs: Experiments run at once. [default: the cores that it may use]
        watch: Called with the number of experiments done.

    Returns:
        A row for each run: key, value, method, design, instance, seed, score, failure, digest; of a mission with
        several objectives without weights one for each, with the column `objective` before the score. A value or
        design without any score has one row, whose `failure` says why.

    Raises:
        MissionError: Density is kept of another key than robots.
        RaceError: `jobs` is below 1.
        SimulationError: There are no values, designs or seeds, or a seed is negative.
    """
    from mercator_design.results.analysis.settings import settings_of
    from mercator_design.results.analysis.sweep import SettingSweep, SweptDesign

    seeds = tuple(fresh_instances(runs=SWEEP_RUNS) if seeds is None else seeds)
    _check_minimum("seed", min(seeds, default=0), 0)
    swept = []
    for method, given in designs.items():
        several = list(given) if isinstance(given, Sequence) else [given]
        names = [method] if len(several) == 1 else [f"{method} {k + 1}" for k in range(len(several))]
        swept += [SweptDesign(name, one, method) for name, one in zip(names, several, strict=True)]
    settings = settings_of(mission, robot_model, key, values, overrides=overrides, keeps_density=keeps_density)
    task = SettingSweep(key=key, settings=settings, designs=swept, seeds=seeds)
    runs = []
    with ThreadExecutor(jobs) as executor:
        for run in task.run(executor):
            runs.append(run)
            watch(sum(one.instance is not None for one in runs))
    return task.table(runs)


class DesignRun(RaceRun[tuple[Software, int]]):
    """A running race for control software: an iterator of its events, with `result` and `pfsm`.

    Args:
        designer: The task of the race.
        executor: Runs experiments; entered at the first event, and left after the last.
        folder: The run folder, which is closed after the last event; None: the race is only in memory.
        on_failure: As `RaceRun`.
        testing: As `RaceRun`.
    """

    def __init__(
        self,
        designer: Designer,
        executor: Executor,
        folder: "RunFolder | None" = None,
        *,
        on_failure: OnFailure = "stop",
        testing: Testing | None = None,
    ) -> None:
        record = None if folder is None else folder.journal
        super().__init__(designer, executor, record, on_failure=on_failure, testing=testing)
        self.designer = designer
        self._folder = folder
        self._resources = ExitStack()
        if folder is not None:
            self._resources.enter_context(folder)

    def __repr__(self) -> str:
        return f"<DesignRun of {self.designer.name}: {self.summary}>"

    @property
    def summary(self) -> str:
        """How far the race is, or its winner, in a line."""
        done = f"{len(self._record.experiments)} of {self._record.budget} experiments"
        if self._result is None:
            return done
        return f"{done}, configuration {self._result.configuration} won: {self._result.summary}"

    def _run(self) -> Generator[Event, None, None]:
        started = time.monotonic()
        with self._resources:
            self.designer.prepare(_log.info)
            self._resources.enter_context(self._executor)
            if self._folder is not None:
                self._folder.journal.open_session("threads", self._executor.jobs)
            yield from super()._run()
            if self._folder is not None:
                self._folder.finish(self.result, seconds=round(time.monotonic() - started, 3))

    def close(self) -> None:
        """Stop the race: end its threads and close its run folder, whose race can be resumed."""
        super().close()
        self._resources.close()

    @property
    def has_ended(self) -> bool:
        """Whether there is a winner."""
        return self._result is not None

    @property
    def pfsm(self) -> Software:
        """The winner, of flavours of PFSMs a `Pfsm`.

        Raises:
            RaceError: The race has not come to its end yet.
        """
        return self.designer.software(self.result.configuration)


def design(
    mission: Mission,
    *,
    budget: int,
    seed: int = 1,
    flavour: str = "watermelon",
    method: str = DEFAULT_METHOD,
    robot_model: RobotModel | None = None,
    jobs: int | None = None,
    on_failure: OnFailure = "stop",
    test_runs: int = TEST_RUNS,
    folder: str | Path | None = None,
) -> DesignRun:
    """Design control software for a mission, by a race; nothing runs before the first event is asked for.

    Args:
        mission: What the robots have to do.
        budget: Experiments to run at most.
        seed: Of all that is random.
        flavour: Modules to design with.
        method: What proposes configurations and decides which of them run on; a name of `race.methods.table.METHODS`.
        robot_model: The robots. [default: the mission's]
        jobs: Experiments run at once; the result does not depend on it. [default: the cores that it may use]
        on_failure: Whether an experiment that fails stops the race ("stop"), or rejects its configuration ("reject").
        test_runs: Fresh instances to test the winner on, beyond the budget; 0: do not.
        folder: The run folder to write, new or empty, as by `mdesign race -o`. [default: none]

    Raises:
        FsmError: The robot lacks a sensor that a module of the flavour needs.
        MissionError: The mission is impossible.
        RaceError: The budget is too small, or the folder has files; there is no such flavour, method or way to fail; or
            `jobs` or `test_runs` is too small.
        SimulationError: `seed` is negative.
    """
    _check_choice("flavour", flavour, flavour_names())
    _check_choice("method", method, METHODS)
    _check_choice("on_failure", on_failure, get_args(OnFailure))
    _check_minimum("seed", seed, 0)
    testing = Testing(runs=test_runs) if test_runs else None
    executor = ThreadExecutor(jobs)
    designer = Designer(Simulator(mission, robot_model), budget=budget, seed=seed, flavour=flavour, method=method)
    run_folder = None
    if folder is not None:
        from mercator_design.results.folder import RunFolder
        from mercator_design.results.provenance import Request

        request = Request(mission=mission.name, flavour=flavour, method=method, executor="threads", jobs=executor.jobs)
        run_folder = RunFolder.create(Path(folder), designer, request=request, testing=testing)
    return DesignRun(designer, executor, run_folder, on_failure=on_failure, testing=testing)


def study(
    plan: "StudyPlan | Mapping[str, Any] | str | Path",
    *,
    folder: str | Path | None = None,
    jobs: int | None = None,
    on_failure: OnFailure = "stop",
    watch: "Callable[[StudyProgress], None]" = lambda progress: None,  # noqa: ARG005 - a name for the reader
) -> "StudyTable":
    """Run a study, or what is new in it, and return its tables: `runs` and `designs`, tidy DataFrames.

    Args:
        plan: The file of the study, or its contents.
        folder: The study's folder, new or of the same study, as by `mdesign study -o`. [default: one that is deleted]
        jobs: Experiments run at once. [default: the cores that it may use]
        on_failure: As `design`.
        watch: Called with the progress after each experiment.

    Raises:
        StudyError: The plan is not valid, or the folder has something else.
        MercatorError: An experiment failed.
    """
    from mercator_design.studies.folder import StudyFolder
    from mercator_design.studies.plan import plan_of
    from mercator_design.studies.reading import study_table
    from mercator_design.studies.resolving import resolve
    from mercator_design.studies.running import StudyRun

    _check_choice("on_failure", on_failure, get_args(OnFailure))
    resolved, executor = resolve(plan_of(plan)), ThreadExecutor(jobs)
    with ExitStack() as resources:
        path = Path(resources.enter_context(tempfile.TemporaryDirectory()) if folder is None else folder)
        opened = resources.enter_context(StudyFolder.open(path, resolved))
        resources.enter_context(executor)
        StudyRun(resolved, opened, executor, on_failure=on_failure, announce=_log.info, watch=watch).run()
        return study_table(path)


def _check_choice(name: str, value: str, choices: Collection[str]) -> None:
    if value not in choices:
        raise RaceError(f"{name}: expected {one_of([*choices])}, found {excerpt(value)}")


def _check_minimum(name: str, value: int, minimum: int) -> None:
    if value < minimum:
        raise SimulationError(f"{name}: expected at least {minimum}, found {value}")
