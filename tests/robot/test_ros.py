"""The robot as a node of ROS, with plain objects in the place of ROS; tests/twin/test_ros.py has the real one."""

import math
import socket
import threading
import time
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
import pytest

from mercator_design.errors import RobotError, RobotStopped
from mercator_design.robot.devices.samples import STREAMED, Sample, converted
from mercator_design.robot.devices.settings import Settings, SwarmSettings
from mercator_design.robot.devices.sweep import BINS, Sweep
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import StreamData
from mercator_design.robot.protocols.ydlidar import Packet
from mercator_design.robot.ros import messages
from mercator_design.robot.ros import node as ros
from mercator_design.robot.ros.messages import PUBLISHED
from mercator_design.robot.ros.node import Orders, Reports, RosNode, serve
from mercator_design.robot.run import safety
from tests.processes import LIMIT, wait_until
from tests.robot.devices import CLEAR
from tests.robot.lines import QUIET
from tests.robot.ways import asked

LATEST = 0.25
"""[s] from what is found to wheels at rest."""


def sampled(**streamed):
    """Samples of what the RVR streams."""
    values = {name: QUIET[name] | streamed.get(name, {}) for name in STREAMED}
    found = converted(StreamData(Processor.ST, 1, is_valid=True, values=values))
    return {name: Sample(1.0, each) for name, each in found}


def turned(q, vector):
    """A vector, turned by a quaternion."""
    u, v = np.array([q["x"], q["y"], q["z"]]), np.array(vector)
    return v + 2.0 * np.cross(u, np.cross(u, v) + q["w"] * v)


