"""Whether robots of the twin, without noise, decide and perceive what the simulator does.

`python benchmarks/twin_perception.py FOLDER` runs three robots there, each with a PFSM of its own, on a twin of
`aggregation`; of a folder that has their logs already, it only reads these. It prints, for each robot:

decisions   Of the cycles, in how many the simulator's compiled control cycle, given the log's readings and draws, goes
            through the same states and sets the same wheels, to the last bit.
perception  In how many the simulator senses what the robot did, at the poses that the twin's log has for the time at
            which each sensor measured.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.twin_runs import EARLY, Plan, Track, log_of_twin, play
from mercator_design.config.colours import COLOURS
from mercator_design.jit import compiled
from mercator_design.missions.mission import load_mission
from mercator_design.modules.perception import perceive, proximity_weight
from mercator_design.modules.reference import ACTIONS, ACTIVE, EVERYTHING, N_READINGS, Readings, ReferenceModel
from mercator_design.robot.devices.settings import Settings, nearest
from mercator_design.robot.logs.events import CycleDone, RunStarted
from mercator_design.robot.logs.log import controller_of, read
from mercator_design.sim.kernels.sensing import sense
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.simulate import Simulator, tables_of
from mercator_design.software.architectures import architecture_of
from mercator_design.twin.arena import without_noise

Floats: TypeAlias = NDArray[np.float64]

FSMS = (
    # Explore; wait on black, with others, or now and then; go on by chance or where there are too many.
    "--nstates 3 --s0 0 --rwm0 20 --n0 3 --n0x0 0 --c0x0 0 --p0x0 0.2 --n0x1 1 --c0x1 3 --p0x1 1 --w0x1 3 "
    "--n0x2 1 --c0x2 5 --p0x2 0.02 --s1 1 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.1 "
    "--s2 3 --rep2 3 --n2 2 --n2x0 0 --c2x0 4 --p2x0 1 --w2x0 3 --n2x1 1 --c2x1 0 --p2x1 0.1",
    # Come together, go apart.
    "--nstates 3 --s0 2 --att0 4 --n0 2 --n0x0 0 --c0x0 3 --p0x0 2 --w0x0 4 --n0x1 1 --c0x1 5 --p0x1 0.03 "
    "--s1 3 --rep1 5 --n1 2 --n1x0 0 --c1x0 4 --p1x0 1 --w1x0 5 --n1x1 1 --c1x1 1 --p1x1 0.02 "
    "--s2 0 --rwm2 8 --n2 1 --n2x0 0 --c2x0 1 --p2x0 0.05",
    # Explore, otherwise on gray than on black.
    "--nstates 4 --s0 0 --rwm0 50 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 1 --p0x1 0.02 "
    "--s1 0 --rwm1 3 --n1 2 --n1x0 0 --c1x0 1 --p1x0 0.3 --n1x1 2 --c1x1 5 --p1x1 0.05 "
    "--s2 2 --att2 2 --n2 2 --n2x0 0 --c2x0 5 --p2x0 0.1 --n2x1 1 --c2x1 0 --p2x1 0.5 "
    "--s3 1 --n3 2 --n3x0 0 --c3x0 4 --p3x0 2 --w3x0 2 --n3x1 2 --c3x1 2 --p3x1 0.5",
)
"""What the robots run: all modules that read the ground or neighbours, and chance."""

MISSION, SEED = "aggregation", 1
POSES = 0.01
"""[s] between the poses in the twin's log: its ticks, so whatever is measured is measured at one of them."""
_HALF_A_TURN = 0.07  # [s] of the lidar: how old its ranges are, on the whole
_TITLES = (
    *("robot", "cycles", "changes of state", "states equal", "wheels equal"),
    *("ground equal", "neighbours equal", "proximity equal", "median off", "99 % off by less"),
)


def run(folder: Path, seconds: float) -> None:
    """Run the robots, and leave their logs run0.jsonl, ... and the twin's in a folder."""
    overrides = (f"robots={len(FSMS)}", f"control_period={POSES}")
    play(Plan(MISSION, overrides, SEED, tuple(f"{fsm}\n" for fsm in FSMS), seconds, ("--no-noise",)), folder)


class Decisions(NamedTuple):
    """In how many cycles the simulator decides the same."""

    cycles: int
    states: int
    wheels: int
    changes: int  # of the state


def decisions(log: Path) -> Decisions:
    """What the simulator's compiled control cycle makes of the readings and draws of a log."""
    start, *events = read(log)
    assert isinstance(start, RunStarted)  # noqa: S101
    tables = tables_of(controller_of(start).software)
    model, cycle = tables.flavour.reference_model(start.reference_model), compiled(architecture_of(start.flavour).cycle)
    memory, actions = np.zeros(tables.memory), np.zeros(ACTIONS)
    cycles = [event for event in events if isinstance(event, CycleDone)]
    states = wheels = changes = 0
    for event in cycles:
        was = int(memory[ACTIVE])
        cycle(model, tables.program, Readings(*event.readings), memory, np.array(event.draws), actions)
        states += (was, int(memory[ACTIVE])) == (event.state, event.next_state)
        wheels += tuple(actions[:2]) == event.wheels
        changes += event.state != event.next_state
    return Decisions(len(cycles), states, wheels, changes)


