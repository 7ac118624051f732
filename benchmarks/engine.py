"""Speed of the engine, and what must hold of it; all in one run.

20 robots, three ways:

    compiled   the engine: the whole experiment in one compiled call
    referee    the same kernels, called one by one from Python, the space stepped by pymunk's public functions
    naive      plain pymunk as one would write it first: a Python loop over the robots, `segment_query` for each ray

Then a lidar of 719 beams that every robot turns in every cycle, 3 and 200 robots, two threads, and memory over many
short experiments.

Protocol: the dodecagon, scaled to the number of robots (side and placement times sqrt(robots / 3)), 120 s, 10 steps a
cycle, 8 rays, a 4-state PFSM; CPU time of this process, building the space included; seeds in turn, the ways
interleaved; medians over the seeds of times, and of ratios on the same seed. Threads are compared by wall time, beside
threads whose work shares nothing, which show whether the cores are idle.

Run: python benchmarks/engine.py [--rounds N] [--memory N]
"""

import argparse
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

import pymunk

from mercator_design.fsm import Controller, parse
from mercator_design.fsm.control import DRAWS
from mercator_design.fsm.perception import perceive, proximity_weight
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import load_mission
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.world import World

FSM = (
    "--nstates 4 --s0 0 --rwm0 20 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 3 --p0x1 2 --w0x1 5 --s1 1 "
    "--n1 1 --n1x0 0 --c1x0 5 --p1x0 0.05 --s2 2 --att2 4 --n2 2 --n2x0 0 --c2x0 5 --p2x0 0.1 --n2x1 2 --c2x1 4 "
    "--p2x1 1 --w2x1 3 --s3 3 --rep3 5 --n3 1 --n3x0 1 --c3x0 1 --p3x0 0.1"
)
Way = Callable[[int], object]  # runs the experiment of a seed


def naive(world: World, fsm: Pfsm, seed: int) -> list[tuple[float, float]]:
    """The experiment in plain pymunk and Python."""
    instance, model = world.instance(seed), world.robot_model.reference_model
    space, scene, robots = instance.space, instance.scene, instance.robots
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
            level = 0.0 if spot.length <= 0.5 else 127.0
            ground = [min(255.0, max(0.0, round(level + generator.gauss(0, 5)))) for _ in range(3)]
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
            )
            wheels = controller.step(readings, [generator.random() for _ in range(DRAWS)])
            commands.append((wheels.left * scene.maximum_speed, wheels.right * scene.maximum_speed))
    return [(robot.body.position.x, robot.body.position.y) for robot in robots]


def scaled(robots: int) -> list[str]:
    """Overrides that give a mission in the dodecagon more robots, and as much room for each."""
    scale = math.sqrt(robots / 3)
    return [f"robots={robots}", f"arena.walls.apothem={1.226 * scale}", f"placement.radius={1.2 * scale}"]


def measure(ways: dict[str, tuple[Way, int]], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of each way, one median a round: seeds 1, 2, ... in turn, the ways interleaved."""
    for run, _ in ways.values():
        run(0)  # compiles
    times: dict[str, list[float]] = {name: [] for name in ways}
    for seed in range(1, rounds + 1):
        for name, (run, repeats) in ways.items():
            found = []
            for _ in range(repeats):
                start = time.process_time()
                run(seed)
                found.append(time.process_time() - start)
            times[name].append(statistics.median(found))
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="seeds (default 5)")
    parser.add_argument("--memory", type=int, default=10_000, help="experiments after which memory is compared")
    given = parser.parse_args()
    fsm = parse(FSM)

    def simulator(*overrides: str) -> Simulator:
        return Simulator(load_mission("aggregation", overrides))

    def way(simulator: Simulator) -> Way:
        return lambda seed: simulator.run(fsm, seed)

    short, three, twenty, many = simulator("duration=2"), simulator(), simulator(*scaled(20)), simulator(*scaled(200))
    grown = growth(way(short), given.memory)
    world = World(twenty.mission, twenty.robot_model)
    recording = twenty.run(fsm, 1).recording
    ways: dict[str, tuple[Way, int]] = {
        "compiled": (way(twenty), 3),
        "referee": (lambda seed: twenty.run(fsm, seed, referee=True), 3),
        "naive": (lambda seed: naive(world, fsm, seed), 1),
        "lidar": (lambda _: recording.measure("lidar"), 1),
        "3 robots": (way(three), 9),
        "200 robots": (way(many), 1),
    }
    times = measure(ways, given.rounds)
    threads = [(in_two_threads(ways["compiled"][0]), in_two_threads(spin)) for _ in range(given.rounds)]
    both, idle = (statistics.median(found) for found in zip(*threads, strict=True))

    print(f"{twenty.mission.duration:g} s, {given.rounds} seeds; 20 robots unless said; CPU ms an experiment")
    print(f"{'way':<12} {'median':>8} {'min':>8} {'x real time':>12}")
    medians = {name: statistics.median(found) for name, found in times.items()}
    for name, found in times.items():
        real_time = twenty.mission.duration / medians[name]
        print(f"{name:<12} {1e3 * medians[name]:>8.1f} {1e3 * min(found):>8.1f} {real_time:>12.0f}")

    def ratio(name: str) -> float:
        pairs = zip(times[name], times["compiled"], strict=True)
        return statistics.median(other / compiled for other, compiled in pairs)

    verdicts = [
        ("compiled [ms]", 1e3 * medians["compiled"], "at most", 45.0),
        ("referee / compiled", ratio("referee"), "at least", 1.7),
        ("naive / compiled", ratio("naive"), "at least", 30.0),
        ("lidar, every robot and cycle [ms]", 1e3 * medians["lidar"], "at most", 200.0),
        ("3 robots [ms]", 1e3 * medians["3 robots"], "at most", 5.0),
        ("200 robots / 20, a robot's cycle", ratio("200 robots") / 10.0, "at most", 2.0),
        ("two threads / one, an experiment", both, "at most", 1.15),
        (f"memory, {given.memory} experiments [MiB]", grown, "at most", 2.0),
    ]
    print(f"\n{'what':<36} {'measured':>9}   target")
    for what, measured, sense, target in verdicts:
        met = measured >= target if sense == "at least" else measured <= target
        print(f"{what:<36} {measured:>9.2f}   {sense} {target:g}: {'met' if met else 'MISSED'}")
    print(f"two threads of work that shares nothing: {idle:.2f}", end="")
    print("" if idle <= 1.15 else "; the cores are not idle, so that of experiments says nothing")


if __name__ == "__main__":
    main()