class TestMessages:
    def test_imu_has_the_axes_of_the_rvr(self):
        vector = {"x": 0.25, "y": 0.5, "z": 1.0}
        found = messages.imu(12.5, sampled(accelerometer=vector, gyroscope=vector))
        assert found["header"] == {"stamp": {"secs": 12, "nsecs": 500_000_000}, "frame_id": ""}
        assert found["angular_velocity"] == pytest.approx({name: math.radians(v) for name, v in vector.items()})
        assert found["linear_acceleration"] == pytest.approx({name: 9.80665 * v for name, v in vector.items()})

    def test_orientation_turns_by_roll_then_pitch_then_yaw(self):
        roll, pitch, yaw = 20.0, 10.0, 90.0
        q = messages.imu(0.0, sampled(imu={"roll": roll, "pitch": pitch, "yaw": yaw}))["orientation"]
        cr, cp, cy = np.cos(np.radians([roll, pitch, yaw]))
        sr, sp, sy = np.sin(np.radians([roll, pitch, yaw]))
        about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        for axis in np.eye(3):
            assert turned(q, axis) == pytest.approx(about_z @ about_y @ about_x @ axis)

    def test_odometry(self):
        place, q, speed = {"x": 1.0, "y": 2.0}, {"w": 0.1, "x": 0.2, "y": 0.3, "z": 0.4}, {"x": -0.1, "y": 0.3}
        turning = {"x": 10.0, "y": 20.0, "z": 30.0}
        found = messages.odometry(3.0, sampled(locator=place, quaternion=q, velocity=speed, gyroscope=turning))
        pose, twist = found["pose"]["pose"], found["twist"]["twist"]
        assert pose == {"position": place | {"z": 0.0}, "orientation": q}
        assert twist["linear"] == speed | {"z": 0.0}
        assert twist["angular"] == pytest.approx({name: math.radians(v) for name, v in turning.items()})

    def test_light_and_colours(self):
        assert messages.illuminance(1.0, Sample(0.0, (500.0,)))["illuminance"] == 500.0
        assert messages.colour((1, 2, 3)) == {"r": 1, "g": 2, "b": 3, "a": 255.0}

    def test_times_before_the_epoch_of_a_clock_that_has_not_begun(self):
        assert messages.header(-5.0)["stamp"] == {"secs": 0, "nsecs": 0}

    @pytest.mark.parametrize("degrees", range(-180, 180, 15))
    def test_a_scan_begins_at_the_back_and_is_counter_clockwise(self, degrees):
        ring = [0.0] * BINS
        ring[degrees * 4 % BINS] = 1.5
        found = messages.scan(1.0, ring, 0.14)
        (place,) = np.flatnonzero(found["ranges"])
        assert found["ranges"][place] == 1.5
        apart = found["angle_min"] + place * found["angle_increment"] - math.radians(degrees)
        assert abs(apart) <= 0.51 * found["angle_increment"]

    def test_what_a_scan_says_of_itself(self):
        found = messages.scan(1.0, [2.0] * BINS, 0.14)
        assert found["header"]["frame_id"] == "laser_frame"
        assert (found["angle_min"], found["angle_max"]) == (-math.pi, math.pi)
        assert len(found["ranges"]) == len(found["intensities"]) == 720
        assert set(found["ranges"]) == {2.0}
        assert found["angle_min"] + 719 * found["angle_increment"] == pytest.approx(math.pi)
        assert (found["scan_time"], found["time_increment"] * 719) == (0.14, pytest.approx(0.14))

    def test_a_scan_has_the_nearer_of_two_and_nothing_beyond_its_limits(self):
        found = messages.scan(1.0, [3.0, 2.0] * (BINS // 2), 0.14)["ranges"]
        assert found.count(2.0) > 700
        ring = [0.0] * BINS
        ring[0], ring[400], ring[800] = 0.09, 12.1, 0.1
        assert [r for r in messages.scan(1.0, ring, 0.14)["ranges"] if r] == [0.1]

    def test_ranges(self):
        found = messages.range_array(2.0, [math.inf, -math.inf, *[0.5] * 6])
        assert found["header"]["frame_id"] == "base_hub"
        assert [each["range"] for each in found["ranges"]] == [math.inf, -math.inf, *[0.5] * 6]
        assert [each["header"]["frame_id"] for each in found["ranges"]] == [f"base_range_{k}" for k in range(8)]
        last = found["ranges"][-1]
        assert (last["radiation_type"], last["field_of_view"]) == (1, 0.2967)
        assert (last["min_range"], last["max_range"]) == (0.05, 2.0)

    def test_frames_of_ranges_in_a_namespace(self):
        found = messages.range_array(2.0, [0.5] * 8, "robot1")
        assert found["header"]["frame_id"] == "base_robot1"
        assert found["ranges"][2]["header"]["frame_id"] == "robot1_base_range_2"


def speeds(*values):
    return SimpleNamespace(data=values)


def leds(*colours):
    return SimpleNamespace(led_colors=[SimpleNamespace(**dict(zip("rgb", colour, strict=True))) for colour in colours])


@pytest.fixture
def said():
    return []


@pytest.fixture
def orders(said):
    brake = safety.Brake(lambda _: None, lambda *_: b"", b"", 0.3)
    return Orders(brake, 0.3, said.append)


@pytest.fixture
def still(monkeypatch):
    """No time passes."""
    monkeypatch.setattr(time, "monotonic", lambda: 1000.0)


@pytest.mark.usefixtures("still")
class TestOrders:
    def test_speeds_are_not_rounded_to_centimetres(self, orders):
        orders.take_speeds(speeds(0.1, 0.2))
        orders.take_speeds(speeds(-0.1234, np.float32(0.3)))  # more than 0.3
        assert orders.speeds(time.monotonic()) == (-0.1234, 0.3)

    def test_one_message_alone_may_be_from_long_ago(self, orders):
        orders.take_speeds(speeds(0.1, 0.2))
        assert orders.speeds(time.monotonic()) == (0.0, 0.0)

    def test_silence(self, orders):
        for _ in range(2):
            orders.take_speeds(speeds(0.1, 0.2))
        assert orders.speeds(time.monotonic() + 0.2) == (0.1, 0.2)
        assert orders.speeds(time.monotonic() + 0.31) == (0.0, 0.0)

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ((math.nan, 0.1), "expected speeds from -0.3 to 0.3 m/s, found nan, 0.1"),
            ((0.1, -math.inf), "found 0.1, -inf"),
            ((0.31, 0.0), "found 0.31, 0"),
            ((0.1,), "rvr/wheels_speed: expected 2 speeds, found 1"),
            ((), "expected 2 speeds, found 0"),
            ((0.1, 0.1, 0.1), "expected 2 speeds, found 3"),
        ],
    )
    def test_what_cannot_be_obeyed_stops_the_wheels_for_good(self, orders, values, words):
        for each in ((0.1, 0.1), values, (0.1, 0.1)):
            orders.take_speeds(speeds(*each))
        with pytest.raises(RobotStopped) as stop:
            orders._brake.drive(0.0, 0.0)
        assert words in str(stop.value)

    def test_lamps(self, orders, said):
        orders.take_colours(leds((1, 2, 3), (4, 5, 6), (7, 8, 9), (10, 11, 12), (13.7, 14, 15)))
        assert orders.colours == {
            "headlight_left": (1, 2, 3),
            "headlight_right": (4, 5, 6),
            "battery_door_front": (7, 8, 9),
            "battery_door_rear": (7, 8, 9),
            "power_button_front": (10, 11, 12),
            "power_button_rear": (10, 11, 12),
            "brakelight_left": (13, 14, 15),
            "brakelight_right": (13, 14, 15),
            "status_indication_left": (0, 0, 0),
            "status_indication_right": (0, 0, 0),
        }
        assert not said

    @pytest.mark.parametrize("level", [-1.0, 256.0, math.nan])
    def test_levels_that_there_are_not_are_ignored_and_told_once(self, orders, said, level):
        before = orders.colours
        for _ in range(2):
            orders.take_colours(leds(*[(1, 2, 3)] * 4, (0.0, level, 0.0)))
        assert orders.colours == before
        assert said == [f"rvr/rgb_leds: expected levels from 0 to 255, found (0.0, {level}, 0.0); ignored"]


