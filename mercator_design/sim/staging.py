"""From a mission and a robot model to the `Scene` that the kernels run on."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mercator_design.missions.arena import Box
from mercator_design.missions.mission import Mission
from mercator_design.seeds import generator
from mercator_design.sim import scene
from mercator_design.sim.noise import GAUSSIAN, NO_NOISE, UNIFORM
from mercator_design.sim.robot_model import DiscBody, Gaussian, LightRing, Neighbours, Noise, RobotModel, Uniform
from mercator_design.sim.scene import Floats, Scene

_QUIET = np.array([NO_NOISE, 0.0, 0.0])
_NOTHING = np.zeros(0)


def new_scene(mission: Mission, model: RobotModel, sub_steps: int) -> Scene:
    """The scene of all instances of a mission; each puts its own floor into it."""
    walls = edges(mission.arena.corners())
    half_length, half_width = model.body.half_size
    return Scene(
        walls=walls,
        wall_height=mission.arena.wall_height,
        boxes=np.array([_box_row(box) for box in mission.arena.obstacles]).reshape(-1, 7),
        floor=mission.floor.realise(generator(0, "floor")),
        round=isinstance(model.body, DiscBody),
        half_length=half_length,
        half_width=half_width,
        corner=model.body.corner,
        body_height=model.body.height,
        tread_distance=model.drive.tread_distance,
        maximum_speed=model.drive.maximum_speed,
        mass=model.body.mass,
        inertia=model.body.inertia,
        force=model.drive.force,
        torque=model.drive.torque,
        wheel_noise=noise_row(model.drive.noise),
        proximity=_proximity(model),
        ground=_ground(model),
        neighbours=_neighbours(model),
        light=_light(mission, model),
        lidar=_lidar(mission, model),
        control_period=mission.control_period,
        wall_overlap=math.inf if model.physics.wall_overlap is None else model.physics.wall_overlap,
        sub_steps=sub_steps,
        time_step=mission.control_period / sub_steps,
    )


def edges(corners: Floats) -> Floats:
    """The walls (n, 6) between the corners (n, 2) of a polygon: start, vector to the end, unit normal inwards."""
    along = np.roll(corners, -1, axis=0) - corners
    inwards = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.ascontiguousarray(np.hstack([corners, along, inwards]))


def _box_row(box: Box) -> list[float]:
    along, across = box.size
    return [*box.center, math.cos(box.angle), math.sin(box.angle), 0.5 * along, 0.5 * across, box.height]


def noise_row(noise: Noise) -> Floats:
    """Noise as the kernels want it (3,): see noise.py."""
    if isinstance(noise, Gaussian):
        return np.array([GAUSSIAN, noise.mean, noise.sd])
    if isinstance(noise, Uniform):
        return np.array([UNIFORM, noise.mean, noise.half_width])
    return _QUIET


def _directions(angles: Sequence[float]) -> tuple[Floats, Floats]:
    return np.cos(np.array(angles, dtype=float)), np.sin(np.array(angles, dtype=float))


def _proximity(model: RobotModel) -> scene.Proximity:
    device = model.proximity
    if device is None:
        return scene.Proximity(0.0, _NOTHING, _NOTHING, _NOTHING, _NOTHING, 0.0, _QUIET, _QUIET)
    directions = *_directions(device.angles), *_directions(device.reported or device.angles)
    noises = noise_row(device.noise), noise_row(device.weight_noise)
    return scene.Proximity(device.ring_radius, *directions, device.range[1], *noises)


def _ground(model: RobotModel) -> scene.Ground:
    device = model.ground
    if device is None:
        return scene.Ground(np.zeros((0, 2)), gray=False, noise=_QUIET)
    return scene.Ground(np.array(device.positions), gray=device.gray, noise=noise_row(device.noise))


def _neighbours(model: RobotModel) -> scene.Neighbours:
    device = model.neighbours
    if not isinstance(device, Neighbours):
        by_lidar = device is not None
        return scene.Neighbours(by_lidar=by_lidar, range=0.0, occlusion=False, loss=0.0, noise=_QUIET)
    return scene.Neighbours(
        by_lidar=False,
        range=device.range,
        occlusion=device.occlusion,
        loss=device.loss,
        noise=noise_row(device.noise),
    )


def _light(mission: Mission, model: RobotModel) -> scene.Light:
    device = model.light
    lights = [light for light in mission.lights if light.intensity > 0.0]
    everyone = range(mission.robots)
    ring = device if isinstance(device, LightRing) else None

    def seen(others: str) -> NDArray[np.bool_]:
        """Who senses which light, with a device that is not for those others."""
        rows = [
            [light.kind != others and robot in (light.seen_by or everyone) for robot in everyone] for light in lights
        ]
        return np.array(rows, dtype=np.bool_).reshape(-1, mission.robots)

    angles = ring.angles if ring else ()
    return scene.Light(
        np.array([[*light.position, light.intensity] for light in lights]).reshape(-1, 4),
        seen("beacon" if ring else "lamp"),
        seen("beacon"),
        ring is None,
        np.array(angles, dtype=float),
        *_directions(angles),
        decay=ring.decay if ring else 0.0,
        reach=ring.reach if ring else 0.0,
        height=device.height if device else 0.0,
        range=device.range if device else 0.0,
        occlusion=device.occlusion if device else False,
        noise=noise_row(device.noise if device else None),
    )


def _lidar(mission: Mission, model: RobotModel) -> scene.Lidar:
    device = model.lidar
    if device is None:
        return scene.Lidar(
            _NOTHING, _NOTHING, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, np.zeros((0, 6)), sees_bodies=False, noise=_QUIET
        )
    arena, step = mission.arena, 2.0 * math.pi / device.beams
    outlines = [box.corners() for box in arena.obstacles if box.height > device.height]
    if arena.wall_height > device.height:
        outlines.append(arena.corners())
    if arena.room is not None:
        outlines.append(arena.room.corners())
    return scene.Lidar(
        *_directions([device.first_angle + step * k for k in range(device.beams)]),
        first_angle=device.first_angle,
        angle_step=step,
        ring=device.ring_radius,
        head=device.head_radius,
        nearest=device.range[0],
        furthest=device.range[1],
        outlines=np.vstack([edges(corners) for corners in outlines]) if outlines else np.zeros((0, 6)),
        sees_bodies=model.body.height > device.height,
        noise=noise_row(device.noise),
    )
