"""Compare the simulator with recordings of the original: ARGoS3 with argos3-rvr and AutoMoDe-Watermelon.

Each FILE is gzip'd JSON of one of two kinds:

    traces   poses, wheel commands and sensor readings of every robot in every control cycle. Motion is replayed from
             the recorded start by the recorded commands; perception and behaviours are replayed at the recorded poses.
    scores   scores of many controllers on a mission over many seeds. Ours run with other seeds; means are compared by
             rank correlation, and each controller's two samples by the Mann-Whitney test (Benjamini-Hochberg at 1 %).

The robot model is `mercator-argos`. Run: python benchmarks/compare_argos.py FILE ... [--jobs N]
"""

import argparse
import dataclasses
import gzip
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mercator_design.design import evaluate
from mercator_design.errors import FsmError
from mercator_design.fsm import Pfsm, Readings, parse
from mercator_design.fsm.behaviours import TURN_CYCLES, TURN_SIDE
from mercator_design.fsm.control import MEMORY
from mercator_design.jit import compiled
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.race.executors import available_jobs
from mercator_design.sim.kernel import EVERYTHING
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.sensing import sense
from mercator_design.sim.sight import cast
from mercator_design.sim.simulate import Simulator, referee_motion
from mercator_design.sim.world import Instance, World

MISSIONS = {"aggregation": "aggregation", "color_aggregation": "color_aggregation", "coverage": "grid_exploration"}
RANGES = {"aggregation": 0.4, "color_aggregation": 0.4, "coverage": 0.3}  # [m] of proximity, as the mission files say
NEAR, BEYOND = -9.0, 9.0  # how a trace writes minus and plus infinity


def recorded_walls() -> str:
    """The original's twelve walls, whose places are rounded to millimetres: where their inner faces meet."""
    centers = [(1.231, 0), (1.066, 0.615), (0.615, 1.066), (0, 1.231), (-0.615, 1.066), (-1.066, 0.615)]
    centers += [(-x, -y) for x, y in centers]
    faces = []
    for number, (x, y) in enumerate(centers):
        normal = np.array([math.cos(number * math.pi / 6), math.sin(number * math.pi / 6)])
        faces.append((normal, normal @ (x, y) - 0.005))  # half a wall's thickness
    vertices = []
    for (normal, distance), (next_normal, next_distance) in zip(faces, [*faces[1:], faces[0]], strict=True):
        vertices.append(np.linalg.solve([normal, next_normal], [distance, next_distance]).tolist())
    return f"{{shape: polygon, vertices: {vertices}}}"


def robot_model(proximity_range: float) -> RobotModel:
    """The original's robot, with a mission file's proximity range; 0 is blind."""
    model = load_robot_model("mercator-argos")
    blind = {"obstacle_threshold": 2.0} if proximity_range == 0.0 else {}
    constants = model.reference_model._replace(proximity_range=max(proximity_range, 1e-3), **blind)
    return dataclasses.replace(model, reference_model=constants)


class Trace:
    """One recorded run as arrays: (cycles, robots, ...)."""

    def __init__(self, run: dict[str, Any]) -> None:
        self.name = run["name"]
        self.fsm = parse(run["fsm"], tolerate=lambda _: None)
        robots = list(run["robots"].values())
        self.poses = np.stack([np.column_stack([r["x"], r["y"], r["yaw"]]) for r in robots], axis=1)
        self.commands = np.stack([np.column_stack([r["vl"], r["vr"]]) for r in robots], axis=1) / 100.0
        self.states = np.column_stack([r["s0"] for r in robots])
        self.proximity = [[r["prox"][k] for r in robots] for k in range(len(self.poses))]
        self.vectors = np.stack([np.column_stack([r["pv"], r["pa"]]) for r in robots], axis=1)
        self.neighbours = np.column_stack([r["nn"] for r in robots])
        self.ground = np.stack([np.array(r["ground"]) for r in robots], axis=1)
        self.range = run["settings"].get("prox_range", RANGES[run["mission"]])
        overrides = [f"robots={len(robots)}", "duration=1"]
        walls = run["settings"].get("walls", True)
        overrides.append(f"arena.walls={recorded_walls()}" if walls else "arena.walls.apothem=100")
        mission = load_mission(MISSIONS[run["mission"]], overrides)
        self._world = World(mission, robot_model(self.range))
        self.model = self._world.robot_model.reference_model
        self.paints_tiles = bool(mission.floor.zones) and run["mission"] == "color_aggregation"

    def instance(self) -> Instance:
        """The recorded start."""
        instance = self._world.instance(0)
        instance.swarm.poses[:, :3] = self.poses[0]
        instance.swarm.poses[:, 3] = np.cos(self.poses[0, :, 2])
        instance.swarm.poses[:, 4] = np.sin(self.poses[0, :, 2])
        return instance


