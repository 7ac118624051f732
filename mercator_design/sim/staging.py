"""Makes the `Scene`: the part that is equal in all instances of a mission, as numbers for the kernels."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pymunk

from mercator_design.arrays import Flags, Floats
from mercator_design.missions.arena import WALL_THICKNESS, Box
from mercator_design.missions.mission import Mission
from mercator_design.modules.perception import ring_order
from mercator_design.modules.reference import SENSES, senses_bits
from mercator_design.seeds import generator
from mercator_design.sim.kernels import scene
from mercator_design.sim.kernels.noise import GAUSSIAN, NO_NOISE, UNIFORM
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.labels import level_row, simulated_labels
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import (
    DiscBody,
    Gaussian,
    Imu,
    Lidar,
    LightCamera,
    LightRing,
    Locator,
    MotionSensor,
    Neighbours,
    Noise,
    Proximity,
    Uniform,
)

_QUIET = np.array([NO_NOISE, 0.0, 0.0])
_NO_IMU = Imu(range=(0.0, 1.0))
_NO_LOCATOR = Locator(range=(0.0, 1.0))
_NO_PROXIMITY = Proximity(ring_radius=0.0, angles=(), range=(0.0, 0.0))
_NO_LIDAR = Lidar(beams=0, first_angle=0.0, height=math.inf, head_radius=0.0, range=(0.0, 0.0))


def new_scene(mission: Mission, model: RobotModel, sub_steps: int) -> Scene:
    """The scene of all instances of a mission; each instance sets its floor."""
    walls = edges(mission.arena.corners())
    half_length, half_width = model.body.half_size
    return Scene(
        walls=walls,
        wall_height=mission.arena.wall_height,
        boxes=np.array([_box_row(box) for box in mission.arena.obstacles]).reshape(-1, 7),
        floor=mission.realise_floor(generator(0, "floor")),
        physics=_physics(mission, model, walls),
        round=isinstance(model.body, DiscBody),
        half_length=half_length,
        half_width=half_width,
        corner=model.body.corner,
        body_height=model.body.height,
        tread_distance=model.drive.tread_distance,
        maximum_speed=model.drive.maximum_speed,
        wheel_noise=noise_row(model.drive.noise),
        proximity=_proximity(model),
        ground=_ground(mission, model),
        neighbours=_neighbours(mission, model),
        light=_light(mission, model),
        lidar=_lidar(mission, model),
        motion=_motion(model),
        stops=np.zeros(0, dtype=np.int64),
        senses=senses_bits(model.senses),
        control_period=mission.control_period,
        wall_overlap=math.inf if model.physics.wall_overlap is None else model.physics.wall_overlap,
        sub_steps=sub_steps,
        time_step=mission.control_period / sub_steps,
    )


def _physics(mission: Mission, model: RobotModel, walls: Floats) -> scene.Physics:
    physics, body, drive = model.physics, model.body, model.drive
    is_disc, (half_length, half_width) = isinstance(body, DiscBody), body.half_size
    outlines = [*wall_slabs(walls), *(box.corners() for box in mission.arena.obstacles)]
    # As Chipmunk keeps them, because contacts depend on their order. It drops corners that are equal after rounding.
    hulls = [np.array(pymunk.Poly(None, outline.tolist()).get_vertices()) for outline in outlines]
    return scene.Physics(
        iterations=physics.solver_iterations,
        slop=physics.collision_slop,
        corners=np.vstack(hulls),
        ends=np.cumsum([len(hull) for hull in hulls]),
        obstacle_friction=physics.wall_friction,
        radius=half_length if is_disc else 0.0,
        core_length=2.0 * (half_length - physics.corner_radius),
        core_width=2.0 * (half_width - physics.corner_radius),
        corner_radius=physics.corner_radius,
        mass=body.mass,
        inertia=body.moment_of_inertia,
        friction=body.friction,
        elasticity=body.elasticity,
        force=drive.force,
        torque=drive.torque,
    )


def wall_slabs(walls: Floats) -> Floats:
    """The corners (walls, 4, 2) of walls (walls, 6) with their thickness: of the inner face, then the outer ones."""
    starts, ends = walls[:, :2], np.roll(walls[:, :2], -1, axis=0)
    outwards = -WALL_THICKNESS * walls[:, 4:6]
    return np.stack([starts, ends, ends + outwards, starts + outwards], axis=1)


def edges(corners: Floats) -> Floats:
    """The walls (n, 6) between the corners (n, 2) of a polygon: start, vector to the end, unit normal inwards."""
    along = np.roll(corners, -1, axis=0) - corners
    inwards = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.ascontiguousarray(np.hstack([corners, along, inwards]))


def _box_row(box: Box) -> list[float]:
    along, across = box.size
    return [*box.center, math.cos(box.angle), math.sin(box.angle), 0.5 * along, 0.5 * across, box.height]


def noise_row(noise: Noise) -> Floats:
    """Noise as numbers for the kernels (3,): see noise.py."""
    if isinstance(noise, Gaussian):
        return np.array([GAUSSIAN, noise.mean, noise.sd])
    if isinstance(noise, Uniform):
        return np.array([UNIFORM, noise.mean, noise.half_width])
    return _QUIET


def _directions(angles: Sequence[float]) -> tuple[Floats, Floats]:
    return np.cos(np.array(angles, dtype=float)), np.sin(np.array(angles, dtype=float))


def _motion(model: RobotModel) -> scene.Motion:
    bounds, noise = np.zeros((len(SENSES), 2)), np.zeros((len(SENSES), 3))
    for k, sense in enumerate(SENSES.values()):
        device = getattr(model, sense.device)
        if isinstance(device, MotionSensor):
            bounds[k], noise[k] = device.range, noise_row(device.noise)
    imu, locator = model.imu or _NO_IMU, model.locator or _NO_LOCATOR
    drift = scene.Drift(imu.bias, imu.walk_by_way, imu.walk_by_turn, *locator.scale_errors)
    return scene.Motion(bounds=bounds, noise=noise, drifts=any(drift), drift=drift)


def _proximity(model: RobotModel) -> scene.Proximity:
    device = model.proximity or _NO_PROXIMITY
    nearest, furthest = device.range
    rays_x, rays_y = _directions(device.angles)
    counts_x, counts_y = _directions(device.reported or device.angles)
    return scene.Proximity(
        ring=device.ring_radius,
        directions_x=rays_x,
        directions_y=rays_y,
        counts_x=counts_x,
        counts_y=counts_y,
        nearest=nearest,
        furthest=furthest,
        noise=noise_row(device.noise),
        weight_noise=noise_row(device.weight_noise),
        order=np.array(ring_order(device.reported or device.angles), dtype=np.int64),
    )


def _ground(mission: Mission, model: RobotModel) -> scene.Ground:
    device = model.ground
    places = np.array(device.positions if device else ()).reshape(-1, 2)
    return scene.Ground(
        places=places,
        gray=device is not None and device.gray,
        labels=level_row(simulated_labels(mission.floor, model)),
        noise=noise_row(device.noise if device else None),
        order=np.argsort(-places[:, 1], kind="stable"),
    )


def _neighbours(mission: Mission, model: RobotModel) -> scene.Neighbours:
    device, arena = model.neighbours, mission.arena
    if not isinstance(device, Neighbours):
        by_lidar = device is not None
        return scene.Neighbours(by_lidar=by_lidar, range=0.0, height=0.0, occlusion=False, loss=0.0, noise=_QUIET)
    highest = max(model.body.height, arena.wall_height, *(box.height for box in arena.obstacles))
    return scene.Neighbours(
        by_lidar=False,
        range=math.inf if device.range is None else device.range,
        height=device.height,
        occlusion=device.occlusion and highest > device.height,
        loss=device.loss,
        noise=noise_row(device.noise),
    )


def _light(mission: Mission, model: RobotModel) -> scene.Light:
    device = model.light
    ring = device if isinstance(device, LightRing) else None
    angles = ring.angles if ring else ()
    directions_x, directions_y = _directions(angles)
    lights = [light for light in mission.lights if light.intensity > 0.0]
    highest = device.highest if isinstance(device, LightCamera) else math.inf
    everyone = range(mission.robots)

    def sensed(kind: Literal["lamp", "beacon"]) -> Flags:
        """Which light (lights, robots) each robot senses with a device for this kind."""
        rows = [
            [light.kind in {None, kind} and robot in (light.seen_by or everyone) for robot in everyone]
            for light in lights
        ]
        return np.array(rows, dtype=np.bool_).reshape(-1, mission.robots)

    in_view = np.array([[light.position[2] < highest] for light in lights], dtype=np.bool_).reshape(-1, 1)
    return scene.Light(
        lights=np.array([[*light.position, light.intensity] for light in lights]).reshape(-1, 4),
        seen=sensed("lamp") if ring else sensed("beacon") & in_view,
        lit=sensed("lamp"),
        by_camera=ring is None,
        angles=np.array(angles, dtype=float),
        directions_x=directions_x,
        directions_y=directions_y,
        decay=ring.decay if ring else 0.0,
        reach=ring.reach if ring else 0.0,
        height=device.height if device else 0.0,
        range=device.range if device else 0.0,
        occlusion=device.occlusion if device else False,
        noise=noise_row(device.noise if device else None),
        order=np.array(ring_order(angles), dtype=np.int64),
    )


def _lidar(mission: Mission, model: RobotModel) -> scene.Lidar:
    device, arena = model.lidar or _NO_LIDAR, mission.arena
    outlines = [box.corners() for box in arena.obstacles if box.height > device.height]
    outlines += [arena.corners()] if arena.wall_height > device.height else []
    outlines += [arena.room.corners()] if arena.room is not None else []
    step = 2.0 * math.pi / max(1, device.beams)
    beams_x, beams_y = _directions([device.first_angle + step * k for k in range(device.beams)])
    nearest, furthest = device.range
    return scene.Lidar(
        beams_x=beams_x,
        beams_y=beams_y,
        first_angle=device.first_angle,
        angle_step=step,
        ring=device.ring_radius,
        head=device.head_radius,
        nearest=nearest,
        furthest=furthest,
        outlines=np.vstack([np.zeros((0, 6)), *(edges(corners) for corners in outlines)]),
        sees_bodies=model.body.height > device.height,
        loss=device.loss,
        turn=device.turn,
        noise=noise_row(device.noise),
    )
