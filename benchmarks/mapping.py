"""How right are the maps of a swarm? Simulated arenas, windows of logs, and two real logs, against the truth.

Arenas: each shipped arena for maps and seed, robots that explore for 600 s, with beams at their own times, drifting
odometry, lost beams and unknown starts (the robot model mercator-drifting). A row has the absolute error of all robots
together after one alignment (keyframes, all turns), the frames between robots, the offsets of clocks (the truth is 0),
the scales of odometry, the agreement of occupied cells with the walls, CPU time and memory of the mapper alone.

Windows: pairs of robots in short windows of these logs, mapped from nothing: how many pairs are joined, and are they
right? In half of the windows the second robot's log is of another time, so that the two never met; in a dodecagon and a
circle their maps fit in many ways.

Real: the corrected logs of Intel and CSAIL in the folder CARMEN names, with odometry made from the corrected poses
(distances 4 % too long, 1 degree/sqrt(m)), whole, and as three robots with unknown starts. Relations are those of all
pairs nearer than 2 m and at least 30 scans apart, 4000 at most. The truth is the result of another mapper.

Rows are kept in --cache, a line each; a run that was stopped goes on. mapping.jsonl has those of
docs/explanation/mapping.md.

Run: python benchmarks/mapping.py [--kinds arenas windows real] [--seeds 5] [--arenas NAME ...] [--duration 600]
         [--cache FILE.jsonl]
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.mapping_logs import CARMEN, carmen_robots, cut, explored, shifted
from benchmarks.mapping_truth import aligned, frame_error, occupancy, pose_errors, relation_errors
from mercator_design import seeds
from mercator_design.mapping.frames.joining import join
from mercator_design.mapping.front.lag import track_of
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.merit.merits import error_of, merit_of, relations
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.swarm import SwarmMap, map_swarm

ARENAS = ("map_empty_dodecagon", "map_rooms", "map_corridor", "map_hall", "map_dodecagon")
WINDOW_ARENAS = (*ARENAS, "circle")
WINDOWS, WINDOW_LENGTHS = 20, (20.0, 40.0, 80.0)
REAL = ("intel", "csail")
RIGHT = 0.15, 3.0
"""[m], [degrees] of the error of a frame that is right."""
MET = 100
"""Sightings of a pair that should be joined."""


class Peak:
    """The peak of this process's memory since some moment; Linux only."""

    def __init__(self) -> None:
        with Path("/proc/self/clear_refs").open("w") as file:
            file.write("5")
        self._before = self._read("VmRSS")

    def megabytes(self) -> float:
        """By how much the peak is above what was used at first."""
        return (self._read("VmHWM") - self._before) / 1024.0

    @staticmethod
    def _read(key: str) -> int:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith(key))


def robot_minutes(logs: list[RobotLog]) -> float:
    return sum(log.duration for log in logs) / 60.0


def megabytes(logs: list[RobotLog]) -> float:
    """Megabytes of the turns; arrays that several turns share count once."""
    columns = {id(column): column.nbytes for log in logs for turn in log.turns for column in turn}
    return sum(columns.values()) / 1e6


def arena_row(arena: str, seed: int, duration: float) -> dict[str, Any]:
    logs = explored(arena, seed, duration)
    plans_of(map_swarm([cut(log, 0.0, 20.0) for log in logs[:2]]))  # compiles all kernels
    stages: dict[str, float] = {}
    last = time.process_time()

    def note(stage: str, _share: float) -> None:
        nonlocal last
        now = time.process_time()
        stages[stage] = stages.get(stage, 0.0) + now - last
        last = now

    peak, begin = Peak(), time.process_time()
    found = map_swarm(logs, report=note)
    plan = plans_of(found, report=note)[0]
    cpu, memory = time.process_time() - begin, peak.megabytes()
    merit = merit_of(plan)
    if merit is None:
        raise ValueError(f"{arena}: expected the truth")
    return {
        "robots": len(logs),
        "maps": found.n_maps,
        "keyframes": pose_errors(merit.keyframes),
        "turns": pose_errors(merit.turns),
        "n_keyframes": sum(len(track.keyframes.turns) for track in found.tracks),
        "scales": [round(track.scale, 5) for track in found.tracks],
        "clocks": [round(float(offset), 5) for of_track in found.offsets for offset in of_track if np.isfinite(offset)],
        "lags": [round(track.lag, 5) for track in found.tracks],
        "links": links_of(found),
        "occupancy": occupancy(merit),
        "cpu": round(cpu, 2),
        "stages": {stage: round(seconds, 2) for stage, seconds in stages.items()},
        "cpu_minute": round(cpu / robot_minutes(logs), 3),
        "memory_minute": round((memory + megabytes(logs)) / robot_minutes(logs), 2),
        "messages": list(found.messages),
    }