def replay_motion(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Errors of position [m] and heading [rad], (cycles, robots), when the recorded commands drive our robots."""
    instance = trace.instance()
    swarm = instance.swarm
    found = [swarm.poses[:, :3].copy()]
    for commands in trace.commands[:-1]:
        swarm.commands[:] = commands
        referee_motion(instance)
        swarm.poses[:, 3] = np.cos(swarm.poses[:, 2])
        swarm.poses[:, 4] = np.sin(swarm.poses[:, 2])
        found.append(swarm.poses[:, :3].copy())
    difference = np.array(found) - trace.poses
    turns = np.abs((difference[..., 2] + math.pi) % (2 * math.pi) - math.pi)
    return np.hypot(difference[..., 0], difference[..., 1]), turns


def replay_perception(trace: Trace) -> Iterator[tuple[int, int, Readings, np.ndarray]]:
    """For each recorded robot and cycle our readings there, and our eight distances."""
    instance = trace.instance()
    swarm = instance.swarm
    for cycle in range(len(trace.poses)):
        swarm.poses[:, :3] = trace.poses[cycle]
        swarm.poses[:, 3] = np.cos(trace.poses[cycle, :, 2])
        swarm.poses[:, 4] = np.sin(trace.poses[cycle, :, 2])
        for i in range(len(swarm.poses)):
            readings = compiled(sense)(instance.scene, trace.model, swarm, cycle, i, EVERYTHING)
            distances = np.empty(len(swarm.proximity))
            compiled(cast)(instance.scene, swarm.poses, i, trace.model.proximity_range, distances)
            yield cycle, i, readings, distances


def same_distance(recorded: float | None, ours: float, furthest: float) -> bool:
    """Whether a proximity reading agrees; poses are recorded to 1e-5, readings to 1e-4."""
    close = 2e-3
    if recorded is None or recorded == BEYOND:
        return ours > furthest - close
    if recorded == NEAR:
        return ours < 0.05 + close
    return abs(ours - recorded) < close or (math.isinf(ours) and recorded > furthest - close)


def agreements(trace: Trace) -> dict[str, tuple[int, int]]:
    """Agreed and all robot-cycles by kind of reading, and of wheel commands of the behaviours."""
    counts = {name: [0, 0] for name in ("proximity", "neighbours", "ground", "wheels")}

    def count(name: str, agreed: bool) -> None:
        counts[name][0] += agreed
        counts[name][1] += 1

    n = trace.poses.shape[1]
    memory = [[0.0] * MEMORY for _ in range(n)]
    for cycle, i, readings, distances in replay_perception(trace):
        recorded = trace.proximity[cycle][i]
        if trace.range > 0:
            pairs = zip(recorded, distances, strict=True)
            count("proximity", all(same_distance(a, b, trace.range) for a, b in pairs))
        count("neighbours", readings.neighbours == trace.neighbours[cycle, i])
        if not trace.paints_tiles:  # which tile has which colour is not recorded
            count("ground", readings[5:8] == tuple(trace.ground[cycle, i]))
        count("wheels", same_wheels(trace, cycle, i, readings, memory[i]))
    return {name: (agreed, total) for name, (agreed, total) in counts.items() if total}


def same_wheels(trace: Trace, cycle: int, i: int, readings: Readings, memory: list[float]) -> bool:
    """Whether the active behaviour, given our readings, commands what was recorded.

    Exploration draws how long it turns: it is given the draw that gives the recorded length.
    """
    number = trace.states[cycle, i]
    if cycle == 0 or number != trace.states[cycle - 1, i]:
        memory[TURN_CYCLES] = memory[TURN_SIDE] = 0.0
    state = trace.fsm.states[number]
    u = 0.0
    if state.behaviour == "exploration":
        turning = 0
        while (
            cycle + 1 + turning < len(trace.commands)
            and trace.states[cycle + 1 + turning, i] == number
            and trace.commands[cycle + 1 + turning, i].min() < 0
        ):
            turning += 1
        u = min(0.999999, (turning + 0.5) / max(1.0, state.parameters[0]))
    wheels = state.module.function(trace.model, readings, (*state.parameters, 0.0), memory, u)
    return bool(np.abs(np.array(wheels) * 0.3 - trace.commands[cycle, i]).max() < 2e-3)


def print_traces(runs: list[dict[str, Any]]) -> None:
    print("| run | robots | s | position: mean, max [mm] | heading: max [rad] | prox | neighbours | ground | wheels |")
    print("|---|---|---|---|---|---|---|---|---|")
    totals: dict[str, list[int]] = {}
    for run in runs:
        trace = Trace(run)
        position, heading = replay_motion(trace)
        cells = [trace.name, str(trace.poses.shape[1]), f"{len(trace.poses) / 10:g}"]
        cells += [f"{1e3 * position.mean():.3f}, {1e3 * position.max():.3f}", f"{heading.max():.5f}"]
        counts = agreements(trace)
        for name in ("proximity", "neighbours", "ground", "wheels"):
            agreed, total = counts.get(name, (0, 0))
            cells.append(f"{agreed}/{total}" if total else "-")
            all_of_kind = totals.setdefault(name, [0, 0])
            all_of_kind[0] += agreed
            all_of_kind[1] += total
        print(f"| {' | '.join(cells)} |", flush=True)
    for name, (agreed, total) in totals.items():
        print(f"{name}: {agreed} of {total} robot-cycles agree ({agreed / total:.3%})")


def score_missions(meta: dict[str, Any]) -> dict[str, tuple[Mission, RobotModel]]:
    """Mission and robot model of each name in a file of scores."""
    found = {}
    for name, given in meta["missions"].items():
        base = given["base"]
        if base == "coverage" and "velocity" not in given:
            continue  # as the original shipped it: no velocity is set, robots stand still, all scores are equal
        mission = load_mission(MISSIONS[base], [f"robots={given['n_robots']}"])
        found[name] = mission, robot_model(given.get("prox_range", RANGES[base]))
    return found


def print_scores(meta: dict[str, Any], runs: list[dict[str, Any]], jobs: int) -> None:
    from scipy.stats import mannwhitneyu, spearmanr

    print("| mission | controllers | mean, theirs | mean, ours | Spearman of means | smallest p | rejected (BH 1 %) |")
    print("|---|---|---|---|---|---|---|")
    for name, (mission, model) in score_missions(meta).items():
        simulator = Simulator(mission, model)
        theirs, ours, p = [], [], []
        for run in runs:
            if run["mission"] != name:
                continue
            try:
                fsm: Pfsm = parse(run["fsm"], tolerate=lambda _: None)
            except FsmError as error:
                print(f"refused: {run['name']}: {error}")
                continue
            recorded = run["scores"]
            found = evaluate(simulator, fsm, runs=4 * len(recorded), seed=1, jobs=jobs).scores.values
            theirs.append(np.mean(recorded))
            ours.append(np.mean(found))
            p.append(mannwhitneyu(recorded, found).pvalue if len({*recorded, *found}) > 1 else 1.0)
        if not theirs:
            continue
        ordered = np.sort(p)
        below = np.flatnonzero(ordered <= 0.01 * np.arange(1, len(p) + 1) / len(p))
        cells = [name, str(len(p)), f"{np.mean(theirs):.5g}", f"{np.mean(ours):.5g}"]
        cells += [f"{spearmanr(theirs, ours)[0]:.4f}", f"{ordered[0]:.2g}", str(below.max() + 1 if len(below) else 0)]
        print(f"| {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("-j", "--jobs", type=int, default=available_jobs())
    given = parser.parse_args()
    for file in given.files:
        data = json.loads(gzip.decompress(file.read_bytes()))
        if "robots" in data["runs"][0]:
            print_traces(data["runs"])
        else:
            print_scores(data["meta"], data["runs"], given.jobs)


if __name__ == "__main__":
    main()
