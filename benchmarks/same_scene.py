"""What a simulated robot and a robot of the twin perceive in the same scene, without noise.

`python benchmarks/same_scene.py` prints the figures of docs/explanation/twin.md. The robot's own code reads the bytes
of the twin's devices, at the twin's own time (twin_stepped.py). Where robots move, the simulator senses where they are
at the moment at which the robot perceives. It takes a minute.
"""

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.twin_stepped import Stepped, settings_of
from mercator_design.fsm import Actions, Readings, drive
from mercator_design.jit import compiled
from mercator_design.missions.mission import Mission, parse_mission
from mercator_design.modules.reference import EVERYTHING
from mercator_design.robot.devices.samples import heading
from mercator_design.robot.run.senses import Senses
from mercator_design.sim.kernels.sensing import sense
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.robot_parts import Neighbours
from mercator_design.sim.simulate import Simulator
from mercator_design.twin.arena import TwinArena, without_noise

Floats: TypeAlias = NDArray[np.float64]
Pose: TypeAlias = tuple[float, float, float]

MERCATOR: RobotModel = without_noise(load_robot_model("mercator"))
CAMERA = dataclasses.replace(MERCATOR, neighbours=Neighbours())
HALF = 4.0
"""[m] from the arena's middle to each of its four walls."""
BODY, SPEED = 0.143, 0.3
PERIOD, AFTER = 0.1, 0.037
"""[s] of control cycles; and when they begin, after the RVR has streamed."""
SENSES = ("proximity", "neighbours", "ground", "heading", "odometry", "ranges")

_MISSION = """
schema: 1
robots: {robots}
duration: 60
arena: {{walls: {{shape: regular_polygon, sides: 4, apothem: {half}}}, wall_height: {height}}}
floor:
  background: gray
  zones: [{{shape: half_plane, point: [0, 0], normal: [1, 0], color: black}}]
placement: {{shape: poses, poses: {poses}}}
objective: {{name: path_length, direction: maximise}}
"""


def mission(poses: Sequence[Pose], *, height: float = 0.08) -> Mission:
    """A square with walls of a height [m], black where x > 0, and robots at poses."""
    text = _MISSION.format(robots=len(poses), half=HALF, height=height, poses=[list(pose) for pose in poses])
    return parse_mission(text)


