"""Whole runs of the original from nothing but their seed: our simulator, its random numbers.

All of the original's draws follow from the seed of a run, and which draw serves what is known:

* ARGoS makes one Mersenne Twister from the seed, whose numbers are the seeds of all others: the second is the first
  robot's, the third the second's, ..., and the one after the last robot's is the loop function's.
* The loop function places the robots, one by one: a triple of draws is a place on the disc and a heading, and is passed
  over where a robot would touch a wall, another one, or one that still waits where the mission file put it. Then it
  deals the coloured tiles.
* A robot draws how long exploration turns, and for each condition that is tested, if it looks at the floor only where
  the floor is right.
* The order in which conditions are tested comes from the C library's `rand()`, which nobody seeds: all runs of the
  original shuffle alike.
"""

import math

import numpy as np

from mercator_design.errors import SimulationError
from mercator_design.fsm import Pfsm
from mercator_design.fsm.control import CYCLES, STATE, control_cycle
from mercator_design.fsm.pfsm import MEMORY, Program
from mercator_design.jit import compiled, jittable
from mercator_design.missions.floor import Tiles
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.modules.behaviours import TURN_CYCLES
from mercator_design.modules.conditions import probability
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS
from mercator_design.modules.reference import EVERYTHING, SCRATCH, Readings, ReferenceModel
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.chipmunk import Bridge, Space, leave
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sensing import sense
from mercator_design.sim.kernels.swarm import History, Swarm, controlled, new_history
from mercator_design.sim.placing import first_free
from mercator_design.sim.simulate import Simulator, tables_of

HIGHEST = 2**32 - 1  # of a Mersenne Twister
RADIUS = 1.2  # [m] of the disc where robots start
MAX_TRIALS = 1000  # for a robot's place
TILES = [
    *((0.75, -0.25), (0.75, 0.25)),
    *((0.25, -0.75), (0.25, -0.25), (0.25, 0.25), (0.25, 0.75)),
    *((-0.25, -0.75), (-0.25, -0.25), (-0.25, 0.25), (-0.25, 0.75)),
    *((-0.75, -0.25), (-0.75, 0.25)),
]
TILE_COLOURS = ((0.0, 255.0, 0.0), (255.0, 0.0, 0.0), (255.0, 255.0, 0.0))

MAX_TRANSITIONS = 4  # of a state in the original's grammar
_EXPLORATION = BEHAVIOURS["exploration"].position
_LOOKS_FIRST = sum(
    1 << k for k, module in enumerate(CONDITIONS.values()) if module.name.split()[-1] in {"floor", "colour"}
)


def twister(seed: int) -> np.random.MT19937:
    """A Mersenne Twister as ARGoS makes it, which is as its inventors do."""
    generator = np.random.MT19937()
    generator._legacy_seeding(seed)  # noqa: SLF001 - numpy's own way to it is RandomState, which hides the raw numbers
    return generator


def twisters(seed: int, robots: int) -> tuple[list[np.random.MT19937], np.random.MT19937]:
    """Those of the robots, and that of the loop function."""
    drawn = twister(seed).random_raw(robots + 2).astype(float)
    seeds = (1.0 + drawn * (HIGHEST - 1) / HIGHEST).astype(np.int64).tolist()
    return [twister(one) for one in seeds[1:-1]], twister(seeds[-1])


def c_library_rand(n: int) -> np.ndarray:
    """What the GNU C library's rand() returns at first if nobody calls srand(): (n,)."""
    state = [1]
    for _ in range(30):
        state.append(16807 * state[-1] % (2**31 - 1))
    state += state[:3]
    while len(state) < 344 + n:
        state.append((state[-31] + state[-3]) % 2**32)
    return np.array(state[344:], dtype=np.int64) >> 1


def starts(scene: Scene, waiting: np.ndarray, generator: np.random.MT19937) -> np.ndarray:
    """Poses (robots, 3) where the loop function places the robots, of which it finds them waiting at (robots, 3)."""

    def places(poses: np.ndarray) -> np.ndarray:
        return np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2]), poses[:, 2]])

    placed = places(np.array(waiting, dtype=float))
    for i in range(len(placed)):
        others = np.delete(placed, i, axis=0)
        for _ in range(MAX_TRIALS):
            a, b, turn = generator.random_raw(3) / HIGHEST
            radius, angle = RADIUS * max(a, b), 2.0 * math.pi * min(a, b) / max(a, b)
            candidate = places(np.array([[radius * math.cos(angle), radius * math.sin(angle), 2.0 * math.pi * turn]]))
            if not compiled(first_free)(
                candidate, others, scene.walls, scene.boxes, scene.half_length, scene.half_width, False
            ):
                placed[i] = candidate
                break
        else:
            raise SimulationError("the original's robots do not fit")
    return placed[:, [0, 1, 4]]


def deal_tiles(zones: np.ndarray, generator: np.random.MT19937) -> None:
    """Colour the rows of a floor's tiles as the loop function does: four green, then four red, then four yellow."""
    left = list(TILES)
    for colour in TILE_COLOURS:
        for _ in range(4):
            x, y = left.pop(int(generator.random_raw() / HIGHEST * len(left)))
            zones[(zones[:, 1] == x) & (zones[:, 2] == y), 6:9] = colour


def set_scene(mission: Mission, scene: Scene, swarm: Swarm, generator: np.random.MT19937) -> None:
    """All that the loop function does before a run: robots to their places, colours to the tiles."""
    swarm.poses[:, :3] = starts(scene, np.array(mission.placement.waiting), generator)
    if any(isinstance(zone, Tiles) for zone in mission.floor.zones):
        deal_tiles(scene.floor.zones, generator)


