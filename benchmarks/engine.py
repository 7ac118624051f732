"""Speed of the engine, and what must hold of it; all in one run.

20 robots in the three missions of the Mercator paper, in their larger dodecagon; and in a crowd, with 2.3 times less
room. Each in three ways:

    compiled   the engine: the whole experiment in one compiled call
    referee    the same kernels, called one by one from Python, the space stepped by pymunk's public functions
    naive      plain pymunk as one would write it first: a Python loop over the robots, `segment_query` for each ray

Then lidars of 719 beams that every robot turns in every cycle, 20 robots that attract each other, always and now and
then, 3 and 200 robots in as much room for each as in the crowd, two threads, and memory over many short experiments.

Protocol: 120 s, 10 steps a cycle, 8 rays, a 4-state PFSM; CPU time of this process, building the space included; seeds
in turn, the ways interleaved. Times are means over the seeds, with the minimum and the maximum; ratios are of these
means, with the minimum and the maximum of one seed's. Threads are compared by wall time, beside threads whose work
shares nothing, which show whether the cores are idle, and beside threads of plain Python, which share its lock.

Run: python benchmarks/engine.py [--rounds N] [--memory N]
"""

import argparse
import dataclasses
import gc
import hashlib
import math
import random
import resource
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import pymunk

from mercator_design.fsm import parse
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.perception import perceive, proximity_weight
from mercator_design.modules.reference import N_READINGS
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Neighbours
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.world import World
from mercator_design.software import Controller

FSM = (
    "--nstates 4 --s0 0 --rwm0 20 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 3 --p0x1 2 --w0x1 5 --s1 1 "
    "--n1 1 --n1x0 0 --c1x0 5 --p1x0 0.05 --s2 2 --att2 4 --n2 2 --n2x0 0 --c2x0 5 --p2x0 0.1 --n2x1 2 --c2x1 4 "
    "--p2x1 1 --w2x1 3 --s3 3 --rep3 5 --n3 1 --n3x0 1 --c3x0 1 --p3x0 0.1"
)
ATTRACTED = "--nstates 1 --s0 2 --att0 4"
EXPLORING_AND_ATTRACTED = (  # the winner of a short race
    "--nstates 2 --s0 0 --rwm0 36 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.96 --n0x1 0 --c0x1 3 --p0x1 6 --w0x1 2.63 "
    "--s1 2 --att1 4.33 --n1 2 --n1x0 0 --c1x0 5 --p1x0 1 --n1x1 0 --c1x1 1 --p1x1 0.74"
)
MISSIONS = ("aggregation_20", "grid_exploration_20", "color_aggregation_20")
Way = Callable[[int], object]  # runs the experiment of a seed


def painted(mission: Mission) -> Callable[[float, float], float]:
    """The brightness of the floor of one of the missions here, as one would write it for just this one."""
    zones: Any = mission.floor.zones
    if mission.name.startswith("aggregation"):
        radius = zones[0].radius
        return lambda x, y: 0.0 if x * x + y * y <= radius * radius else 127.0
    if mission.name.startswith("color"):
        tiles, half = zones[0].centers, 0.5 * zones[0].size
        return lambda x, y: next((200.0 for u, v in tiles if abs(x - u) <= half and abs(y - v) <= half), 127.0)
    return lambda _x, _y: 127.0


