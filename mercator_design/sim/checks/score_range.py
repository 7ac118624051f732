"""Whether a score can differ: an objective is tried on artificial traces.

The robots of these traces jump: if a score stays the same although they are anywhere within reach, in any order, it
does not depend on them.
"""

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Objective
from mercator_design.missions.trace import Trace
from mercator_design.missions.zone_distance import border_points, distance_to
from mercator_design.seeds import generator
from mercator_design.sim.checks.reach import Reach

TRACES = 49
_CYCLES = 60
"""Maximum number of cycles of a trace; they are spread over the duration of the mission."""
_NEAR = 0.3
"""[m] around a place, for robots that keep together."""


def score_can_differ(mission: Mission, objective: Objective, reach: Reach) -> bool | None:
    """Whether two of TRACES traces have different scores; None if the objective cannot be tried on these."""
    rng = np.random.default_rng(0)
    floor = mission.realise_floor(generator(0, "floor"))
    everywhere = reach.centres(reach.reached)
    pools, zones = _pools(floor, reach), _zones(mission, objective, floor, reach)
    cycles = min(mission.cycles, _CYCLES)
    scores: set[float] = set()
    for number in range(TRACES):
        places = _places(rng, number, (cycles + 1, mission.robots), everywhere, pools, zones)
        trace = Trace(
            poses=np.dstack([places, rng.uniform(-np.pi, np.pi, places.shape[:2])]),
            states=rng.integers(4, size=(cycles, mission.robots)).astype(np.int8),
            floor=floor,
            zone_rows=mission.floor.zone_rows(),
            control_period=mission.duration / cycles,
        )
        try:
            scores.add(objective(trace))
        except MercatorError:  # it needs readings of devices, or is wrong; a run will show
            return None
        if len(scores) > 1:
            return True
    return False


def _pools(floor: FloorTable, reach: Reach) -> list[Floats]:
    """Places within reach (n, 2), in a list for each set of zones that has places of its own."""
    kinds = np.zeros(reach.reached.shape, dtype=np.uint64)
    weights = np.random.default_rng(1).integers(2**63, size=len(floor.zones), dtype=np.uint64)
    pools = []
    for row, weight in enumerate(weights):
        cells = reach.cells_of(floor, row)
        kinds[cells] ^= weight
        if not (cells & reach.reached).any() and reach.is_reached(floor, row):
            pools.append(border_points(floor, row))  # it is smaller than a cell
        elif cells[reach.reached].all():
            corners = reach.corners(reach.reached)
            pools.append(corners[distance_to(floor, row, corners) > 0.0])  # all that it leaves is
    pools += [reach.centres(reach.reached & (kinds == kind)) for kind in np.unique(kinds[reach.reached])]
    return [pool for pool in pools if len(pool)]


def _zones(mission: Mission, objective: Objective, floor: FloorTable, reach: Reach) -> list[Floats]:
    """Places within reach (n, 2) in each zone that the objective names, if there are some."""
    zone_rows = mission.floor.zone_rows()
    pools = []
    for _, name in objective.zones():
        for row in zone_rows[name]:
            places = reach.centres(reach.cells_of(floor, row) & reach.reached)
            if not len(places) and reach.is_reached(floor, row):
                places = border_points(floor, row)
            pools.append(places)
    return [pool for pool in pools if len(pool)]


def _places(
    rng: np.random.Generator,
    number: int,
    shape: tuple[int, int],
    everywhere: Floats,
    pools: list[Floats],
    zones: list[Floats],
) -> Floats:
    """Positions of robots (cycles, robots, 2), in one of several ways."""
    way = number % 7
    cycles, robots = shape
    if way == 0:  # anywhere
        return np.asarray(rng.choice(everywhere, shape))
    if way == 1:  # at rest
        return np.broadcast_to(rng.choice(everywhere, robots), (*shape, 2)).copy()
    if way == 2:  # close together
        middle = rng.choice(everywhere)
        near = everywhere[np.hypot(*(everywhere - middle).T) <= _NEAR]
        return np.asarray(rng.choice(near, shape))
    time, robot = np.arange(cycles)[:, np.newaxis], np.arange(robots)
    if way == 6 and zones:
        pools = zones
    n = len(pools)
    if way == 3:  # in any set of zones
        which = rng.integers(n, size=shape)
    elif way == 4:  # all in the same, one after the other
        which = np.broadcast_to(rng.permutation(n)[time % n], shape)
    else:  # spread over all of them, or over the zones that count
        which = rng.permutation(n)[(robot + rng.integers(2) * time) % n] + np.zeros(shape, dtype=int)
    places = np.empty((*shape, 2))
    for k in np.unique(which):
        places[which == k] = rng.choice(pools[k], int(np.sum(which == k)))
    return places