def links_of(found: SwarmMap) -> list[dict[str, Any]]:
    """Each pair of robots: is there a link, how many sightings agree, and how wrong is the final frame between them?"""
    alignments = [aligned(track) for track in found.tracks]
    pairs = []
    for a, b in combinations(range(len(found.tracks)), 2):
        joined = bool(found.maps[a][0] == found.maps[b][0] >= 0)
        distance, angle = frame_error(found.tracks, alignments, a, b, np.zeros(3))
        link = next((one for one in found.links if {one.a, one.b} == {a, b} and one.source == "sightings"), None)
        pairs.append(
            {
                "pair": [a, b],
                "joined": joined,
                "distance": round(distance, 5) if joined else None,
                "degrees": round(angle, 4) if joined else None,
                "votes": link.votes if link else 0,
                "second": round(link.second, 3) if link else None,
                "share": round(link.evidence.share, 4) if link else None,
                "accepted": bool(link and link.is_accepted),
                "refusal": link.refusal if link else "",
            }
        )
    return pairs


def windows_row(arena: str, seed: int, duration: float) -> dict[str, Any]:
    logs = explored(arena, seed, duration)
    generator = seeds.generator(seed, f"windows {arena}")
    rows = []
    for number in range(WINDOWS):
        a, b = generator.choice(len(logs), 2, replace=False)
        length = WINDOW_LENGTHS[number % len(WINDOW_LENGTHS)]
        start = float(generator.uniform(0.0, duration - length))
        never_met = number % 2 == 1
        other = float(generator.uniform(0.0, duration - length))
        if never_met and abs(other - start) < 10.0:
            other = (start + 0.5 * duration) % (duration - length)
        second = cut(logs[b], other, length) if never_met else cut(logs[b], start, length)
        pair = [cut(logs[a], start, length), shifted(second, start - other) if never_met else second]
        rows.append({"length": length, "never_met": never_met, **window_of(pair)})
    return {"windows": rows}


def window_of(pair: list[RobotLog]) -> dict[str, Any]:
    """How two logs are joined, and whether that is right."""
    tracks = [track_of(log) for log in pair]
    joined = join(tracks)
    link = next((one for one in joined.links if one.is_accepted), None)
    sightings = next((one for one in joined.links if one.source == "sightings"), None)
    row: dict[str, Any] = {"joined": len(joined.components) == 1, "votes": sightings.votes if sightings else 0}
    if sightings and sightings.refusal:
        row["refusal"] = sightings.refusal
    if row["joined"] and link:
        alignments = [aligned(track) for track in tracks]
        distance, angle = frame_error(tracks, alignments, 0, 1, joined.components[0].frames[1])
        row |= {
            "source": link.source,
            "distance": round(distance, 4),
            "degrees": round(angle, 3),
            "right": distance < RIGHT[0] and angle < RIGHT[1],
            "clock": round(link.offset, 4),
        }
    return row


def real_row(log: str, seed: int, robots: int) -> dict[str, Any]:
    begin = time.process_time()
    logs = carmen_robots(log, seed, robots)
    found = map_swarm(logs, clock_search=0.0, seed=seed)
    ways = plans_of(found)[0].ways
    return {
        "robots": robots,
        "maps": found.n_maps,
        "relations": relation_errors(relations(ways, seed)),
        "turns": pose_errors(error_of(ways)),
        "scales": [round(track.scale, 5) for track in found.tracks],
        "cpu": round(time.process_time() - begin, 1),
        "messages": list(found.messages),
    }


def wanted(arguments: argparse.Namespace) -> Iterator[tuple[str, dict[str, Any], Any]]:
    """The rows, one seed of each arena first: the key of each, and the function that makes it."""
    for seed in range(1, arguments.seeds + 1):
        if "arenas" in arguments.kinds:
            for arena in arguments.arenas:
                key = {"kind": "arenas", "arena": arena, "seed": seed, "duration": arguments.duration}
                yield "arenas", key, lambda arena=arena, seed=seed: arena_row(arena, seed, arguments.duration)
        if "real" in arguments.kinds and os.environ.get(CARMEN) and seed <= 3:
            for log in REAL:
                for robots in (1, 3):
                    key = {"kind": "real", "log": log, "seed": seed, "robots": robots}
                    yield "real", key, lambda log=log, seed=seed, robots=robots: real_row(log, seed, robots)
        if "windows" in arguments.kinds:
            for arena in WINDOW_ARENAS:
                key = {"kind": "windows", "arena": arena, "seed": seed, "duration": arguments.duration}
                yield "windows", key, lambda arena=arena, seed=seed: windows_row(arena, seed, arguments.duration)