def naive(world: World, fsm: Pfsm, seed: int) -> list[tuple[float, float]]:
    """The experiment in plain pymunk and Python."""
    level = painted(world.mission)
    instance, model = world.instance(seed), world.robot_model.reference_model
    scene, referee = instance.scene, Referee(instance.scene, instance.swarm)
    space, robots = referee.space, referee.robots
    for number, (robot, pose) in enumerate(zip(robots, instance.swarm.poses.tolist(), strict=True), start=1):
        robot.body.position, robot.body.angle = pose[:2], pose[2]
        robot.shape.filter = pymunk.ShapeFilter(group=number)
        space.add(robot.body, robot.shape, robot.goal)
        space.add(robot.pivot, robot.gear)
    controllers = [Controller(fsm, model) for _ in robots]
    generator = random.Random(seed)
    directions = scene.proximity.directions_x.tolist(), scene.proximity.directions_y.tolist()
    rays = list(zip(*directions, strict=True))
    commands = [(0.0, 0.0)] * len(robots)
    for _ in range(world.mission.cycles):
        for robot, (left, right) in zip(robots, commands, strict=True):
            forwards = pymunk.Vec2d(1, 0).rotated(robot.body.angle)
            robot.goal.velocity = forwards * (0.5 * (left + right))
            robot.goal.angular_velocity = (right - left) / scene.tread_distance
        for _ in range(scene.sub_steps):
            space.step(scene.time_step)
        commands = []
        places = [tuple(robot.body.position) for robot in robots]
        for number, (robot, controller) in enumerate(zip(robots, controllers, strict=True), start=1):
            body = robot.body
            proximity = []
            for x, y in rays:
                direction = pymunk.Vec2d(x, y).rotated(body.angle)
                start = body.position + direction * scene.proximity.ring
                end = start + direction * model.proximity_range
                hit = space.segment_query_first(start, end, 0, pymunk.ShapeFilter(group=number))
                proximity.append(proximity_weight(model, hit.alpha * model.proximity_range) if hit else 0.0)
            found = []
            x, y = places[number - 1]
            c, s = math.cos(body.angle), math.sin(body.angle)
            for other, (other_x, other_y) in enumerate(places, start=1):
                to_x, to_y = other_x - x, other_y - y
                distance = math.sqrt(to_x * to_x + to_y * to_y)
                if other != number and distance < model.neighbour_range:
                    found.append((distance, (c * to_x + s * to_y) / distance, (c * to_y - s * to_x) / distance))
            distances, bearings_x, bearings_y = zip(*found, strict=True) if found else ((), (), ())
            spot = body.position + pymunk.Vec2d(*scene.ground.places[0].tolist()).rotated(body.angle)
            shade = level(*spot)
            ground = [min(255.0, max(0.0, round(shade + generator.gauss(0, 5)))) for _ in range(3)]
            readings = perceive(
                model,
                proximity,
                *directions,
                distances,
                bearings_x,
                bearings_y,
                len(found),
                float(len(found)),
                ground,
                (0, 0),
                [0.0] * N_READINGS,
            )
            wheels = controller.step(readings, [generator.random() for _ in range(controller.draws)])
            commands.append((wheels.left * scene.maximum_speed, wheels.right * scene.maximum_speed))
    return [(robot.body.position.x, robot.body.position.y) for robot in robots]


def scaled(robots: int) -> list[str]:
    """Overrides that give a mission in the dodecagon more robots, and as much room for each."""
    scale = math.sqrt(robots / 3)
    return [f"robots={robots}", f"arena.walls.apothem={1.226 * scale}", f"placement.radius={1.2 * scale}"]


def measure(ways: dict[str, Way], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of each way for seeds 1, 2, ... in turn, the ways interleaved; the minimum of two calls."""
    for run in ways.values():
        run(0)  # compiles
    times: dict[str, list[float]] = {name: [] for name in ways}
    for seed in range(1, rounds + 1):
        for name, run in ways.items():
            found = []
            for _ in range(1 if "naive" in name else 2):
                start = time.process_time()
                run(seed)
                found.append(time.process_time() - start)
            times[name].append(min(found))
    return times


def in_two_threads(run: Way) -> float:
    """Wall time of a call when two threads make calls, against one thread alone."""

    def seconds(threads: int) -> float:
        with ThreadPoolExecutor(threads) as pool:
            start = time.perf_counter()
            list(pool.map(run, [seed for seed in range(1, 5) for _ in range(threads)]))
            return time.perf_counter() - start

    alone = seconds(1)
    return seconds(2) / alone


def spin(_seed: int) -> None:
    """Work that needs neither Python's lock nor much memory."""
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000)


def lock(_seed: int) -> None:
    """Work that holds Python's lock all the time."""
    sum(range(1_000_000))


