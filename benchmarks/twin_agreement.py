"""Whether robots of the twin score as simulated ones do.

`python benchmarks/twin_agreement.py FOLDER` runs each PFSM of twin_missions.yaml in the simulator and, in real time, by
`mercator-robot run` on twins, from the same seeds: the same floors and starting places. The mission's own objective
scores where the robots were by the twin's log. For each mission it prints both means with 95 % confidence intervals, p
of the Mann-Whitney test, as it is and with Holm's correction over all missions, and the difference of means that would
have been found. Exit code 0: no mission differs at 1 %; 1: one does, or nothing is known of one.

Runs that the folder has already are not run again, so a measurement may be interrupted. Runs that were too late, as
the machine had other work, are left out, and how many is told. Several twins run at once, as many as `--at-once` robots
allow. `--list` tells how long all will take. With `--stepped` the robots' code runs in this process at the twin's own
time (twin_stepped.py): it is never late, however busy the machine is, but pseudo-terminals, threads and clocks of the
program are not part of the measurement.
"""

import argparse
import functools
import json
import math
import multiprocessing
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.twin_runs import Plan, RunError, Track, log_of_twin, play, twin_was_late
from benchmarks.twin_stepped import stepped_run
from mercator_design.api import evaluate
from mercator_design.designer import Designer
from mercator_design.fsm import Pfsm, parse
from mercator_design.missions.mission import load_mission
from mercator_design.missions.trace import Trace
from mercator_design.race.elimination.statistics import holm
from mercator_design.race.executors.executor import available_jobs
from mercator_design.robot.logs.events import CycleDone, RunStarted
from mercator_design.robot.logs.log import read
from mercator_design.sim.devices import Recording
from mercator_design.sim.kernels.swarm import new_history
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import fsm_file_text
from mercator_design.studies.statistics.power import POWER, visible_shift
from mercator_design.studies.statistics.rank_tests import rank_sum
from mercator_design.system.files import write_text
from mercator_design.twin.arena import TwinArena

Floats: TypeAlias = NDArray[np.float64]

MISSIONS: Mapping[str, Mapping[str, Any]] = yaml.safe_load(Path(__file__).with_name("twin_missions.yaml").read_text())
"""By name: `set`, what is changed of the mission, if anything; `fsm`."""
LEVEL = 0.01
"""Chance to find a difference on any mission if there is none."""
LATE_CYCLE = 0.02
"""[s] by which a control cycle that is late is longer than told."""
MAX_LATE_CYCLES = 0.01
"""Fraction of a run's control cycles beyond which the run is left out."""
LATE_TWIN = 0.2
"""[s] of a twin that was so late once, the run is left out."""
_STARTS = 12.0  # [s] that starting and ending a run takes, about
_RESULT, _POSES = "run.json", "poses.npy"


@dataclass(frozen=True)
class Case:
    """A mission with a PFSM, in the simulator."""

    name: str
    overrides: tuple[str, ...]
    pfsm: Pfsm
    simulator: Simulator

    @property
    def robots(self) -> int:
        return self.simulator.mission.robots

    @property
    def header(self) -> dict[str, str]:
        """Of fsm.txt, as a race writes it."""
        return Designer(self.simulator, budget=1000, seed=0).header()

    def plan(self, seed: int) -> Plan:
        """The run on a twin of a seed."""
        text = fsm_file_text(self.pfsm, self.header)
        return Plan(self.name, self.overrides, seed, (text,) * self.robots, self.simulator.mission.duration)


def case(name: str, duration: float | None = None) -> Case:
    """A mission of `MISSIONS`, perhaps of another duration [s]."""
    entry = MISSIONS[name]
    overrides = tuple(entry.get("set", ()))
    if duration is not None:
        kept = [override for override in overrides if not override.startswith("duration=")]
        overrides = (*kept, f"duration={duration:g}")
    return Case(name, overrides, parse(entry["fsm"]), Simulator(load_mission(name, overrides)))


