"""`mercator-robot ros` with the real ROS 1, on a twin: what other nodes hear of it, and every way in which it stops.

The node is what a user runs, the bundle by the system's Python. Needs roscore, and rospy for /usr/bin/python3
(apt install python3-roslaunch python3-rospy python3-sensor-msgs python3-nav-msgs).
"""

import cmath
import contextlib
import hashlib
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path
from xmlrpc.client import ServerProxy

import numpy as np
import pytest
import yaml

from mercator_design.fleet.bundle import bundle
from tests.processes import LIMIT, wait_until
from tests.twin.processes import events, twin
from tests.twin.ros_client import COLOURS, TOPICS

PYTHON = "/usr/bin/python3"
CLIENT = Path(__file__).parent / "ros_client.py"
POSES = "{shape: poses, poses: [[0, 0, 0.5], [0, -0.5, 0]]}"
SILENCE, MASTER_LOOK = 0.3, 0.5
LATEST = 0.25


def has_ros():
    if shutil.which("roscore") is None or not Path(PYTHON).exists():
        return False
    imports = "import sys, rospy, sensor_msgs.msg, nav_msgs.msg; assert sys.version_info >= (3, 11)"
    return subprocess.run([PYTHON, "-c", imports], capture_output=True, check=False).returncode == 0


pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not has_ros(), reason="needs roscore, and rospy for the system's Python"),
]