class TestReports:
    """What is due, of a robot that is given."""

    @pytest.fixture
    def robot(self):
        lidar, hub = Sample(0.9, ()), Sample(0.9, (0.5,) * 8)
        return SimpleNamespace(samples={**sampled(), "lidar": lidar, "proximity": hub}, label=lambda: "white")

    def test_a_scan_has_the_time_of_its_beginning(self, robot):
        sweep = Sweep()
        reports = Reports(robot, sweep, "", 5.0)
        assert "scan" not in dict(reports.due(1.0, 1001.0))  # nobody knows when this one began
        robot.samples["lidar"] = Sample(1.05, ())
        assert "scan" not in dict(reports.due(1.1, 1001.1))  # not all of a turn was heard
        for k in range(10):
            sweep.add(Packet(0, 360 * 64 - 64, (4000,) * 40, is_ring_start=k == 0))
        robot.samples["lidar"] = Sample(1.2, ())
        found = dict(reports.due(1.3, 1001.3))["scan"]
        assert found["header"]["stamp"]["secs"] + 1e-9 * found["header"]["stamp"]["nsecs"] == pytest.approx(1001.05)
        assert found["scan_time"] == pytest.approx(0.15)

    @pytest.mark.parametrize(
        ("sensor", "left_out"),
        [
            ("ambient_light", {"rvr/ambient_light"}),
            ("ground", {"rvr/ground_color", "rvr/fixed_color"}),
            ("acceleration", {"rvr/imu"}),
            ("turning", {"rvr/imu", "rvr/odom"}),
            ("position", {"rvr/odom"}),
        ],
    )
    def test_a_sensor_that_the_rvr_does_not_stream_is_left_out(self, robot, sensor, left_out):
        usual = dict(Reports(robot, Sweep(), "", 5.0).due(1.0, 1.0)).keys()
        del robot.samples[sensor]
        assert dict(Reports(robot, Sweep(), "", 5.0).due(1.0, 1.0)).keys() == usual - left_out
        assert left_out < usual

    def test_a_rate_that_is_no_part_of_the_cycles(self, robot):
        reports = Reports(robot, Sweep(), "", 4.0)
        told = [topic for k in range(100) for topic, _ in reports.due(0.1 * k, 0.1 * k)]
        assert told.count("rvr/imu") == pytest.approx(40, abs=1)


class FakeNode:
    """In the place of `RosNode`: what a test wants is done, in steps with pauses [s], then the robot is stopped."""

    name, namespace = "/mercator_robot", ""

    def __init__(self, devices, act):
        self.published, self._devices, self._act = [], devices, act

    def publish(self, topic, fields):
        self.published.append((time.monotonic(), topic, fields))

    def now(self):
        return 1000.0 + time.monotonic()

    def obey(self, brake, orders):
        def steps():
            yield from self._act(orders)
            yield 0.1
            brake.stop("the test is over")
            yield math.inf

        pauses, due = steps(), self._devices.now

        def step():
            nonlocal due
            if self._devices.now >= due:
                due += next(pauses)

        self._devices.each_tick.append(step)

    def of(self, name):
        return [(when, fields) for when, topic, fields in self.published if topic == name]


