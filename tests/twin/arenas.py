"""Small arenas for tests, and a client's end of a robot's lines."""

from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.twin.arena import TwinArena, without_noise
from mercator_design.twin.twin import Twin
from tests.sim.worlds import at, mission

MERCATOR = load_robot_model("mercator")
QUIET = without_noise(MERCATOR)


def arena(*poses, robot_model=QUIET, seed=1, **given):
    """An arena with robots at exact poses."""
    return TwinArena(mission(robots=len(poses), placement=at(*poses), **given), robot_model, seed)


class Talk:
    """A twin without ports, with a client's end of the lines of its robot 0, and a log."""

    def __init__(self, *poses, script=None, **given):
        self.log = []
        self.arena = arena(*(poses or [(0.0, 0.0, 0.0)]), **given)
        self.twin = Twin(self.arena, script, self.log.append)
        self.robot = self.twin.robots[0]
        self.host, self.now = rvr.Host(), 0.0
        self.ends = {"rvr": self.host, "lidar": ydlidar.decoder(), "proximity": multiflex.decoder()}

    def send(self, name, /, **values):
        """What robot 0's RVR says to a command."""
        return self.hear("rvr", self.host.send(name, **values))

    def hear(self, device, data):
        """What a device of robot 0 says to these bytes."""
        return self.ends[device].receive(self.robot.receive(device, data, self.now))

    def wait(self, seconds):
        """What the devices of robot 0 say in the meantime."""
        said = {device: [] for device in self.ends}
        for _ in range(round(100 * seconds)):
            self.now = round(self.now + 0.01, 6)
            for number, device, data in self.twin.advance(self.now):
                if number == 0:
                    said[device] += self.ends[device].receive(data)
        return said

    def drive(self, left, right, seconds):
        """Drive for some time, a command every 100 ms; what the devices say."""
        said = {device: [] for device in self.ends}
        for _ in range(round(10 * seconds)):
            self.send("drive_tank_si_units", left_velocity=left, right_velocity=right)
            for device, events in self.wait(0.1).items():
                said[device] += events
        return said

    def events(self, name):
        """What was logged of a kind of event."""
        return [event for event in self.log if event["event"] == name]
