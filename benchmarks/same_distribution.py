"""Are the engine's short cuts equal in distribution to doing without them?

Robots that can touch nothing move by a formula, and Chipmunk makes 5 iterations, half its own number. The formula is
Chipmunk's motion but for rounding; fewer iterations change contacts a little; and further contacts amplify either: runs
part, and only distributions can agree. So experiments of the engine as it is are compared with others, of other seeds,
in which every robot is in Chipmunk's space in every cycle, with 10 iterations. The latter are the referee's
(`Simulator.run(referee=True)`, which is the engine to the last bit) with all robots marked as close.

For each crowd and statistic of a run, a Mann-Whitney and a Kolmogorov-Smirnov test; Benjamini and Hochberg's procedure
over all of them. Prints means, p, and what differences would have been found. Exit code 0: nothing is rejected; 1:
something is.

Run: python benchmarks/same_distribution.py [--experiments N] [--rate R] [--jobs N] [--seed S]
"""

import argparse
import dataclasses
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.engine import FSM
from benchmarks.two_samples import FALSE_DISCOVERIES, rejected
from mercator_design.fsm import Readings, parse
from mercator_design.jit import jittable
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.executor import available_jobs
from mercator_design.seeds import instance_seed
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import Swarm
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Outcome, Simulator
from mercator_design.studies.statistics.power import POWER, visible_shift
from mercator_design.studies.statistics.rank_tests import rank_sum

CHECKED = 4  # experiments in which the robots in the space are counted


@dataclass(frozen=True)
class Crowd:
    """Robots to compare: on a mission, changed, of a robot model."""

    robot_model: str
    mission: str
    overrides: tuple[str, ...]
    blind: bool = False  # to obstacles, which they then push
    fsm: str = FSM


CROWDS = {
    "3 robots, 60 s": Crowd("mercator", "grid_exploration", ("robots=3", "duration=60")),
    "20 robots, 20 s": Crowd(
        "mercator",
        "grid_exploration",
        ("robots=20", "duration=20", "arena.walls.apothem=2", "placement.radius=1.8", "objective.side=4"),
    ),
    "8 that push, the original's constants, 20 s": Crowd(
        "mercator-argos", "grid_exploration", ("robots=8", "duration=20"), blind=True
    ),
    "20 attracted, 20 s": Crowd(
        "mercator",
        "aggregation_20",
        ("duration=20", "arena.walls.apothem=2", "placement.radius=1.8", "floor.zones[0].radius=1.0"),
        fsm="--nstates 1 --s0 2 --att0 4",
    ),
    "20 discs, 20 s": Crowd(
        "epuck",
        "grid_exploration",
        ("robots=20", "duration=20", "arena.walls.apothem=0.4", "placement.radius=0.36", "objective.side=0.8"),
    ),
}


@cache
def simulator(crowd: Crowd, *, short_cuts: bool = True) -> Simulator:
    model = load_robot_model(crowd.robot_model)
    if not short_cuts:
        thorough = dataclasses.replace(model.physics, solver_iterations=10)
        model = dataclasses.replace(model, physics=thorough)
    if crowd.blind:
        constants = model.reference_model._replace(obstacle_threshold=2.0)
        model = dataclasses.replace(model, reference_model=constants)
    return Simulator(load_mission(crowd.mission, crowd.overrides), model)


Mark = Callable[[Scene, Swarm], int]  # in place of kernel.begin_motion


@jittable
def everybody_close(scene: Scene, swarm: Swarm) -> int:
    """`kernel.begin_motion`, with all robots in the space."""
    kernel.aim(scene, swarm)
    for i in range(len(swarm.poses)):
        swarm.close[i] = True
        for k in range(3):
            swarm.former[i, k] = swarm.poses[i, k]
    return 0


def statistics(outcome: Outcome) -> dict[str, float]:
    """Of a recorded run: averages over robots and cycles, unless said."""
    scene, model = outcome.recording.scene, outcome.recording.robot_model
    poses, readings = outcome.trace.poses, outcome.history.readings
    places = poses[..., :2]
    steps = np.diff(poses, axis=0)
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    nearest = (apart + np.diag(np.full(poses.shape[1], math.inf))).min(axis=2)
    to_walls = np.einsum("tnwk,wk->tnw", places[:, :, None] - scene.walls[:, :2], scene.walls[:, 4:6]).min(axis=2)
    x, y = (readings[..., Readings._fields.index(f"proximity_{axis}")] for axis in "xy")
    ahead = (np.hypot(x, y) >= model.reference_model.obstacle_threshold) & (x >= 0.0)
    found = {
        "score": outcome.score,
        "path [m]": np.hypot(steps[..., 0], steps[..., 1]).sum(axis=0).mean(),
        "turned [rad]": np.abs(steps[..., 2]).sum(axis=0).mean(),
        "nearest robot [m]": nearest.mean(),
        "the least of that [m]": nearest.min(),
        "perhaps at a robot": (nearest < scene.half_width + scene.corner).mean(),
        "perhaps at a wall": (to_walls < scene.corner).mean(),
        "obstacle in front": ahead.mean(),
        "changes of state": (np.diff(outcome.trace.states, axis=0) != 0).mean(),
    }
    return {name: float(value) for name, value in found.items()}