@jittable
def draw(
    model: ReferenceModel,
    program: Program,
    readings: Readings,
    swarm: Swarm,
    i: int,
    order: np.ndarray,
    stream: np.ndarray,
    shuffles: np.ndarray,
    place: np.ndarray,
    certain: np.ndarray,
) -> None:
    """Set `swarm.draws` such that `control_cycle` decides with the original's numbers.

    Args:
        order: (robots, MAX_TRANSITIONS) of the state's conditions, as they were last shuffled; changed in place.
        stream: (robots, numbers) of the robots' twisters.
        shuffles: (numbers,) of rand().
        place: (robots + 1,) how many are used of each robot's, and of rand()'s; changed in place.
        certain: (parameters,) scratch.
    """
    state = int(swarm.memory[i, STATE])
    if program.behaviours.modules[state] == _EXPLORATION and swarm.memory[i, MEMORY + TURN_CYCLES] <= 0.0:
        x, y = readings.proximity_x, readings.proximity_y
        if x >= 0.0 and math.sqrt(x * x + y * y) >= model.obstacle_threshold:
            swarm.draws[0] = stream[i, place[i]] / HIGHEST
            place[i] += 1
    n = program.transitions[state + 1] - program.transitions[state]
    if swarm.memory[i, CYCLES] == 0.0:
        for k in range(n):
            order[i, k] = k
        return
    for k in range(1, n):
        j = shuffles[place[-1]] % (k + 1)
        place[-1] += 1
        order[i, k], order[i, j] = order[i, j], order[i, k]
    for k in range(n):
        ahead = 0  # how many that are not yet tested come before this one
        for j in range(k + 1, n):
            if order[i, j] < order[i, k]:
                ahead += 1
        swarm.draws[1 + 2 * k] = (ahead + 0.5) / (n - k)
        edge, tested = program.transitions[state] + order[i, k], program.conditions
        parameters, found = tested.parameters[tested.starts[edge] : tested.starts[edge + 1]], swarm.actions[i, SCRATCH:]
        probability(tested.modules[edge], model, readings, parameters, swarm.memory[i], found)
        p = found[0]
        fires = False
        # The original draws where the ground is as it should be, also if the probability there is 0.
        for j in range(1, len(parameters)):
            certain[j] = parameters[j]
        certain[0] = 1.0
        probability(tested.modules[edge], model, readings, certain[: len(parameters)], swarm.memory[i], found)
        if not _LOOKS_FIRST >> tested.modules[edge] & 1 or found[0] > 0.0:
            fires = stream[i, place[i]] < p * HIGHEST
            place[i] += 1
        swarm.draws[2 + 2 * k] = -1.0 if fires else 2.0  # below, or above, every probability
        if fires:
            return


@jittable
def rerun(
    bridge: Bridge,
    scene: Scene,
    model: ReferenceModel,
    program: Program,
    swarm: Swarm,
    history: History,
    order: np.ndarray,
    stream: np.ndarray,
    shuffles: np.ndarray,
    place: np.ndarray,
    certain: np.ndarray,
) -> None:
    """`kernel.experiment` with the original's draws."""
    kernel.note_poses(swarm, history, 0)
    for cycle in range(len(history.states)):
        kernel.move(bridge, scene, swarm)
        kernel.note_poses(swarm, history, cycle + 1)
        for i in range(len(swarm.poses)):
            readings = sense(scene, model, swarm, cycle, i, EVERYTHING)
            draw(model, program, readings, swarm, i, order, stream, shuffles, place, certain)
            wheels = swarm.actions[i]
            control_cycle(model, program, readings, swarm.memory[i], swarm.draws, wheels)
            history.states[cycle, i] = int(swarm.memory[i, STATE])
            for side in range(2):
                swarm.commands[i, side] = wheels[side] * scene.maximum_speed
                history.wheels[cycle, i, side] = wheels[side]
            for k in range(len(readings)):
                history.readings[cycle, i, k] = readings[k]
    for i in range(len(swarm.poses)):
        if swarm.held[i]:
            leave(bridge, i)
            swarm.held[i] = False


class Original:
    """Repeats runs of a mission with the original's random numbers; may be used by several threads at once."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self.mission = mission = simulator.mission
        self._shuffles = c_library_rand(mission.cycles * mission.robots * (MAX_TRANSITIONS - 1))

    def run(self, pfsm: Pfsm, seed: int) -> tuple[float, History]:
        """Score and full history of a run."""
        mission, model = self.mission, self._simulator.robot_model
        instance = self._simulator.instance(0)
        robots, loop = twisters(seed, mission.robots)
        tables, scene = tables_of(pfsm), instance.scene
        swarm = controlled(instance.swarm, memory=tables.memory, draws=tables.draws)
        set_scene(mission, scene, swarm, loop)
        history = new_history(mission.cycles, mission.robots, everything=True, draws=tables.draws)
        stream = np.array(
            [robot.random_raw(mission.cycles * tables.draws // 2 + mission.cycles) for robot in robots], float
        )
        space = Space(scene.physics, mission.robots)
        order = np.zeros((mission.robots, MAX_TRANSITIONS), dtype=np.int64)
        place = np.zeros(mission.robots + 1, dtype=np.int64)
        compiled(rerun)(
            space.bridge, scene, model.reference_model, tables.program, swarm, history, order, stream,
            self._shuffles, place, np.zeros(6),
        )  # fmt: skip
        trace = Trace(
            poses=history.poses,
            states=history.states,
            floor=scene.floor,
            zone_rows=instance.zone_rows,
            control_period=mission.control_period,
        )
        return mission.scored(trace).score, history
