"""Statistics of a swarm's behaviour in experiments, in addition to its score."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mercator_design.missions.objectives.scoring import Scored
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software
from mercator_design.race.executors.executor import in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.results.analysis.occupancy import occupancy
from mercator_design.sim.labels import floor_labels, label_of
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import part_names


@dataclass(frozen=True, slots=True, kw_only=True)
class SwarmStats:
    """Means over robots, cycles and experiments; None where the robot has no such sensor.

    states: The share of time in each state.
    transitions: Changes of state of a robot [1/s].
    ground: The share of time on each colour of the floor.
    neighbours: The number of neighbours that a robot perceives.
    obstacles: The share of time with an obstacle or robot so near that the proximity sensors make controllers avoid it.
    speed: Speed of a robot over the ground [m/s].
    """

    states: tuple[float, ...]
    transitions: float
    ground: Mapping[str, float]
    neighbours: float | None
    obstacles: float | None
    speed: float


def evaluate_with_stats(
    simulator: Simulator,
    pfsm: Software,
    seeds: Sequence[int],
    *,
    jobs: int | None = None,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
) -> tuple[Evaluation, SwarmStats]:
    """As `api.evaluate`, with statistics of the swarm; the experiments are recorded, which takes longer."""
    with ThreadExecutor(jobs) as executor:
        found = in_order(executor, partial(_observed, simulator, pfsm), seeds, watch)
    evaluation = Evaluation.of(simulator.mission, [scored for scored, _ in found], seeds)
    return evaluation, _mean([stats for _, stats in found])


def _observed(simulator: Simulator, pfsm: Software, seed: int) -> tuple[Scored, SwarmStats]:
    """The scores of one experiment, and the statistics of the swarm in it."""
    outcome = simulator.run(pfsm, seed, record=True)
    trace, model = outcome.trace, outcome.recording.robot_model
    states = occupancy([trace], len(part_names(pfsm)))
    steps = np.linalg.norm(np.diff(trace.poses[..., :2], axis=0), axis=-1)
    return outcome.scored, SwarmStats(
        states=states.shares,
        transitions=sum(states.rates.values()),
        ground=_ground(simulator, trace),
        neighbours=None if model.neighbours is None else float(trace.measure("neighbours")[..., 0].mean()),
        obstacles=None if model.proximity is None else _share_in_sight(trace),
        speed=float(steps.mean()) / trace.control_period,
    )


def _ground(simulator: Simulator, trace: Trace) -> dict[str, float]:
    labels = floor_labels(simulator.mission.floor)
    colours, counts = np.unique(trace.colors("always").reshape(-1, 3), axis=0, return_counts=True)
    shares = dict.fromkeys(labels, 0.0)
    for colour, count in zip(colours, counts / counts.sum(), strict=True):
        shares[label_of(labels, tuple(colour))] += float(count)
    return {str(label): share for label, share in shares.items()}


def _share_in_sight(trace: Trace) -> float:
    """Sensors see further, but beyond the reference model's range an obstacle weighs nothing."""
    return float((trace.measure("proximity_weights") > 0).any(axis=-1).mean())


def _mean(of: Sequence[SwarmStats]) -> SwarmStats:
    """The mean over experiments, which all have the same numbers of cycles and robots."""

    def known(values: list[float | None]) -> float | None:
        numbers = [value for value in values if value is not None]
        return float(np.mean(numbers)) if numbers else None

    return SwarmStats(
        states=tuple(np.mean([one.states for one in of], axis=0).tolist()),
        transitions=float(np.mean([one.transitions for one in of])),
        ground={name: float(np.mean([one.ground[name] for one in of])) for name in of[0].ground},
        neighbours=known([one.neighbours for one in of]),
        obstacles=known([one.obstacles for one in of]),
        speed=float(np.mean([one.speed for one in of])),
    )
