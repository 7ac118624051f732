"""Logs of simulated robots, with their true poses."""

import numpy as np

from mercator_design.mapping.logs import RobotLog, Turn
from mercator_design.missions.mission import Mission
from mercator_design.missions.walls import WallTable, open_pieces
from mercator_design.modules.architecture import Software
from mercator_design.sim.devices import Recording
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.turns import odometry_of, turns_of


def simulated_logs(
    mission: Mission, software: Software, seed: int, robot_model: RobotModel | None = None
) -> list[RobotLog]:
    """The log of each robot in one experiment, without the poses at which they start.

    Args:
        mission: The mission.
        software: The control software of every robot.
        seed: The seed of the experiment.
        robot_model: The robots; by default, those of the mission.

    Raises:
        FsmError, MissionError, SimulationError: as `Simulator.run`, `turns_of` and `odometry_of`.
    """
    outcome = Simulator(mission, robot_model).run(software, seed)
    return logs_of(outcome.recording, outcome.trace.walls)


def logs_of(recording: Recording, walls: WallTable | None = None) -> list[RobotLog]:
    """The log of each robot of an experiment; errors are those of `turns_of` and `odometry_of`.

    Args:
        recording: Of the experiment.
        walls: Those that lidars see; None: not known.
    """
    turns, odometry = turns_of(recording), odometry_of(recording)
    poses = recording.history.poses
    times = np.array([recording.control_period * k for k in range(len(poses))], dtype=float)
    return [
        RobotLog(
            name=f"robot {i}",
            turns=[
                Turn(start + turns.times, turns.angles, ranges)
                for start, ranges in zip(turns.starts[:, i], turns.ranges[:, i], strict=True)
            ],
            odometry_times=odometry.times[:, i],
            odometry=odometry.poses[:, i],
            truth_times=times,
            truth=poses[:, i],
            walls=None if walls is None else open_pieces(walls),
        )
        for i in range(poses.shape[1])
    ]
