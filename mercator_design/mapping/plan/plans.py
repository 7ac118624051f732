"""The maps of a swarm: for each group of robots in one frame, their ways, cells, pieces of walls and lines."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping.plan.occupancy import RESOLUTION, OccupancyGrid, occupancy_of
from mercator_design.mapping.plan.pieces import Looks, lines_of, looks_at, pieces_of
from mercator_design.mapping.plan.ways import Way, match_all
from mercator_design.mapping.swarm import Report, SwarmMap
from mercator_design.mapping.track import Track
from mercator_design.sim.robot_model import load_robot_model

MIN_LAG = 0.005
"""Seconds of lag of a lidar's times that are worth a message."""

MIN_GAP = 5.0
"""Seconds without a turn that are worth a message."""

_MAX_LISTED = 5  # moments in a sentence
_SCANTY = 0.5  # of the turns of a log without walls, from which on the walls may be lower than the lidar


@dataclass(frozen=True)
class Plan:
    """The map of robots whose frames are known to each other."""

    ways: tuple[Way, ...]  # in the frame of the map
    occupancy: OccupancyGrid
    pieces: Floats  # (n, 5) of walls: mean x, y [m], unit normal x, y, weight
    lines: Floats  # (m, 4) walls: x, y [m] of both ends
    looks: Looks  # at the pieces


def plans_of(swarm: SwarmMap, resolution: float = RESOLUTION, report: Report | None = None) -> list[Plan]:
    """The maps of a swarm, that of most robots first.

    Args:
        swarm: Keyframes in common frames.
        resolution: [m] of the cells.
        report: Called as the work goes on.
    """
    say = report or (lambda _stage, _share: None)
    of_maps = [_ways(swarm, number) for number in range(swarm.n_maps)]
    turns = [len(way.turns) for ways in of_maps for way in ways]
    done = itertools.accumulate(turns)
    found = []
    for ways in of_maps:
        matched = match_all(ways, lambda _: say("all turns", next(done) / sum(turns)))
        pieces = pieces_of(matched)
        grid, looks = occupancy_of(matched, resolution), looks_at(pieces, matched)
        found.append(Plan(tuple(matched), grid, pieces, lines_of(pieces), looks))
    return found


def _ways(swarm: SwarmMap, number: int) -> list[Way]:
    """The ways in one map: one of each robot, or of each of its segments there."""
    found = []
    for k, turns in swarm.turns_of(number):
        track = swarm.tracks[k]
        for segment in np.unique(track.segments[turns]).tolist():
            own = turns[track.segments[turns] == segment]
            name = track.log.name + (f" (part {segment + 1})" if track.n_segments > 1 else "")
            keyframes = np.flatnonzero(track.keyframes.segments == segment)
            offset = float(swarm.offsets[k][segment])
            is_known = not math.isnan(offset)
            found.append(
                Way(
                    *(name, track, own, track.times[own], track.poses[own], np.zeros(len(own))),
                    *(keyframes, swarm.furniture[k], swarm.covariances[k][keyframes]),
                    *(swarm.frame_covariances[k][segment], offset if is_known else 0.0, is_known),
                )
            )
    return found


def messages_of(tracks: Sequence[Track]) -> list[str]:
    """Sentences on single robots that a reader of their map should know."""
    said = []
    for track in tracks:
        name, log = track.log.name, track.log
        said += [f"{name}: {note}" for note in log.notes]
        if len(log.turns) > 1 and all(turn.times[0] == turn.times[-1] for turn in log.turns):
            said.append(f"{name}: all beams of a turn have one time; where the robot turned, its map is distorted.")
        if not log.turns:
            said.append(f"{name}: its log has no turns of a lidar.")
        elif len(log.turns) > 1 and np.mean(track.shares[1:] == 0.0) > _SCANTY:
            lidar = load_robot_model("mercator").lidar
            what = "are they lower than the lidar" + (f" (Mercator's: {lidar.height:g} m)?" if lidar else "?")
            said.append(f"{name}: most turns of its lidar saw no walls; {what}")
        if track.n_segments > 1:
            first = [int(np.flatnonzero(track.segments == number)[0]) for number in range(1, track.n_segments)]
            moments = listed([f"{track.times[k] - track.times[0]:.1f}" for k in first])
            said.append(f"{name} was lost {moments} s after its first turn: carried, or its odometry was wrong.")
        if abs(track.lag) > MIN_LAG:
            side = "late" if track.lag < 0.0 else "early"
            said.append(f"{name}: the times of its lidar are {abs(track.lag):.3f} s {side}; this is corrected.")
        gaps = np.diff(track.times)
        long = np.flatnonzero(gaps > max(MIN_GAP, 5.0 * float(np.median([*gaps, 0.0]))))
        if len(long):
            moments = listed([f"{gaps[k]:.1f} s, from {track.times[k] - track.times[0]:.1f} s on" for k in long])
            said.append(f"{name}: no turn of its lidar for {moments}.")
    return said


def listed(words: Sequence[str]) -> str:
    """Words with commas; of many only the first ones, and how many more."""
    shown, more = words[:_MAX_LISTED], len(words) - _MAX_LISTED
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
