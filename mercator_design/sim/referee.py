"""The referee: the loop of `kernel.experiment` with pymunk's public functions, from Python.

It builds the space that chipmunk.py builds in compiled code, of pymunk's objects. The outcome of an experiment is the
same, to the last bit.
"""

import numpy as np
import pymunk

from mercator_design.arrays import Floats
from mercator_design.fsm.pfsm import Program
from mercator_design.jit import compiled
from mercator_design.modules.reference import ReferenceModel
from mercator_design.sim.kernels import kernel
from mercator_design.sim.kernels.scene import Physics, Scene
from mercator_design.sim.kernels.swarm import History, Swarm


class RefereeRobot:
    """A robot with its drive, as pymunk objects, in no space yet."""

    def __init__(self, physics: Physics) -> None:
        self.body = pymunk.Body(physics.mass, physics.inertia)
        if physics.radius > 0.0:
            self.shape: pymunk.Shape = pymunk.Circle(self.body, physics.radius)
        else:
            core = physics.core_length, physics.core_width
            self.shape = pymunk.Poly.create_box(self.body, core, physics.corner_radius)
        self.shape.friction = physics.friction
        self.shape.elasticity = physics.elasticity
        self.goal = pymunk.Body(body_type=pymunk.Body.KINEMATIC)  # has the target velocity; in no space
        self.pivot = pymunk.PivotJoint(self.goal, self.body, (0.0, 0.0), (0.0, 0.0))
        self.gear = pymunk.GearJoint(self.goal, self.body, 0.0, 1.0)
        for joint, limit in ((self.pivot, physics.force), (self.gear, physics.torque)):
            joint.max_bias = 0.0  # velocities are to agree, not positions
            joint.error_bias = 0.0
            joint.max_force = limit

    def place(self, pose: Floats, velocity: Floats) -> None:
        """Give the body a state."""
        self.body.position = tuple(pose[:2].tolist())
        self.body.angle = float(pose[2])
        self.body.velocity = tuple(velocity[:2].tolist())
        self.body.angular_velocity = float(velocity[2])


class Referee:
    """The arena of an instance in Chipmunk, with robots that enter it when they come close to something."""

    def __init__(self, scene: Scene, swarm: Swarm) -> None:
        self.scene, self.swarm = scene, swarm
        self.space = pymunk.Space()
        self.space.iterations = scene.physics.iterations
        self.space.collision_slop = scene.physics.slop
        for corners in np.split(scene.physics.corners, scene.physics.ends[:-1]):
            shape = pymunk.Poly(self.space.static_body, corners.tolist())
            shape.friction = scene.physics.obstacle_friction
            self.space.add(shape)
        self.robots = [RefereeRobot(scene.physics) for _ in swarm.poses]

    def move(self) -> None:
        """One control cycle of motion, as `kernel.move`."""
        scene, swarm = self.scene, self.swarm
        meetings = compiled(kernel.begin_motion)(scene, swarm)
        if meetings == kernel.FREE:
            self._part()
            return
        for robot, (x, y, turn) in zip(self.robots, swarm.targets.tolist(), strict=True):
            robot.goal.velocity = x, y
            robot.goal.angular_velocity = turn
        for k in range(scene.sub_steps):
            if not swarm.close.all():
                self.read()
                compiled(kernel.begin_step)(scene, swarm, meetings, k)
            if k == 0:
                self._part()
            self.step()
        self.read()
        compiled(kernel.end_motion)(scene, swarm)
        for i in np.flatnonzero(swarm.moved).tolist():
            self.robots[i].place(swarm.poses[i], swarm.velocities[i])

    def _part(self) -> None:
        for robot, close in zip(self.robots, self.swarm.close.tolist(), strict=True):
            if robot.body.space and not close:
                self.space.remove(robot.pivot, robot.gear, robot.shape, robot.body)

    def step(self) -> None:
        """Advance the space by a step, with the robots that are close to something."""
        swarm = self.swarm
        close = np.flatnonzero(swarm.close).tolist()
        for i in close:
            robot = self.robots[i]
            if not robot.body.space:
                robot.place(swarm.poses[i], swarm.velocities[i])
                self.space.add(robot.body, robot.shape)
                self.space.add(robot.pivot, robot.gear)
        if close:
            self.space.step(self.scene.time_step)

    def read(self) -> None:
        """Copy the states of the robots in the space to the swarm."""
        for i, robot in enumerate(self.robots):
            body = robot.body
            if body.space:
                self.swarm.poses[i, :3] = *body.position, body.angle
                self.swarm.velocities[i] = *body.velocity, body.angular_velocity


def referee_experiment(scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History) -> None:
    """A whole experiment, as `kernel.experiment`."""
    referee = Referee(scene, swarm)
    note_poses, sense_and_control = compiled(kernel.note_poses), compiled(kernel.sense_and_control)
    with np.errstate(over="ignore"):  # plain Python warns where a draw's arithmetic wraps around, as it should
        note_poses(swarm, history, 0)
        for cycle in range(len(history.states)):
            referee.move()
            note_poses(swarm, history, cycle + 1)
            sense_and_control(scene, model, program, swarm, history, cycle)
