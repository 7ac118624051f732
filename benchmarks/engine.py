"""Speed of the engine: one experiment, three ways, interleaved in one run.

    compiled   the engine: the whole experiment in one compiled call
    referee    the same kernels, called one by one from Python, the space stepped by pymunk's public functions
    naive      plain pymunk as one would write it first: a Python loop over the robots, `segment_query` for each ray

Protocol: 20 robots in the dodecagon scaled to 20 (side and placement times sqrt(20/3)), 120 s, 10 sub-steps, 8 rays, a
4-state PFSM; CPU time of this process, building the space included; seeds in turn, the ways interleaved; medians, and
the ratios of medians. Run: python benchmarks/engine.py [--rounds N]
"""

import argparse
import math
import random
import statistics
import time

import pymunk

from mercator_design.fsm import Controller, parse
from mercator_design.fsm.control import DRAWS
from mercator_design.fsm.perception import perceive, proximity_weight
from mercator_design.missions.mission import load_mission
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.world import World

FSM = (
    "--nstates 4 --s0 0 --rwm0 20 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 3 --p0x1 2 --w0x1 5 --s1 1 "
    "--n1 1 --n1x0 0 --c1x0 5 --p1x0 0.05 --s2 2 --att2 4 --n2 2 --n2x0 0 --c2x0 5 --p2x0 0.1 --n2x1 2 --c2x1 4 "
    "--p2x1 1 --w2x1 3 --s3 3 --rep3 5 --n3 1 --n3x0 1 --c3x0 1 --p3x0 0.1"
)
SCALE = math.sqrt(20 / 3)
SCALED = ["robots=20", f"arena.walls.apothem={1.226 * SCALE}", f"placement.radius={1.2 * SCALE}"]


def naive(world: World, fsm, seed: int) -> list[tuple[float, float]]:
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
            for other in robots:
                if other is not robot:
                    offset = (other.body.position - body.position).rotated(-body.angle)
                    if offset.length < model.neighbour_range:
                        found.append((offset.length, *(offset / offset.length)))
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
    return [tuple(robot.body.position) for robot in robots]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="seeds, each run in all three ways (default 5)")
    rounds = parser.parse_args().rounds
    mission, fsm = load_mission("aggregation", SCALED), parse(FSM)
    simulator = Simulator(mission)
    world = World(mission, simulator.robot_model)
    ways = {
        "compiled": lambda seed: simulator.run(fsm, seed),
        "referee": lambda seed: simulator.run(fsm, seed, referee=True),
        "naive": lambda seed: naive(world, fsm, seed),
    }
    for name in ("compiled", "referee"):
        ways[name](0)  # compiles
    times: dict[str, list[float]] = {name: [] for name in ways}
    for seed in range(1, rounds + 1):
        for name, run in ways.items():
            for _ in range(1 if name == "naive" else 3):
                start = time.process_time()
                run(seed)
                times[name].append(time.process_time() - start)
    medians = {name: statistics.median(found) for name, found in times.items()}
    print(f"{mission.robots} robots, {mission.duration:g} s, {rounds} seeds; CPU ms an experiment")
    print(f"{'way':<10} {'median':>8} {'min':>8} {'x compiled':>11} {'x real time':>12}")
    for name, found in times.items():
        factor = medians[name] / medians["compiled"]
        real_time = mission.duration / medians[name]
        print(f"{name:<10} {1e3 * medians[name]:>8.1f} {1e3 * min(found):>8.1f} {factor:>11.2f} {real_time:>12.0f}")


if __name__ == "__main__":
    main()