class Ros:
    """A roscore and programs that use it."""

    def __init__(self, folder):
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port = probe.getsockname()[1]
        self.uri = f"http://127.0.0.1:{self.port}/"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "ROS", "VIRTUAL"))}
        self._environment = kept | {
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder),
            "TMPDIR": str(folder),
        }
        self.core = self.start("roscore", "-p", str(self.port), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def start(self, *command, **streams):
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
        return subprocess.Popen([*map(str, command)], env=self._environment, text=True, **streams)

    @contextlib.contextmanager
    def client(self, *arguments):
        with self.start(PYTHON, CLIENT, *arguments) as process:
            try:
                yield process
            finally:
                process.kill()

    def is_there(self):
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
            return True
        return False

    def end(self):
        """roscore ends its children, which may take seconds."""
        self.core.terminate()
        self.core.wait(timeout=LIMIT)


@pytest.fixture
def ros(tmp_path):
    ros = Ros(tmp_path)
    try:
        wait_until(ros.is_there)
        yield ros
    finally:
        ros.end()


@pytest.fixture(scope="module")
def pyz(tmp_path_factory):
    file = tmp_path_factory.mktemp("bundle") / "mercator-robot.pyz"
    file.write_bytes(bundle())
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    with twin(folder, 2, "--set", f"placement={POSES}"):
        # A twin on a busy machine is late, which is not tested here.
        settings = yaml.safe_load((folder / "0/robot.yaml").read_text())
        settings["limits"] |= {"rvr": 1.0, "proximity": 2.0, "lidar": 2.0}
        (folder / "robot.yaml").write_text(yaml.safe_dump(settings))
        yield folder


@contextlib.contextmanager
def node(ros, pyz, folder, *arguments):
    """The node of robot 0, once it takes part in ROS."""
    line = [PYTHON, pyz, "ros", "--robot", folder / "robot.yaml", *arguments]
    with ros.start(*line) as process:
        try:
            wait_until(lambda: process.poll() is not None or subscribed(ros))
            assert process.poll() is None, process.stderr.read()
            yield process
        finally:
            process.kill()


def asked(uri, method, *arguments):
    """What a master or a node answers."""
    with ServerProxy(uri) as proxy:
        _, _, answer = getattr(proxy, method)("/test", *arguments)
        return answer


def subscribed(ros):
    _, topics, _ = asked(ros.uri, "getSystemState")
    return any(topic.endswith("/rvr/wheels_speed") for topic, _ in topics)


def wheels(folder):
    return [(event["left"], event["right"]) for event in events(folder, "wheels")]


def rested(folder):
    """When the wheels came to rest, by the system's monotonic clock [s]."""
    (clock,) = events(folder, "clock")
    *_, before, last = events(folder, "wheels")
    assert (last["left"], last["right"]) == (0.0, 0.0)
    assert before["left"] or before["right"]
    return clock["start"] + last["time"]


def md5(text):
    return hashlib.md5(text.encode()).hexdigest()  # noqa: S324 - as ROS has it


HEADER, RANGE, COLOUR = (
    "2176decaecbce78abc3b96ef049fabed",
    "c005c34273dc426c67a020a87bc24148",
    "a29a96539573343b1310c73607334b00",
)
TYPES = {
    # of ROS's own: the sums as its packages have them; of others: from their definitions, in which a type is its sum
    "/rvr/ground_color": ("std_msgs/ColorRGBA", COLOUR, "1"),
    "/rvr/fixed_color": ("std_msgs/ColorRGBA", COLOUR, "1"),
    "/rvr/ambient_light": ("sensor_msgs/Illuminance", "8cf5febb0952fca9d650c3d11a81a188", "1"),
    "/rvr/imu": ("sensor_msgs/Imu", "6a62c6daae103f4ff57a132d6f95cec2", "1"),
    "/rvr/odom": ("nav_msgs/Odometry", "cd5e73d190d741a2f92e81eda573aca7", "1"),
    "/scan": ("sensor_msgs/LaserScan", "90c7ef2dc6895d81024acba2ac42f369", "0"),
    "/ranges": ("teraranger_array/RangeArray", md5(f"{RANGE} ranges\n{HEADER} header"), "0"),
}
HERTZ = {"/rvr/imu": 5.0, "/rvr/ground_color": 5.0, "/scan": 6.95, "/ranges": 6.25}


def heard(client):
    output, error = client.communicate(timeout=LIMIT)
    assert client.returncode == 0, error
    return json.loads(output)


def last(listened, topic):
    _, message = listened[topic]["messages"][-1]
    return message


def yaw(orientation):
    return 2.0 * math.atan2(orientation["z"], orientation["w"])


class TestOthers:
    def test_one_after_the_other(self, ros, pyz, folder):
        """One node through all that goes on, as it takes seconds to start."""
        begins = np.array(events(folder, "poses")[-1]["poses"][0])
        with node(ros, pyz, folder):
            with ros.client("drive", 0.1, 0.2, 20), ros.client("lamps") as lamps, ros.client("listen", 4) as client:
                moving = heard(client)
                assert lamps.stdout.readline().strip() == md5(f"{COLOUR} led_colors")
            wait_until(lambda: wheels(folder)[-1] == (0.0, 0.0))
            time.sleep(0.5)
            with ros.client("listen", 1.5) as client:
                resting = heard(client)
        assert (pytest.approx(0.1), pytest.approx(0.2)) in wheels(folder)
        self.types(moving)
        self.times(moving)
        self.motion(moving)
        self.lamps(folder)
        self.place(resting, begins, *map(np.array, events(folder, "poses")[-1]["poses"]))

    def types(self, moving):
        assert set(moving) == set(TOPICS) == set(TYPES)
        for topic, expected in TYPES.items():
            told = moving[topic]
            assert (told["type"], told["md5sum"], told["latching"]) == expected
            assert told["callerid"] == "/mercator_robot"

    def times(self, moving):
        for topic, hertz in HERTZ.items():
            times = [when for when, _ in moving[topic]["messages"]]
            assert (len(times) - 2) / (times[-1] - times[1]) == pytest.approx(hertz, rel=0.15), topic
        since = time.time() - time.monotonic()
        for topic in set(TOPICS) - {"/rvr/ground_color", "/rvr/fixed_color"}:
            for when, message in moving[topic]["messages"][1:]:
                assert -0.05 < when + since - message["header"]["stamp"] < 0.6, topic

    def motion(self, moving):
        twist = last(moving, "/rvr/odom")["twist"]["twist"]
        assert twist["angular"]["z"] == pytest.approx(0.1 / 0.147, rel=0.02)
        assert math.hypot(twist["linear"]["x"], twist["linear"]["y"]) == pytest.approx(0.15, rel=0.02)
        assert last(moving, "/rvr/imu")["angular_velocity"]["z"] == pytest.approx(0.1 / 0.147, rel=0.02)
        assert last(moving, "/rvr/imu")["linear_acceleration"]["z"] == pytest.approx(9.80665, rel=0.01)

    def lamps(self, folder):
        shown = [event["leds"] for event in events(folder, "leds")]
        front_left, front_right, left, right, back = COLOURS
        off = [0, 0, 0]
        assert [*front_right, *front_left, *off, *off, *left * 2, *right * 2, *back * 2] in [
            leds[:30] for leds in shown
        ]

    def place(self, resting, begins, ends, other):
        """By the poses of the twin: x of positions is to the right of where the robot began, and y forwards."""
        facing = begins[2]
        gone = complex(*(ends - begins)[:2]) / cmath.rect(1.0, facing)
        position = last(resting, "/rvr/odom")["pose"]["pose"]["position"]
        assert (position["x"], position["y"]) == pytest.approx((-gone.imag, gone.real), abs=0.002)
        for orientation in (
            last(resting, "/rvr/odom")["pose"]["pose"]["orientation"],
            last(resting, "/rvr/imu")["orientation"],
        ):
            assert abs(math.remainder(yaw(orientation) - (ends[2] - facing), math.tau)) < 0.002
        away = other[:2] - ends[:2]
        scan = last(resting, "/scan")
        seen = np.flatnonzero(scan["ranges"])
        angles = scan["angle_min"] + seen * scan["angle_increment"]
        bearing = math.atan2(away[1], away[0]) - ends[2]
        assert len(seen) >= 3
        assert max(abs(math.remainder(angle - bearing, math.tau)) for angle in angles) < 0.15
        assert min(np.array(scan["ranges"])[seen]) == pytest.approx(math.hypot(*away) - 0.035, abs=0.02)
        ranges = [each["range"] for each in last(resting, "/ranges")["ranges"]]
        assert len(ranges) == 8
        assert all(0.05 <= each <= 2.0 or math.isinf(each) for each in ranges)


def killed_by_its_name(ros, process, client):
    """As rosnode kill does it."""
    uri = asked(ros.uri, "lookupNode", "/mercator_robot")
    began = time.monotonic()
    with contextlib.suppress(OSError):  # it may have gone before it answers
        asked(uri, "shutdown", "user request")
    return began


def roscore_ends(ros, process, client):
    ros.core.terminate()
    while ros.is_there():
        time.sleep(0.005)
    return time.monotonic()


def roscore_is_suspended(ros, process, client):
    pid, began = asked(ros.uri, "getPid"), time.monotonic()
    os.kill(pid, signal.SIGSTOP)
    threading.Timer(12.0, os.kill, (pid, signal.SIGCONT)).start()  # long after the node has ended; roscore ends awake
    return began


def tells(*values):
    def act(ros, process, client):
        with ros.client("say", *values) as other:
            return float(other.stdout.readline())

    return act


def signalled(number):
    def act(ros, process, client):
        began = time.monotonic()
        process.send_signal(number)
        return began

    return act


def nobody_drives(ros, process, client):
    began = time.monotonic()
    client.kill()
    return began


WAYS = {
    # what happens: how, seconds that it may go on, exit code, what is said
    "rosnode kill": (killed_by_its_name, 0.0, 4, "ros: the node was shut down"),
    "roscore ends": (roscore_ends, MASTER_LOOK, 4, "ros: no master at http://127.0.0.1:"),
    "roscore suspended": (roscore_is_suspended, MASTER_LOOK + 2.0, 4, "ros: no master at http://127.0.0.1:"),
    "not a number": (tells("nan", 0.1), 0.0, 4, "wheels: expected speeds from -0.3 to 0.3 m/s, found nan, 0.1"),
    "too fast": (tells(0.1, 0.31), 0.0, 4, "found 0.1, 0.31"),
    "too many": (tells(0.1, 0.1, 0.1), 0.0, 4, "rvr/wheels_speed: expected 2 speeds, found 3"),
    "SIGTERM": (signalled(signal.SIGTERM), 0.0, 143, "Stopped by SIGTERM."),
    "SIGINT": (signalled(signal.SIGINT), 0.0, 130, "Stopped by SIGINT."),
    "SIGHUP": (signalled(signal.SIGHUP), 0.0, 129, "Stopped by SIGHUP."),
    "SIGKILL": (signalled(signal.SIGKILL), 0.05, -9, ""),  # 300 ms by the firmware
    "nobody drives": (nobody_drives, SILENCE, None, ""),
}


@pytest.mark.parametrize("what", WAYS)
def test_ways_to_stop(ros, pyz, folder, what):
    act, allowed, code, words = WAYS[what]
    with node(ros, pyz, folder) as process, ros.client("drive", 0.1, 0.2, 20) as client:
        wait_until(lambda: wheels(folder)[-1] != (0.0, 0.0) or process.poll() is not None)
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.5)
        began = act(ros, process, client)
        wait_until(lambda: wheels(folder)[-1] == (0.0, 0.0))
        if code is not None:
            _, error = process.communicate(timeout=LIMIT)
            assert (process.returncode, words in error, "Traceback" in error) == (code, True, False), error
        else:
            time.sleep(0.5)
            assert process.poll() is None, process.stderr.read()
    assert rested(folder) - began <= allowed + LATEST


def test_in_a_namespace(ros, pyz, folder):
    with node(ros, pyz, folder, "__ns:=robot1", "__name:=left", "rvr/imu:=imu"):
        published, listened, _ = asked(ros.uri, "getSystemState")
    ours = {topic for topic, nodes in published if "/robot1/left" in nodes}
    assert ours - {"/rosout"} == {
        *(f"/robot1/rvr/{name}" for name in ("ground_color", "fixed_color", "ambient_light", "odom")),
        *("/robot1/imu", "/robot1/scan", "/robot1/ranges"),
    }
    assert {"/robot1/rvr/wheels_speed", "/robot1/rvr/rgb_leds"} <= {topic for topic, _ in listened}


def test_without_a_master(pyz):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment["ROS_MASTER_URI"] = "http://127.0.0.1:1/"
    done = subprocess.run([PYTHON, pyz, "ros"], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("Error: ros: no master at http://127.0.0.1:1/: ")