@dataclass(frozen=True)
class Result:
    """What is kept of a run's logs.

    plan: What ran.
    failure: Why it did not run to its end; empty if it did.
    began: When each robot's first control cycle began [s since 1970].
    late: Fraction of control cycles that were late, of the robot of which most were.
    twin_late: How late the twin ever was [s].
    """

    plan: str
    failure: str
    began: tuple[float, ...] = ()
    late: float = math.nan
    twin_late: float = math.nan

    @property
    def why_left_out(self) -> str:
        """Why it does not count; empty if it does."""
        if self.failure:
            return "failed"
        return "late" if not (self.late <= MAX_LATE_CYCLES and self.twin_late <= LATE_TWIN) else ""


def found(plan: Plan, folder: Path) -> Result | None:
    """The result of a run that a folder has, if it has one.

    Raises:
        SystemExit: if it is of another run.
    """
    file = folder / _RESULT
    if not file.exists():
        return None
    data = json.loads(file.read_text())
    result = Result(**{**data, "began": tuple(data["began"])})
    if result.plan != repr(plan):
        raise SystemExit(f"{folder} has another run: expected {plan!r}, found {result.plan}")
    return result


def run(plan: Plan, folder: Path, *, keep: bool) -> Result:
    """Run a plan in real time, and note its result in the folder.

    Args:
        plan: To run.
        folder: For the twin's log and the result.
        keep: Whether the robots' logs are kept, too; a robot's is 1.5 MB a minute.
    """
    try:
        play(plan, folder)
        result = _result(plan, folder)
    except RunError as error:
        result = Result(repr(plan), str(error))
    if not keep:
        for log in folder.glob("run*.jsonl"):
            log.unlink()
    write_text(folder / _RESULT, json.dumps(result.__dict__))
    return result


def step(name: str, duration: float | None, seed: int, folder: Path) -> str:
    """Run a case without a clock, and note its result in the folder; what it was, in words."""
    what = case(name, duration)
    mission = what.simulator.mission
    arena = TwinArena(mission, what.simulator.robot_model, seed)
    poses = stepped_run(arena, what.pfsm, what.header, cycles=mission.cycles, seed=seed).poses
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / _POSES, poses)
    write_text(folder / _RESULT, json.dumps(Result(repr(what.plan(seed)), "", (), 0.0, 0.0).__dict__))
    return f"{name} {seed}"


def _result(plan: Plan, folder: Path) -> Result:
    """Of the logs that a run has left."""
    began, late = [], []
    for number in range(len(plan.fsms)):
        start, *events = read(folder / f"run{number}.jsonl")
        assert isinstance(start, RunStarted)  # noqa: S101
        times = np.array([event.time for event in events if isinstance(event, CycleDone)])
        began.append(datetime.fromisoformat(start.time).timestamp() + times[0])
        late.append(float(np.mean(np.diff(times) > (start.control_period or 0.0) + LATE_CYCLE)))
    return Result(repr(plan), "", tuple(began), max(late), twin_was_late((folder / "twin.txt").read_text()))


def score(case: Case, seed: int, result: Result, folder: Path) -> float:
    """The mission's score of a run on a twin."""
    poses = np.load(folder / _POSES) if (folder / _POSES).exists() else _poses(case, result.began, folder)
    return case.simulator.mission.scored(trace(case, seed, poses)).score


def _poses(case: Case, began: Sequence[float], folder: Path) -> Floats:
    """Where the robots were (cycles + 1, robots, 3), by the twin's log.

    In the simulator the robots sense for the first time at the end of the first cycle, in which they stand.
    """
    mission, track = case.simulator.mission, Track(log_of_twin(folder))
    times = min(began) - track.start + mission.control_period * np.arange(-1.0, mission.cycles)
    return track.at(times)


def trace(case: Case, seed: int, poses: Floats) -> Trace:
    """Where the robots of a run on a twin were (cycles + 1, robots, 3), as the simulator tells of an experiment.

    Raises:
        SystemExit: if they did not start where those of the simulator do.
    """
    mission, instance = case.simulator.mission, case.simulator.instance(seed)
    if not np.allclose(poses[0], instance.swarm.poses[:, :3], atol=1e-3):
        raise SystemExit(f"{case.name}, seed {seed}: the twin's robots did not start where the simulator's do")
    history = new_history(mission.cycles, mission.robots, everything=False)
    history.poses[:] = poses
    history.states[:] = 0  # no objective looks at them
    recording = Recording(
        instance.robot_model, instance.scene, history, instance.swarm.noise_keys, mission.control_period
    )
    return Trace(
        poses=history.poses,
        states=history.states,
        floor=instance.scene.floor,
        zone_rows=instance.zone_rows,
        control_period=mission.control_period,
        measure=recording.measure,
    )