def resident() -> float:
    """Memory of this process [MiB], on Linux."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def growth(run: Way, experiments: int) -> float:
    """By how much the memory grows [MiB] from a tenth of the experiments to the last.

    pymunk's objects refer to themselves, so some MiB of them may wait for Python's collector of cycles.
    """
    sizes = []
    for seed in range(experiments):
        run(seed)
        if (seed + 1) % (experiments // 10) == 0:
            gc.collect()
            sizes.append(resident())
    return sizes[-1] - sizes[0]


class Spread(NamedTuple):
    """A mean, or ratio of means, over the seeds; the minimum and the maximum of one seed."""

    mean: float
    minimum: float
    maximum: float


def spread(values: list[float], scale: float = 1.0) -> Spread:
    """Of values times a scale."""
    return Spread(scale * statistics.mean(values), scale * min(values), scale * max(values))


def ratio(times: list[float], others: list[float], scale: float = 1.0) -> Spread:
    """Of times to others of the same seeds, times a scale."""
    single = spread([time / other for time, other in zip(times, others, strict=True)], scale)
    return single._replace(mean=scale * sum(times) / sum(others))


def at_least(low: int) -> Callable[[str], int]:
    """What reads an argument that is a whole number, and not below another."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < low:
            raise argparse.ArgumentTypeError(f"expected a whole number >= {low}, found '{text}'")
        return int(text)

    return number


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=at_least(1), default=10, help="seeds (default 10)")
    parser.add_argument(
        "--memory", type=at_least(10), default=10_000, help="experiments after which memory is compared, 10 or more"
    )
    given = parser.parse_args()
    fsm = parse(FSM)

    def way(simulator: Simulator, fsm: Pfsm = fsm, *, referee: bool = False) -> Way:
        return lambda seed: simulator.run(fsm, seed, referee=referee)

    def plain(simulator: Simulator) -> Way:
        world = World(simulator.mission, simulator.robot_model)
        return lambda seed: naive(world, fsm, seed)

    crowd = Simulator(load_mission("aggregation", scaled(20)))
    simulators = {name: Simulator(load_mission(name)) for name in MISSIONS} | {"crowd": crowd}
    by_camera = dataclasses.replace(crowd.robot_model, neighbours=Neighbours())
    short = Simulator(load_mission("aggregation", ["duration=2"]))
    grown = growth(way(short), given.memory)

    ways: dict[str, Way] = {}
    for name, simulator in simulators.items():
        ways[name] = way(simulator)
        ways[f"{name}, referee"] = way(simulator, referee=True)
        ways[f"{name}, naive"] = plain(simulator)
    for robot in ("mercator", "mercator-argos"):
        recording = Simulator(crowd.mission, load_robot_model(robot)).run(fsm, 1).recording
        ways[f"lidar of {robot}"] = lambda _, recording=recording: recording.measure("lidar")  # type: ignore[misc]
    ways["neighbours by camera"] = way(Simulator(crowd.mission, by_camera))
    for name, text in {"attracted": ATTRACTED, "exploring and attracted": EXPLORING_AND_ATTRACTED}.items():
        ways[f"aggregation_20, {name}"] = way(simulators["aggregation_20"], parse(text))
    ways["3 robots"] = way(Simulator(load_mission("aggregation")))
    ways["200 robots"] = way(Simulator(load_mission("aggregation", scaled(200))))
    times = measure(ways, given.rounds)
    threads = [[in_two_threads(run) for run in (ways["crowd"], spin, lock)] for _ in range(given.rounds)]
    both, idle, locked = (list(found) for found in zip(*threads, strict=True))

    print(f"120 s, {given.rounds} seeds: CPU ms an experiment\n\n{'way':<32} {'mean':>7} {'min':>7} {'max':>7}")
    for name, found in times.items():
        mean, low, high = spread(found, 1e3)
        print(f"{name:<32} {mean:>7.1f} {low:>7.1f} {high:>7.1f}")

    verdicts: list[tuple[str, Spread, str, float]] = []
    for name in simulators:
        verdicts += [
            (f"{name} [ms]", spread(times[name], 1e3), "at most", 45.0),
            (f"{name}, referee / compiled", ratio(times[f"{name}, referee"], times[name]), "at least", 1.7),
            (f"{name}, naive / compiled", ratio(times[f"{name}, naive"], times[name]), "at least", 30.0),
        ]
    added = [found - base for found, base in zip(times["crowd"], times["neighbours by camera"], strict=True)]
    verdicts += [
        ("lidar of mercator [ms]", spread(times["lidar of mercator"], 1e3), "at most", 200.0),
        ("lidar of mercator-argos [ms]", spread(times["lidar of mercator-argos"], 1e3), "at most", 200.0),
        ("neighbours by lidar, added [ms]", spread(added, 1e3), "at most", 200.0),
        ("3 robots [ms]", spread(times["3 robots"], 1e3), "at most", 5.0),
        ("200 robots / crowd, a robot's cycle", ratio(times["200 robots"], times["crowd"], 0.1), "at most", 2.0),
        ("two threads / one, an experiment", spread(both), "at most", 1.15),
        (f"memory, {given.memory} experiments [MiB]", spread([grown]), "at most", 2.0),
    ]
    print(f"\n{'what':<42} {'measured':>8} {'min':>7} {'max':>7}   target")
    for what, (mean, low, high), sense, target in verdicts:
        met = mean >= target if sense == "at least" else mean <= target
        print(f"{what:<42} {mean:>8.2f} {low:>7.2f} {high:>7.2f}   {sense} {target:g}: {'met' if met else 'MISSED'}")
    shared_nothing, shared_lock = statistics.mean(idle), statistics.mean(locked)
    print(f"two threads of work that shares nothing: {shared_nothing:.2f}; of plain Python: {shared_lock:.2f}", end="")
    print("" if shared_nothing <= 1.15 else "; the cores are not idle, so that of experiments says nothing")


if __name__ == "__main__":
    main()