def served(devices, act, words="the test is over", rate=5.0):
    """A node on devices, until it has ended as expected; and what it said."""
    node, said = FakeNode(devices, act), []
    with pytest.raises(RobotStopped, match=words):
        serve(Settings(ports=devices.names, swarm=SwarmSettings(port=None)), node, rate, 0.3, said.append)
    return node, said


def go(orders, left, right, seconds):
    """Tell speeds at 20 Hz."""
    for _ in range(round(20 * seconds)):
        orders.take_speeds(speeds(left, right))
        yield 0.05


class TestServe:
    def test_from_start_to_end(self, simulated):
        """One node, through all that goes on."""
        silent = []
        simulated.measured |= {"ground_sensors": (250, 251, 252), "proximity": [math.inf, 0.123, *CLEAR[2:]]}
        simulated.heads = [(math.pi / 2, 0.5)]

        def act(orders):
            orders.take_colours(leds(*[(9, 8, 7)] * 5))
            yield from go(orders, 0.1, 0.25, 0.6)
            silent.append(time.monotonic())
            yield 0.7
            yield from go(orders, -0.2, -0.1, 0.5)

        node, said = served(simulated, act)
        self.wheels(simulated, silent[0])
        self.lamps(simulated)
        self.what_is_published(node)
        assert asked(simulated) >= 2
        assert said[0].startswith("mercator: ")

    def wheels(self, devices, silent):
        driven = [each for each in devices.wheels if any(each[1:])]
        assert {(round(left, 6), round(right, 6)) for _, left, right in driven} == {(0.1, 0.25), (-0.2, -0.1)}
        rests = next(when for when, left, _ in devices.wheels if when > silent and left == 0.0)
        assert 0.2 < rests - silent < 0.3 + LATEST
        assert [name for _, name, _ in devices.commands].count("drive_stop") >= 2

    def lamps(self, devices):
        shown = [values for _, name, values in devices.commands if name == "set_all_leds"]
        assert bytes(shown[-1]["led_brightness_values"]).count(bytes((9, 8, 7))) == 8

    def what_is_published(self, node):
        assert {topic for _, topic, _ in node.published} == set(PUBLISHED)
        times = [when for when, _ in node.of("rvr/imu")]
        assert np.median(np.diff(times)) == pytest.approx(0.2, abs=0.05)
        for topic in ("scan", "ranges"):
            stamps = [fields["header"]["stamp"] for _, fields in node.of(topic)]
            seconds = [stamp["secs"] + 1e-9 * stamp["nsecs"] for stamp in stamps]
            assert len(seconds) > 3
            assert min(np.diff(seconds)) > 0.02  # each once
        when, imu = node.of("rvr/imu")[-1]
        assert 0.0 <= when + 1000.0 - imu["header"]["stamp"]["secs"] - 1e-9 * imu["header"]["stamp"]["nsecs"] < 1.0
        assert node.of("rvr/ground_color")[-1][1] == {"r": 250.0, "g": 251.0, "b": 252.0, "a": 255.0}
        assert node.of("rvr/fixed_color")[-1][1] == {"r": 255.0, "g": 255.0, "b": 255.0, "a": 255.0}
        assert [each["range"] for each in node.of("ranges")[-1][1]["ranges"]] == [math.inf, 0.123, *[math.inf] * 6]
        _, scan = node.of("scan")[-1]
        seen = np.flatnonzero(scan["ranges"])
        assert np.mean(seen) * scan["angle_increment"] - math.pi == pytest.approx(math.pi / 2, abs=0.02)
        assert scan["ranges"][seen[0]] == pytest.approx(0.5, abs=0.01)
        assert 0.1 < scan["scan_time"] < 1.0

    def test_a_message_that_cannot_be_obeyed(self, simulated):
        began = []

        def act(orders):
            yield from go(orders, 0.1, 0.1, 0.5)
            began.append(time.monotonic())
            orders.take_speeds(speeds(0.1, math.nan))
            yield 0.5

        served(simulated, act, r"wheels: expected speeds from -0\.3 to 0\.3 m/s, found 0\.1, nan")
        assert simulated.rests_since() - began[0] <= LATEST

    def test_a_silent_sensor(self, simulated):
        began = []

        def act(orders):
            yield from go(orders, 0.1, 0.1, 0.5)
            simulated.silent.add("lidar")
            began.append(time.monotonic())
            yield from go(orders, 0.1, 0.1, 2.0)

        served(simulated, act, "lidar: nothing for")
        assert simulated.rests_since() - began[0] <= 0.6 + LATEST