def known_rows(cache: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in cache.read_text().splitlines()] if cache.exists() else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--kinds", nargs="+", default=["arenas", "windows", "real"], choices=["arenas", "windows", "real"]
    )
    parser.add_argument("--arenas", nargs="+", default=list(ARENAS), choices=ARENAS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--cache", type=Path, default=Path(__file__).with_suffix(".jsonl"))
    arguments = parser.parse_args()
    known = known_rows(arguments.cache)
    for _, key, make in wanted(arguments):
        if not any(key.items() <= row.items() for row in known):
            row = {**key, **make()}
            with arguments.cache.open("a") as file:
                file.write(json.dumps(row) + "\n")
            known.append(row)
            print(summary(row), flush=True)
    print(table(known))


def summary(row: dict[str, Any]) -> str:
    if row["kind"] == "windows":
        return f"{row['arena']} {row['seed']}: {window_counts([row])}"
    if row["kind"] == "real":
        near = row["relations"]
        return f"{row['log']} {row['seed']} {row['robots']} robots: {near}, {row['maps']} maps, {row['cpu']} s"
    return (
        f"{row['arena']} {row['seed']}: keyframes {row['keyframes']}, turns {row['turns']}, {row['maps']} maps, "
        f"F1 {row['occupancy']}, {row['cpu_minute']} s and {row['memory_minute']} MB a robot-minute"
    )


def window_counts(rows: list[dict[str, Any]]) -> str:
    windows = [one for row in rows for one in row["windows"]]
    joined = [one for one in windows if one["joined"]]
    wrong = [one for one in joined if not one["right"]]
    met = [one for one in windows if one["votes"] >= MET and not one["never_met"]]
    right_of_met = sum(one["joined"] for one in met)
    return (
        f"{len(windows)} windows, {len(joined)} joined, {len(wrong)} wrong; in {len(met)} at least {MET} sightings "
        f"agree, {right_of_met} of these joined"
    )


def table(rows: list[dict[str, Any]]) -> str:
    """The worst row of each arena and log, in millimetres and degrees."""
    lines = []
    for arena in ARENAS:
        own = [row for row in rows if row["kind"] == "arenas" and row["arena"] == arena]
        if not own:
            continue
        frames = [pair for row in own for pair in row["links"]]
        right = [pair for pair in frames if pair["joined"]]
        scores = [f"{min(row['occupancy'][cell]['f1'] for row in own):.3f} ({cell} m)" for cell in ("0.05", "0.025")]
        figures = (
            f"keyframes {worst(own, 'keyframes', 'rmse')} mm, largest {worst(own, 'keyframes', 'largest')} mm",
            f"turns {worst(own, 'turns', 'rmse')} mm, yaw {worst(own, 'turns', 'yaw')} degrees",
            f"frames {max([1e3 * pair['distance'] for pair in right], default=0):.1f} mm",
            f"{max([pair['degrees'] for pair in right], default=0):.3f} degrees",
            f"joined {len(right)} of {len(frames)}",
            f"clocks {max(1e3 * abs(clock) for row in own for clock in row['clocks']):.1f} ms",
            f"F1 {', '.join(scores)}",
            f"{max(row['cpu_minute'] for row in own)} s a robot-minute",
            f"{max(row['memory_minute'] for row in own)} MB a robot-minute",
        )
        lines.append(f"{arena}, worst of {len(own)} seeds: " + "; ".join(figures))
    for log in REAL:
        for robots in (1, 3):
            own = [row for row in rows if row["kind"] == "real" and row["log"] == log and row["robots"] == robots]
            if own:
                near = ", ".join(
                    f"{row['relations']['metres']} m {row['relations']['degrees']}, {row['maps']} maps" for row in own
                )
                lines.append(f"{log}, {robots} robots, {len(own)} seeds: {near}")
    if windows := [row for row in rows if row["kind"] == "windows"]:
        lines.append(window_counts(windows))
    return "\n".join(lines)


def worst(rows: list[dict[str, Any]], what: str, figure: str) -> str:
    return f"{max(row[what][figure] for row in rows):.2f}"


if __name__ == "__main__":
    main()