class Perception(NamedTuple):
    """In how many cycles the simulator senses the same.

    neighbours: As many.
    proximity: A vector as near as the hub's millimetres allow. That of the distances when they came: in the readings it
        is turned by what the robot has turned since, and of the same length.
    differences: (cycles,) lengths of the vectors' differences.
    """

    cycles: int
    ground: int
    neighbours: int
    proximity: int
    differences: Floats


def perception(folder: Path, robot: int) -> Perception:
    """What the simulator senses at the poses that the twin's log has, against what a robot perceived there."""
    track = Track(log_of_twin(folder))
    start, *events = read(folder / f"run{robot}.jsonl")
    senses = Senses(without_noise(load_robot_model("mercator")), track.robots)
    assert isinstance(start, RunStarted)  # noqa: S101
    labels = Settings().labels_of(start.header or {})
    began = datetime.fromisoformat(start.time).timestamp() - track.start
    ground, neighbours, proximity, differences = 0, 0, 0, []
    for event in events:
        if not isinstance(event, CycleDone):
            continue
        now, found, sensed = began + event.time, Readings(*event.readings), event.sensed
        perceived = [senses(poses, robot) for poses in track.around(now - (sensed["ground"][0] or 0.0))]
        colours = [COLOURS[nearest(labels, (at.ground_red, at.ground_green, at.ground_blue))] for at in perceived]
        ground += (found.ground_red, found.ground_green, found.ground_blue) in colours
        *_, then = track.around(now - _HALF_A_TURN - EARLY)
        neighbours += senses(then, robot).neighbours == found.neighbours
        age, *distances = sensed["proximity"]
        x, y = obstacles(start.reference_model, distances)
        perceived = [senses(poses, robot) for poses in track.around(now - (age or 0.0))]
        off = min(math.hypot(at.proximity_x - x, at.proximity_y - y) for at in perceived)
        is_same_length = math.isclose(math.hypot(x, y), math.hypot(found.proximity_x, found.proximity_y), abs_tol=1e-9)
        proximity += off <= quantisation(start.reference_model, distances) and is_same_length
        differences.append(off)
    return Perception(len(differences), ground, neighbours, proximity, np.array(differences))


def obstacles(model: ReferenceModel, distances: Sequence[float | None]) -> tuple[float, float]:
    """The proximity vector of distances [m] as a log has them: none where nothing is in sight."""
    angles = Settings().proximity_angles
    weights = [proximity_weight(model, math.inf if each is None else each) for each in distances]
    looks = [math.cos(angle) for angle in angles], [math.sin(angle) for angle in angles]
    found = perceive(model, weights, *looks, (), (), (), 0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0), [0.0] * N_READINGS)
    return found.proximity_x, found.proximity_y


def quantisation(model: ReferenceModel, distances: list[float | None]) -> float:
    """By how much a proximity vector may differ as distances are of whole millimetres."""
    half = 0.0005
    nearest_ = [max(d - half, model.proximity_near) for d in distances if d is not None]
    slopes = [model.proximity_inverse / (d * d) for d in nearest_ if d <= model.proximity_range]
    return half * sum(slopes) + 1e-6  # and the poses have six digits


class Senses:
    """What robots perceive, by the simulator."""

    def __init__(self, model: RobotModel, robots: int) -> None:
        self._model = model.reference_model
        mission = load_mission(MISSION, [f"robots={robots}"])
        self._instance = Simulator(mission, model).instance(SEED)

    def __call__(self, poses: Floats, robot: int) -> Readings:
        """What a robot perceives where robots are at poses (robots, 3)."""
        scene, swarm = self._instance.scene, self._instance.swarm
        swarm.poses[:] = np.column_stack([poses, np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        found: Readings = compiled(sense)(scene, self._model, swarm, 0, robot, EVERYTHING)
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0, help="of a run")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if not (options.folder / "run0.jsonl").exists():
        run(options.folder, options.seconds)
    print(f"| {' | '.join(_TITLES)} |\n{len(_TITLES) * '|---'}|")
    for robot in range(len(FSMS)):
        decided, seen = decisions(options.folder / f"run{robot}.jsonl"), perception(options.folder, robot)
        half, most = np.quantile(seen.differences, [0.5, 0.99])
        row = [str(number) for number in (robot, decided.cycles, decided.changes)]
        row += [f"{100.0 * same / decided.cycles:.2f} %" for same in (decided.states, decided.wheels)]
        row += [f"{100.0 * same / seen.cycles:.1f} %" for same in (seen.ground, seen.neighbours, seen.proximity)]
        print(f"| {' | '.join(row)} | {half:.4f} | {most:.4f} |")


if __name__ == "__main__":
    main()