class FakeRos:
    """In the place of ROS's modules, with a master to be found."""

    ROSException = RuntimeError

    def __init__(self):
        self.master = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self.master.register_function(lambda _: (1, "", 1234), "getPid")
        self.port = self.master.server_address[1]
        threading.Thread(target=self.master.serve_forever, args=(0.01,)).start()
        self.made, self.published, self.subscribed, self.hooks, self.definitions = {}, [], {}, [], {}
        self.on_shutdown = self.hooks.append
        self.message = self.dynamic = self.msg = self

    def module(self, name):
        return self

    def __getattr__(self, name):
        """Types of messages."""
        if not name[:1].isupper():
            raise AttributeError(name)
        return type(name, (), {"_full_text": f"text of {name}"})

    def get_master_uri(self):
        return f"http://127.0.0.1:{self.port}/"

    def get_name(self):
        return "/robot1/mercator_robot"

    def get_namespace(self):
        return "/robot1/"

    def get_time(self):
        return 5.0

    def go(self):
        self.master.shutdown()
        self.master.server_close()

    def signal_shutdown(self, reason):
        self.is_shut_down = True

    def init_node(self, name, *, disable_signals):
        assert (name, disable_signals) == ("mercator_robot", True)

    def Publisher(self, name, kind, *, queue_size, latch):  # noqa: N802 - as ROS has it
        self.made[name] = kind.__name__, queue_size, latch
        return SimpleNamespace(publish=lambda message: self.published.append((name, message)))

    def Subscriber(self, name, kind, callback, *, queue_size):  # noqa: N802
        self.subscribed[name] = kind.__name__, callback

    def generate_dynamic(self, name, definition):
        self.definitions[name] = definition
        return {name: type(name.partition("/")[2], (), {})}

    def fill_message_args(self, message, arguments):
        (message.fields,) = arguments


@pytest.fixture
def fake(monkeypatch):
    fake = FakeRos()
    monkeypatch.setattr(ros, "load_module", fake.module)
    monkeypatch.setattr(ros, "raise_priority", lambda _: None)
    for limit in ("MASTER_WAIT", "REGISTER_WAIT", "LEAVE_WAIT"):
        monkeypatch.setattr(ros, limit, LIMIT)
    yield fake
    fake.go()


class TestNode:
    def test_topics(self, fake):
        node = RosNode()
        assert fake.made == {
            "rvr/ground_color": ("ColorRGBA", 10, True),
            "rvr/fixed_color": ("ColorRGBA", 10, True),
            "rvr/ambient_light": ("Illuminance", 10, True),
            "rvr/imu": ("Imu", 10, True),
            "rvr/odom": ("Odometry", 10, True),
            "scan": ("LaserScan", 1, False),
            "ranges": ("RangeArray", 1, False),
        }
        assert (node.name, node.namespace, node.now()) == ("/robot1/mercator_robot", "robot1", 5.0)
        node.publish("scan", {"ranges": [1.0]})
        ((topic, message),) = fake.published
        assert (topic, type(message).__name__, message.fields) == ("scan", "LaserScan", {"ranges": [1.0]})

    def test_types_that_are_made_have_all_definitions(self, fake):
        RosNode()
        assert fake.definitions == {
            "teraranger_array/RangeArray": f"sensor_msgs/Range[] ranges\nHeader header\n\n{80 * '='}\n"
            "MSG: sensor_msgs/Range\ntext of Range",
            "rvr_ros/Leds": f"std_msgs/ColorRGBA[5] led_colors\n{80 * '='}\nMSG: std_msgs/ColorRGBA\ntext of ColorRGBA",
        }

    def test_what_is_obeyed_and_what_ends_that(self, fake, orders, request):
        RosNode().obey(orders._brake, orders)
        (kind, take), (leds_kind, _) = fake.subscribed["rvr/wheels_speed"], fake.subscribed["rvr/rgb_leds"]
        assert (kind, leds_kind) == ("Float32MultiArray", "Leds")
        request.getfixturevalue("still")
        for _ in range(2):
            take(speeds(0.1, 0.2))
        assert orders.speeds(time.monotonic()) == (0.1, 0.2)
        (shut_down,) = fake.hooks
        shut_down()
        assert orders._brake.why == "ros: the node was shut down"

    def test_a_master_that_goes(self, fake, orders):
        RosNode().obey(orders._brake, orders)
        time.sleep(0.1)
        assert not orders._brake.why
        fake.go()
        wait_until(lambda: orders._brake.why)
        assert orders._brake.why.startswith(f"ros: no master at http://127.0.0.1:{fake.port}/: ")

    @pytest.mark.parametrize(
        "value", ["<int>x</int>", "<struct><member><value/></member></struct>", "<double>-</double>"]
    )
    def test_a_master_whose_answers_make_no_sense(self, fake, orders, value):
        node = RosNode()
        answer = f"<methodResponse><params><param><value>{value}</value></param></params></methodResponse>"
        fake.master._marshaled_dispatch = lambda *_: answer.encode()
        node._watch_master(orders._brake)
        assert orders._brake.why.startswith(f"ros: no master at http://127.0.0.1:{fake.port}/: ")

    def test_a_master_that_goes_while_the_robot_starts(self, fake, orders):
        node = RosNode()
        fake.go()
        with pytest.raises(RobotError, match="ros: no master at "):
            node.obey(orders._brake, orders)
        assert not fake.subscribed

    def test_no_master(self, fake):
        fake.go()
        with pytest.raises(RobotError, match=r"ros: no master at http://127\.0\.0\.1:.*; does roscore run there\?"):
            RosNode()

    @pytest.mark.parametrize("uri", ["here", "http://here:port/"])
    def test_a_master_s_address_that_is_none(self, fake, uri):
        fake.get_master_uri = lambda: uri
        with pytest.raises(RobotError, match="ros: "):
            RosNode()