def as_it_is(crowd: Crowd, seed: int) -> dict[str, float]:
    """A run of the engine."""
    return statistics(simulator(crowd).run(parse(crowd.fsm), seed, record=True))


def marked(crowd: Crowd, seed: int, mark: Mark = everybody_close) -> dict[str, float]:
    """A run without short cuts, in which others than the engine's robots are in the space."""
    with patch.object(kernel, "begin_motion", mark):
        return statistics(simulator(crowd, short_cuts=False).run(parse(crowd.fsm), seed, record=True, referee=True))


def in_the_space(crowd: Crowd, seed: int) -> float:
    """The fraction of robot-cycles of a run of the engine at whose end a robot is in Chipmunk's space."""
    close: list[float] = []
    move = Referee.move

    def noted(referee: Referee) -> None:
        move(referee)
        close.append(float(referee.swarm.close.mean()))

    with patch.object(Referee, "move", noted):
        simulator(crowd).run(parse(crowd.fsm), seed, referee=True)
    return float(np.mean(close))


@contextmanager
def mapping(jobs: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """A `map` in processes, as the referee is Python; of one job in this process."""
    if jobs == 1:
        yield map
        return
    # Started anew, as threads of libraries do not survive a fork.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        yield partial(pool.map, chunksize=10)


def compare(
    experiments: int,
    *,
    rate: float,
    jobs: int,
    seed: int,
    crowds: Sequence[str] = tuple(CROWDS),
    mark: Mark = everybody_close,
) -> bool:
    """Run, print, and say whether nothing is rejected."""
    from scipy.stats import ks_2samp

    found, ps = [], []
    seeds = {way: [instance_seed(seed, way, k) for k in range(experiments)] for way in ("engine", "without short cuts")}
    with mapping(jobs) as run:
        for name in crowds:
            crowd = CROWDS[name]
            engine = run(partial(as_it_is, crowd), seeds["engine"])
            other = run(partial(marked, crowd, mark=mark), seeds["without short cuts"])
            share = np.mean([*run(partial(in_the_space, crowd), seeds["engine"][:CHECKED])])
            rows, other_rows = list(engine), list(other)
            for statistic in rows[0]:
                ours, theirs = (np.array([row[statistic] for row in way]) for way in (rows, other_rows))
                found.append((f"{name} ({share:.0%})", statistic, ours, theirs))
                ps += [rank_sum(ours, theirs), float(ks_2samp(ours, theirs).pvalue)]
    print(
        "| robots (of them in the space) | statistic | engine | without short cuts | apart [sd] | Mann-Whitney | K-S |"
    )
    print("|---|---|---|---|---|---|---|")
    for (name, statistic, ours, theirs), rank, shape in zip(found, ps[::2], ps[1::2], strict=True):
        sd = math.sqrt(0.5 * (ours.var() + theirs.var()))
        apart = f"{(ours.mean() - theirs.mean()) / sd:+.3f}" if sd else "-"
        cells = [name, statistic, f"{ours.mean():.5g}", f"{theirs.mean():.5g}", apart, f"{rank:.2g}", f"{shape:.2g}"]
        print(f"| {' | '.join(cells)} |")
    tests = len(ps)
    wrong = rejected(ps, rate)
    distance = math.sqrt(-math.log(0.5 * rate / tests) / experiments)
    print(f"\n{experiments} experiments of each way and crowd, other seeds for each; {tests} tests.")
    print(f"{'NOT reached' if wrong else 'reached'}: {len(wrong)} reject; Benjamini-Hochberg at {rate:g}")
    shift = visible_shift(experiments, experiments, rate / tests)
    print(f"could have told, with probability {POWER:g}: means of one statistic {shift:.2f} sd apart;")
    print(f"distribution functions are rejected from {distance:.3f} apart")
    return not wrong


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=2000, help="of each way, for each crowd")
    parser.add_argument("--rate", type=float, default=FALSE_DISCOVERIES, help="chance to reject where nothing differs")
    parser.add_argument("-j", "--jobs", type=int, default=available_jobs(), help="processes")
    parser.add_argument("--seed", type=int, default=1, help="master seed")
    given = parser.parse_args(arguments)
    return int(not compare(given.experiments, rate=given.rate, jobs=given.jobs, seed=given.seed))


if __name__ == "__main__":
    sys.exit(main())