class Room:
    """Keeps the number of robots that run at once below a limit."""

    def __init__(self, most: int) -> None:
        self._free, self._changed = most, threading.Condition()

    def with_robots(self, robots: int, do: Callable[[], None]) -> None:
        """Do something as soon as there is room for so many robots."""
        with self._changed:
            self._changed.wait_for(lambda: self._free >= robots)
            self._free -= robots
        try:
            do()
        finally:
            with self._changed:
                self._free += robots
                self._changed.notify_all()


def run_all(todo: Sequence[tuple[Case, int]], folder: Path, *, at_once: int, keep: bool) -> None:
    """Run cases of seeds in real time; tells on stderr as runs end."""
    room, done = Room(max(at_once, *(case.robots for case, _ in todo))), iter(range(1, len(todo) + 1))

    def one(case: Case, seed: int) -> None:
        result = run(case.plan(seed), folder / place(case, seed), keep=keep)
        why = result.failure or result.why_left_out
        print(f"{next(done)} of {len(todo)}: {case.name} {seed} {why}", file=sys.stderr)

    with ThreadPoolExecutor(max(1, at_once // min(case.robots for case, _ in todo))) as pool:
        jobs = [pool.submit(room.with_robots, case.robots, functools.partial(one, case, seed)) for case, seed in todo]
        for job in jobs:
            job.result()


def step_all(todo: Sequence[tuple[Case, int]], duration: float | None, folder: Path) -> None:
    """The same without a clock, in processes."""
    with ProcessPoolExecutor(available_jobs(), multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(step, case.name, duration, seed, folder / place(case, seed)) for case, seed in todo]
        for done, job in enumerate(as_completed(jobs), start=1):
            print(f"{done} of {len(todo)}: {job.result()}", file=sys.stderr)


def place(case: Case, seed: int) -> Path:
    """Of a run, in the folder of all."""
    return Path(case.name) / f"{seed:03}"


@dataclass(frozen=True)
class Comparison:
    """Scores of one case.

    simulated, twin: (experiments,), (runs,)
    left_out: Runs, by why.
    """

    case: Case
    simulated: Floats
    twin: Floats
    left_out: Mapping[str, int]

    @property
    def p(self) -> float:
        """Of the Mann-Whitney test; 1 if there is too little."""
        return rank_sum(self.simulated, self.twin) if len(self.twin) else 1.0

    def visible(self, tests: int) -> float:
        """The difference of means that the test finds with probability `POWER`, at `LEVEL` over so many tests."""
        if not len(self.twin):
            return math.inf
        return visible_shift(len(self.simulated), len(self.twin), LEVEL / tests) * float(self.simulated.std(ddof=1))


def compare(cases: Sequence[Case], seeds: Sequence[int], experiments: int, folder: Path) -> Iterator[Comparison]:
    """The scores of all runs in a folder, and of as many experiments, of these seeds and those that follow."""
    for case in cases:
        all_found = {seed: found(case.plan(seed), folder / place(case, seed)) for seed in seeds}
        results = {seed: result for seed, result in all_found.items() if result is not None}
        why = [result.why_left_out for result in results.values()]
        twin = [score(case, s, r, folder / place(case, s)) for s, r in results.items() if not r.why_left_out]
        more = range(seeds[0], seeds[0] + experiments)
        simulator = case.simulator
        evaluation = evaluate(simulator.mission, case.pfsm, seeds=more, robot_model=simulator.robot_model)
        simulated = evaluation.scores.values
        left_out = {reason: why.count(reason) for reason in sorted(set(why) - {""})}
        yield Comparison(case, np.array(simulated), np.array(twin), left_out)


def table(comparisons: Sequence[Comparison]) -> bool:
    """Print the comparisons; whether no mission differs."""
    tests = len(comparisons)
    adjusted = holm(np.array([each.p for each in comparisons]))
    columns = ("mission", "robots, s", "simulated", "twin", "difference", "p", "p, Holm", "would be found from")
    print(f"| {' | '.join(columns)} | runs left out |\n{(len(columns) + 1) * '|---'}|")
    for each, p in zip(comparisons, adjusted.tolist(), strict=True):
        mission = each.case.simulator.mission
        left_out = ", ".join(f"{count} {why}" for why, count in each.left_out.items()) or "0"
        apart = f"{each.twin.mean() - each.simulated.mean():+.3g}" if len(each.twin) else "-"
        cells = [each.case.name, f"{mission.robots}, {mission.duration:g}", _mean(each.simulated), _mean(each.twin)]
        cells += [apart, f"{each.p:.2g}", f"{p:.2g}{' **differs**' if p <= LEVEL else ''}"]
        print(f"| {' | '.join(cells)} | {each.visible(tests):.3g} | {left_out} |")
    differing = [each.case.name for each, p in zip(comparisons, adjusted.tolist(), strict=True) if p <= LEVEL]
    empty = [each.case.name for each in comparisons if not len(each.twin)]
    print(f"\n{tests} missions; Holm at {LEVEL:g}: {', '.join(differing) or 'none'} differ")
    if empty:
        print(f"nothing is known of {', '.join(empty)}: no run counts")
    print(f"would be found from: difference of means that a test finds with probability {POWER:g}")
    return not differing and not empty


def _mean(scores: Floats) -> str:
    """With the half width of its 95 % confidence interval, and of how many."""
    if len(scores) < 2:
        return f"- ({len(scores)})"
    from scipy.stats import t

    half = float(t.ppf(0.975, len(scores) - 1)) * scores.std(ddof=1) / math.sqrt(len(scores))
    return f"{scores.mean():.4g} ± {half:.2g} ({len(scores)})"


def seconds(cases: Sequence[Case], runs: int, at_once: int) -> float:
    """About how long all runs take [s]."""
    each = [case.robots * (case.simulator.mission.duration + _STARTS) for case in cases]
    return runs * sum(each) / at_once


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="for the runs on twins, each in a folder of its own")
    parser.add_argument("--missions", nargs="+", choices=[*MISSIONS], default=[*MISSIONS], metavar="MISSION")
    parser.add_argument("--runs", type=int, default=20, help="on the twin, of each mission")
    parser.add_argument("--experiments", type=int, default=400, help="in the simulator, of each mission")
    parser.add_argument("--duration", type=float, help="[s] of all, instead of the missions' own")
    parser.add_argument("--seed", type=int, default=1, help="the first")
    parser.add_argument("--at-once", type=int, default=16, help="robots that run at the same time")
    parser.add_argument("--stepped", action="store_true", help="the robots' code here, at the twin's own time")
    parser.add_argument("--keep", action="store_true", help="the logs of robots, too: 1.5 MB for each minute")
    parser.add_argument("--list", action="store_true", help="tell what would be run, and how long it takes")
    given = parser.parse_args(arguments)
    cases = [case(name, given.duration) for name in given.missions]
    seeds = range(given.seed, given.seed + given.runs)
    if given.list:
        for each in cases:
            print(each.name, *each.overrides)
        print(f"about {seconds(cases, given.runs, given.at_once) / 60.0:.0f} minutes")
        return 0
    for each in cases:
        each.simulator.rehearse(announce=print)
    places = [(each, seed, given.folder / place(each, seed)) for each in cases for seed in seeds]
    todo = [(each, seed) for each, seed, where in places if found(each.plan(seed), where) is None]
    if todo and given.stepped:
        step_all(todo, given.duration, given.folder)
    elif todo:
        run_all(todo, given.folder, at_once=given.at_once, keep=given.keep)
    return int(not table([*compare(cases, seeds, given.experiments, given.folder)]))


if __name__ == "__main__":
    sys.exit(main())