class TestMastersThatDoNotAnswer:
    @pytest.fixture
    def silent(self, fake):
        """One that accepts, and says no more."""
        with socket.create_server(("127.0.0.1", 0)) as master:
            yield f"http://127.0.0.1:{master.getsockname()[1]}/"

    def test_at_the_start(self, fake, silent, monkeypatch):
        monkeypatch.setattr(ros, "MASTER_WAIT", 0.3)
        fake.get_master_uri = lambda: silent
        with pytest.raises(RobotError, match=r"ros: no master at .*: timed out; does roscore run there\?"):
            RosNode()

    def test_later(self, fake, silent, orders, monkeypatch):
        node = RosNode()
        node.obey(orders._brake, orders)
        node._master = silent
        monkeypatch.setattr(ros, "MASTER_WAIT", 0.3)
        wait_until(lambda: orders._brake.why)
        assert orders._brake.why.startswith(f"ros: no master at {silent}: timed out")

    @pytest.mark.parametrize("what", ["init_node", "Publisher", "Subscriber"])
    def test_rospy_that_keeps_trying(self, fake, orders, monkeypatch, what):
        over = threading.Event()
        monkeypatch.setattr(ros, "REGISTER_WAIT", 0.2)
        setattr(fake, what, lambda *_, **__: over.wait(LIMIT))
        with pytest.raises(RobotError, match=r"ros: the master at .* does not answer any more"):
            RosNode().obey(orders._brake, orders)
        over.set()
        assert fake.is_shut_down

    def test_rospy_that_cannot_leave(self, fake, monkeypatch):
        over = threading.Event()
        monkeypatch.setattr(ros, "LEAVE_WAIT", 0.2)
        node = RosNode()
        fake.signal_shutdown = lambda _: over.wait(LIMIT)
        began = time.monotonic()
        node.close()
        assert 0.2 <= time.monotonic() - began < LIMIT
        over.set()

    def test_what_answers_is_no_master(self, fake):
        fake.master.funcs.clear()
        with pytest.raises(RobotError, match=r"ros: no master at .*getPid"):
            RosNode()


def test_without_ros(robot_command, monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(f"No module named '{name}'")

    monkeypatch.setattr(ros, "load_module", absent)
    monkeypatch.setattr(ros, "raise_priority", lambda _: None)
    code, out, err = robot_command("ros")
    assert (code, out) == (1, "")
    assert err.startswith("Error: ros: No module named 'rospy'; on Debian and Ubuntu: apt install python3-rospy ")


def test_what_is_no_remapping(robot_command):
    code, _, err = robot_command("ros", "__ns:=robot1", "robot2")
    assert code == 2
    assert "expected a remapping, NAME:=NAME, found 'robot2'" in err
