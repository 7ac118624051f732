"""Does the objective seen_walls rank control software as its maps do? Random and designed PFSMs, mapped.

In each arena, PFSMs drive a few robots, all from one place, for some time. Their score is the share of the walls that
lidars have seen; `mdesign map`, with the starts given, makes a map of their logs (drift, noise and lost beams of
mercator-drifting), whose occupied cells (5 cm) are compared with all walls: F1, and the error of the poses. Designed
are the winners of short races for the objective.

Rows are kept in --cache, a line each; a run that was stopped goes on. The table has Spearman's correlation with F1 in
each arena and over all (ranks within arenas), that of the mean turning with the error of the poses, and the
`turning_cost` that fits F1 best.

Run: python benchmarks/mapping_objective.py [--random 14] [--designed 3] [--robots 3] [--duration 60]
         [--cache FILE.jsonl]
"""

import argparse
import json
import sys
import time
from collections import deque
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import rankdata, spearmanr

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.designs import random_software
from benchmarks.mapping_truth import occupancy, pose_errors
from mercator_design import api
from mercator_design.mapping.merit.merits import merit_of
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.readers.simulation import logs_of
from mercator_design.mapping.swarm import map_swarm
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.architecture import Software
from mercator_design.sim.simulate import Simulator

ARENAS = ("map_rooms", "map_corridor", "map_hall")
TURNING_COSTS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)  # [s/rad]
CELL = 0.05  # [m]
BUDGET = 150


def mission_of(arena: str, robots: int, duration: float) -> Mission:
    overrides = [f"robots={robots}", f"duration={duration:g}", "robot_model=mercator-drifting"]
    return load_mission(arena, overrides)


@cache
def software(arena: str, robots: int, duration: float, kind: str, count: int) -> list[Software]:
    if kind == "random":
        return random_software("watermelon", count, ARENAS.index(arena) + 1)
    mission = mission_of(arena, robots, duration)
    races = [api.design(mission, budget=BUDGET, seed=seed, test_runs=0, jobs=1) for seed in range(1, count + 1)]
    for race in races:
        deque(race, maxlen=0)
    return [race.pfsm for race in races]


def row_of(arena: str, robots: int, duration: float, one: Software, seed: int) -> dict[str, Any]:
    mission = mission_of(arena, robots, duration)
    outcome = Simulator(mission).run(one, seed)
    trace = outcome.trace
    logs = [
        replace(log, start=log.truth[0]) for log in logs_of(outcome.recording, trace.walls) if log.truth is not None
    ]
    begin = time.process_time()
    found = map_swarm(logs, clock_search=0.0)
    merit = merit_of(plans_of(found)[0])
    if merit is None:
        raise ValueError(f"{arena}: expected the truth")
    turned = np.abs(np.diff(trace.poses[..., 2], axis=0)).mean() / trace.control_period
    begin_objective = time.process_time()
    score = mission.scored(trace).score
    return {
        "score": round(score, 5),
        "objective_ms": round(1e3 * (time.process_time() - begin_objective), 2),
        "turning": round(float(turned), 4),
        "maps": found.n_maps,
        **occupancy(merit)[f"{CELL:g}"],
        "error": pose_errors(merit.turns)["rmse"],
        "cpu": round(begin_objective - begin, 1),
    }


def known_rows(cache_file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in cache_file.read_text().splitlines()] if cache_file.exists() else []


def correlation(first: np.ndarray, second: np.ndarray, groups: np.ndarray) -> float:
    """Spearman's correlation, of ranks within groups, each of which counts by its size."""
    ranks = [
        [rankdata(values[groups == group]) / np.count_nonzero(groups == group) for group in np.unique(groups)]
        for values in (first, second)
    ]
    return float(np.corrcoef(np.concatenate(ranks[0]), np.concatenate(ranks[1]))[0, 1])


def table(rows: list[dict[str, Any]]) -> str:
    lines = []
    arenas = np.array([row["arena"] for row in rows])
    score, f1, turning, error = (np.array([row[key] for row in rows]) for key in ("score", "f1", "turning", "error"))
    for arena in np.unique(arenas):
        own = arenas == arena
        lines.append(
            f"{arena}: {own.sum()} PFSMs, F1 {f1[own].min():.3f} to {f1[own].max():.3f}, Spearman of seen_walls and F1 "
            f"{spearmanr(score[own], f1[own]).statistic:.3f}, of turning and error "
            f"{spearmanr(turning[own], error[own]).statistic:.3f}"
        )
    lines.append(f"all, ranks within arenas: {correlation(score, f1, arenas):.3f}")
    for cost in TURNING_COSTS:
        value = correlation(score * np.maximum(0.0, 1.0 - cost * turning), f1, arenas)
        lines.append(f"turning_cost {cost:g} s/rad: {value:.3f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--random", type=int, default=14, help="random PFSMs of each arena")
    parser.add_argument("--designed", type=int, default=3, help="winners of races in each arena")
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--duration", type=float, default=60.0, help="seconds")
    parser.add_argument("--cache", type=Path, default=Path(__file__).with_suffix(".jsonl"))
    given = parser.parse_args()
    known = known_rows(given.cache)
    counts = {"random": given.random, "designed": given.designed}
    for number in range(max(counts.values())):
        for arena in ARENAS:
            for kind, count in counts.items():
                key = {
                    "arena": arena,
                    "kind": kind,
                    "number": number,
                    "robots": given.robots,
                    "duration": given.duration,
                }
                if number >= count or any(key.items() <= row.items() for row in known):
                    continue
                one = software(arena, given.robots, given.duration, kind, count)[number]
                row = {**key, **row_of(arena, given.robots, given.duration, one, number + 1)}
                with given.cache.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                known.append(row)
                print(row, flush=True)
    print(table(known))


if __name__ == "__main__":
    main()