class World:
    """Robots in the same scene in both worlds.

    robots: On the twin.
    """

    def __init__(
        self,
        poses: Sequence[Pose],
        *,
        height: float = 0.08,
        model: RobotModel = MERCATOR,
        senses: Callable[..., Senses] = Senses,
    ) -> None:
        """Robots at poses, on the twin and in the simulator, where they may be of another model."""
        settings, scene = settings_of(MERCATOR), mission(poses, height=height)
        labels = settings.labels_of({"floor": "gray, black"})
        self.robots = Stepped(TwinArena(scene, MERCATOR, 1), lambda: senses(settings, SENSES, labels))
        self._model = model.reference_model
        self._instance = Simulator(scene, model).instance(1)

    def simulated(self, number: int = 0) -> Readings:
        """What a simulated robot perceives where those of the twin are."""
        swarm, poses = self._instance.swarm, self.robots.twin.arena.poses
        swarm.poses[:] = np.column_stack([poses, np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        found: Readings = compiled(sense)(self._instance.scene, self._model, swarm, 0, number, EVERYTHING)
        return Readings(*found)

    def perceived(self, number: int = 0) -> Readings:
        """What a robot of the twin perceives."""
        return self.robots.readings(number)


class Moment(NamedTuple):
    """A control cycle of robot 0, which drives."""

    simulated: Readings
    perceived: Readings
    pose: Floats
    ages: dict[str, float]


def driven(world: World, wheels: Sequence[Actions], seconds: float) -> Iterator[Moment]:
    """Drive each robot with wheels of its own, fractions of full speed."""
    begins = world.robots.now
    for cycle in range(round(seconds / PERIOD)):
        world.robots.until(begins + cycle * PERIOD + AFTER)
        now, senses = world.robots.now, world.robots.robots[0].senses
        ages = {name: now - sample.time for name, sample in senses.samples.items()}
        yield Moment(world.simulated(), world.perceived(), world.robots.twin.arena.poses[0].copy(), ages)
        for robot, each in zip(world.robots.robots, wheels, strict=True):
            robot.drive(each, SPEED, now)


class Unturned(Senses):
    """Senses for which what was seen in front stays in front, however the robot has turned since."""

    def readings(self, now: float) -> Readings:
        """As `Senses`."""
        self._faced = heading(self.samples, now)
        return super().readings(now)


def obstacle(readings: Readings) -> tuple[float, float]:
    """Length and angle [rad] of the proximity vector."""
    x, y = readings.proximity_x, readings.proximity_y
    return math.hypot(x, y), math.atan2(y, x)


def pull(readings: Readings) -> tuple[float, float]:
    """Length and angle [rad] of the vector to the neighbours."""
    x, y = readings.neighbours_x, readings.neighbours_y
    return math.hypot(x, y), math.atan2(y, x)


def angles_off(moments: Iterable[Moment], least: float = 0.02) -> list[float]:
    """By how much the direction of obstacles differs [rad], where both worlds perceive some."""
    found = []
    for moment in moments:
        (size, angle), (other, towards) = obstacle(moment.simulated), obstacle(moment.perceived)
        if min(size, other) > least:
            found.append(abs(math.remainder(angle - towards, math.tau)))
    return found


def motion_off(moments: Iterable[Moment]) -> Floats:
    """By how much heading [rad] and place [m] differ (cycles, 2)."""
    found = []
    for simulated, perceived, *_ in moments:
        turn = math.remainder(simulated.heading - perceived.heading, math.tau)
        x, y = simulated.odometry_x - perceived.odometry_x, simulated.odometry_y - perceived.odometry_y
        found.append((abs(turn), math.hypot(x, y)))
    return np.array(found)


def moved(wheels: Callable[[int], Actions], cycles: int) -> tuple[Floats, Floats]:
    """Where the same commands lead a robot (cycles, 3): in the simulator, and on the twin."""
    at_rest: Sequence[Pose] = [(0.0, 0.0, 0.0)]
    instance, world = Simulator(mission(at_rest), MERCATOR).instance(1), World(at_rest)
    swarm, simulated, twin = instance.swarm, [], []
    referee = Referee(instance.scene, swarm)
    begins = world.robots.now
    for cycle in range(cycles):
        swarm.poses[:, 3], swarm.poses[:, 4] = np.cos(swarm.poses[:, 2]), np.sin(swarm.poses[:, 2])
        swarm.commands[:] = SPEED * np.array(wheels(cycle)[:2])
        referee.move()
        simulated.append(swarm.poses[0, :3].copy())
        world.robots.robots[0].drive(wheels(cycle), SPEED, world.robots.now)
        world.robots.until(begins + (cycle + 1) * PERIOD)
        twin.append(world.robots.twin.arena.poses[0].copy())
    return np.array(simulated), np.array(twin)


def _still() -> None:
    print("| scene | simulator | robot |\n|---|---|---|")
    for distance in (0.02, 0.04, 0.05, 0.06, 0.2, 0.39, 0.41, 2.1):
        world = World([(HALF - BODY - distance, 0.0, 0.0)])
        sizes = [f"{obstacle(readings)[0]:.4f}" for readings in (world.simulated(), world.perceived())]
        print(f"| wall {distance:g} m ahead: proximity | {' | '.join(sizes)} |")
    print("\n| scene | by camera | by lidar | robot |\n|---|---|---|---|")
    for distance in (0.3, 0.5, 0.7, 0.74, 0.76, 0.77, 0.78, 0.79):
        _neighbours(f"one at {distance:g} m", [(0.0, 0.0, 0.0), (distance, 0.0, 0.0)])
    for off in (0, 4, 6, 8, 12):
        x, y = 0.7 * math.cos(math.radians(off)), 0.7 * math.sin(math.radians(off))
        _neighbours(f"at 0.35 m, and {off}° beside it at 0.7 m", [(0.0, 0.0, 0.0), (0.35, 0.0, 0.0), (x, y, 0.0)])
    for distance in (0.4, 0.7, 0.8):
        _neighbours(f"wall of 0.3 m, {distance:g} m away", [(HALF - distance, 0.0, 0.0)], height=0.3)


def _neighbours(scene: str, poses: Sequence[Pose], height: float = 0.08) -> None:
    by_camera, by_lidar = World(poses, height=height, model=CAMERA), World(poses, height=height)
    found = (by_camera.simulated(), by_lidar.simulated(), by_lidar.perceived())
    cells = [f"{readings.neighbours:g}, pull {pull(readings)[0]:.3f}" for readings in found]
    print(f"| {scene} | {' | '.join(cells)} |")


def _moving() -> None:
    columns = ("robot", "direction of obstacles: median, most", "in front: same", "neighbours: same", "bearing, most")
    print(f"\n| {' | '.join(columns)} |\n{len(columns) * '|---'}|")
    spin, curve = [drive(-1.0, 1.0)], [drive(-0.5, 0.6)]
    wall, others = [(HALF - 0.33, 0.0, 0.0)], [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (-0.3, 0.45, 0.0), (0.2, -0.6, 0.0)]
    rest, circles = drive(0.0, 0.0), [drive(0.5, 1.0), drive(1.0, 0.4), drive(0.8, 1.0)]
    for name, poses, wheels, senses in (
        ("spins by a wall, not told", wall, spin, Unturned),
        ("spins by a wall", wall, spin, Senses),
        ("turns by a wall, not told", wall, curve, Unturned),
        ("turns by a wall", wall, curve, Senses),
        ("spins among 3", others, [*spin, rest, rest, rest], Senses),
        ("stands among 3 that drive in circles", others, [rest, *circles], Senses),
    ):
        moments = [*driven(World(poses, senses=senses), wheels, 30.0)]
        off = [math.degrees(angle) for angle in angles_off(moments)]
        front = np.mean([in_front(moment.simulated) == in_front(moment.perceived) for moment in moments])
        same = [moment.simulated.neighbours == moment.perceived.neighbours for moment in moments]
        pairs = [(pull(m.simulated)[1], pull(m.perceived)[1]) for m in itertools.compress(moments, same)]
        most = max(abs(math.degrees(math.remainder(a - b, math.tau))) for a, b in pairs)
        cells = [f"{np.median(off):.1f}°, {max(off):.1f}°", f"{front:.1%}", f"{np.mean(same):.1%}", f"{most:.1f}°"]
        print(f"| {name} | {' | '.join(cells)} |")
    ages = [moment.ages for moment in moments]
    for name in ("proximity", "lidar", "ground"):
        row = [1000.0 * age[name] for age in ages]
        print(f"age of {name}: mean {np.mean(row):.0f} ms, most {max(row):.0f} ms")


def in_front(readings: Readings) -> bool:
    """Whether exploration turns away."""
    return readings.proximity_x >= 0.0 and obstacle(readings)[0] >= MERCATOR.reference_model.obstacle_threshold


def _motion() -> None:
    print("\n| drives for 10 s | heading: median, most | place: median, most |\n|---|---|---|")
    for name, wheels in (
        ("straight on", drive(1.0, 1.0)),
        ("a curve, 0.2 and 1", drive(0.2, 1.0)),
        ("on the spot", drive(-1.0, 1.0)),
    ):
        turns, ways = motion_off(driven(World([(-3.0, -1.0, 0.5)]), [wheels], 10.0)).T
        cells = [f"{np.degrees(value):.2f}°" for value in (np.median(turns), turns.max())]
        places = [f"{1000.0 * value:.1f} mm" for value in (np.median(ways), ways.max())]
        print(f"| {name} | {', '.join(cells)} | {', '.join(places)} |")


def _way() -> None:
    print("\n| towards a wall at full speed: distance | simulator | robot |\n|---|---|---|")
    for moment in [*driven(World([(HALF - 1.1, 0.0, 0.0)]), [drive(1.0, 1.0)], 3.0)][-7:]:
        sizes = [f"{obstacle(readings)[0]:.3f}" for readings in (moment.simulated, moment.perceived)]
        print(f"| {HALF - BODY - moment.pose[0]:.3f} m | {' | '.join(sizes)} |")
    print("\n| border crossed at full speed, sensor beyond it by | simulator | robot |\n|---|---|---|")
    for moment in driven(World([(-0.5, 0.0, 0.0)]), [drive(1.0, 1.0)], 2.0):
        beyond = moment.pose[0] + 0.05
        if abs(beyond) < 0.045:
            colours = [f"{readings.ground_red:g}" for readings in (moment.simulated, moment.perceived)]
            print(f"| {100.0 * beyond:+.1f} cm | {' | '.join(colours)} |")
    print("\n| the same commands | apart after 0.1, 1, 2, 3 s |\n|---|---|")
    for name, wheels in {
        "straight on": lambda _: drive(1.0, 1.0),
        "a curve, 0.2 and 1": lambda _: drive(0.2, 1.0),
        "a curve, 0.7 and 1": lambda _: drive(0.7, 1.0),
        "on the spot": lambda _: drive(-1.0, 1.0),
        "0.3 s on the spot, 0.7 s straight on": lambda c: drive(-1.0, 1.0) if c % 10 < 3 else drive(1.0, 1.0),
    }.items():
        apart = np.abs(np.subtract(*moved(wheels, 30)))[[0, 9, 19, 29]]
        cells = [f"{1000.0 * math.hypot(x, y):.0f} mm {math.degrees(turn):.1f}°" for x, y, turn in apart]
        print(f"| {name} | {', '.join(cells)} |")


def main() -> None:
    _still()
    _moving()
    _motion()
    _way()


if __name__ == "__main__":
    main()
