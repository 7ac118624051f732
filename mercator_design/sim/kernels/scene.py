"""The constant part of an experiment, and its floor, which may change; as numbers for the kernels."""

from typing import NamedTuple

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.missions.floor import FloorTable


class Proximity(NamedTuple):
    """The ring of proximity sensors."""

    ring: float  # its radius [m]
    directions_x: Floats  # (sensors,) unit vector of each, forwards ...
    directions_y: Floats  # ... and to the left
    counts_x: Floats  # (sensors,) the same of the directions that their readings count for
    counts_y: Floats
    nearest: float  # [m] nearer is too near to be measured
    furthest: float  # [m]
    noise: Floats  # (3,) of distances: a row of noise, see noise.py; so below
    weight_noise: Floats  # of the weights
    order: Numbers  # (sensors,) counter-clockwise from the front


class Drift(NamedTuple):
    """How the yaw and the place drift that a robot measures; 0: not at all."""

    bias: float  # [rad/s] sd of the yaw's constant drift
    by_way: float  # [rad/sqrt(m)] sd of the yaw's random walk with the way driven
    by_turn: float  # [rad/sqrt(rad)] sd of the same with the angle turned
    least_scale: float  # smallest and largest part by which ways are off, to either side
    most_scale: float


class Motion(NamedTuple):
    """The sensors of the robot's own motion, in a row for each sense; zeros where that is measured by others."""

    bounds: Floats  # (senses, 2) between which readings are kept, in the device's unit
    noise: Floats  # (senses, 3)
    drifts: bool
    drift: Drift


class Ground(NamedTuple):
    """The ground sensors."""

    places: Floats  # (sensors, 2) in the robot's frame [m]
    gray: bool  # whether they see no colours
    labels: Floats  # (3 * labels,) red, green, blue of each colour that readings count as; empty: as measured
    noise: Floats
    order: Numbers  # (sensors,) from left to right


class Neighbours(NamedTuple):
    """How robots perceive each other."""

    by_lidar: bool
    range: float  # [m]
    height: float  # [m] of the camera and of what it sees
    occlusion: bool  # whether something there is high enough to hide a robot
    loss: float
    noise: Floats


class Light(NamedTuple):
    """The lights, and the sensors of their direction."""

    lights: Floats  # (lights, 4) x, y, z [m], intensity
    seen: Flags  # (lights, robots) which robots sense its direction
    lit: Flags  # (lights, robots) whether it is light to a robot's sensor of brightness
    by_camera: bool  # else by a ring of sensors
    angles: Floats  # (sensors,) of the ring [rad]
    directions_x: Floats  # (sensors,) as in Proximity
    directions_y: Floats
    decay: float  # a light reads exp(-decay x) at x = distance / intensity ...
    reach: float  # ... up to this x
    height: float  # [m] of the sensors
    range: float  # [m]
    occlusion: bool
    noise: Floats
    order: Numbers  # (sensors,) counter-clockwise from the front


class Lidar(NamedTuple):
    """The lidar."""

    beams_x: Floats  # (beams,) unit vector of each, forwards ...
    beams_y: Floats  # ... and to the left
    first_angle: float  # [rad]
    angle_step: float  # [rad]
    ring: float  # [m] from where distances count
    head: float  # [m] radius of what other lidars see; 0: nothing
    nearest: float  # [m]
    furthest: float  # [m]
    outlines: Floats  # (walls, 6) what stands in its way, as Scene.walls
    sees_bodies: bool
    loss: float  # chance that a beam of a turn is lost
    turn: float  # [s] of a turn
    noise: Floats


class Physics(NamedTuple):
    """What a space of Chipmunk and the bodies of robots are built from."""

    iterations: int  # of the solver
    slop: float  # overlap that Chipmunk allows [m]
    corners: Floats  # (corners, 2) of walls and boxes [m], one after the other, in the order of Chipmunk
    ends: Numbers  # (walls and boxes,) the number of corners up to the end of each
    obstacle_friction: float
    radius: float  # of a robot that is a disc [m]; 0: robots are boxes ...
    core_length: float  # ... of this size, with a rim of corner_radius around it [m]
    core_width: float
    corner_radius: float
    mass: float  # [kg]
    inertia: float  # [kg m2]
    friction: float
    elasticity: float
    force: float  # maximum of the drive [N]
    torque: float  # [N m]


class Scene(NamedTuple):
    """Everything except the swarm: the arena, the robot model, and the present floor of this instance."""

    walls: Floats  # (walls, 6) start x, y; vector to the end x, y; unit normal x, y [m]
    wall_height: float  # [m]
    boxes: Floats  # (boxes, 7) centre x, y; cosine and sine of the angle; half length, half width, height [m]
    floor: FloorTable
    physics: Physics
    round: bool  # whether robots are discs; else boxes
    half_length: float  # of a robot [m]; the radius of a disc
    half_width: float
    corner: float  # distance from the centre to the farthest point [m]
    body_height: float  # [m]
    tread_distance: float  # [m]
    maximum_speed: float  # of a tread [m/s]
    wheel_noise: Floats
    proximity: Proximity
    ground: Ground
    neighbours: Neighbours
    light: Light
    lidar: Lidar
    motion: Motion
    stops: Numbers  # (robots,) first cycle in which each does not work any more; empty: robots do not fail
    senses: int  # those that the robot has, as bits (modules.SENSES)
    control_period: float  # [s]
    wall_overlap: float  # largest of a robot and a wall or box at the end of a cycle [m]; may be infinite
    sub_steps: int  # physics steps in a control cycle
    time_step: float  # [s] of physics
