"""One simulated experiment, mapped: what the map of its logs is worth, beside the score of the objective."""

from typing import NamedTuple

from mercator_design.mapping.merit.merits import merit_of
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.readers.simulation import logs_of
from mercator_design.mapping.swarm import map_swarm
from mercator_design.modules.architecture import Software
from mercator_design.sim.simulate import Simulator


class MapTrial(NamedTuple):
    """The objective's score of an experiment, and figures of merit of the largest map of its logs."""

    score: float
    f1: float  # of occupied cells of 5 cm, against all walls that lidars can see
    fine_f1: float  # of cells of 2.5 cm
    coverage: float  # the share of these walls in the map
    error: float | None  # [m] rms of all turns' places, after one alignment; None of fewer than two turns
    yaw: float | None  # [rad] rms
    maps: int  # that the robots' logs gave


def map_trial(simulator: Simulator, software: Software, seed: int, *, known_starts: bool = False) -> MapTrial:
    """Simulate an experiment with the turns of its lidars, and map it as `mdesign map` does.

    Args:
        simulator: Of a mission whose walls lidars can see.
        software: Of every robot.
        seed: Of the instance, and of the map.
        known_starts: Whether the mapper knows where the robots begin.

    Raises:
        SimulationError: The robots lack a lidar or odometry, or the recording would be too large.
        FsmError, MissionError: as `Simulator.run`.
    """
    outcome = simulator.run(software, seed)
    logs = logs_of(outcome.recording, outcome.trace.walls)
    if known_starts:
        logs = [log.started(outcome.trace.poses[0, number]) for number, log in enumerate(logs)]
    plans = plans_of(map_swarm(logs, clock_search=0.0, seed=seed))
    merit = merit_of(plans[0], seed) if plans else None
    if merit is None or not merit.cells or merit.coverage is None:
        return MapTrial(outcome.score, 0.0, 0.0, 0.0, None, None, len(plans))
    coarse, fine = merit.cells
    turns = merit.turns
    error, yaw = (None, None) if turns is None else (turns.rmse, turns.yaw_rms)
    covered = float(merit.coverage.shares[-1])
    return MapTrial(outcome.score, coarse.f1, fine.f1, covered, error, yaw, len(plans))
