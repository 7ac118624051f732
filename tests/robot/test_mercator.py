"""What the robot makes of what its devices tell, and how it is started up and shut down, in simulated time."""

import math
import socket
import time
from contextlib import closing, contextmanager

import pytest

from mercator_design.errors import RobotError, RobotStopped
from mercator_design.fsm import Readings, ReferenceModel, drive
from mercator_design.modules.perception import proximity_weight
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.ports import DEVICES, PortNames, open_ports
from mercator_design.robot.devices.samples import SERVICE_OF, STREAMED, converted
from mercator_design.robot.devices.settings import COMMANDS_END, Limits, Settings
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr import Response, RvrEnd
from mercator_design.robot.protocols.rvr_messages import COMMANDS, LIGHTS, Error, Processor
from mercator_design.robot.protocols.rvr_streaming import StreamData
from mercator_design.robot.run import mercator
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.run.monitor import Monitor
from mercator_design.robot.run.senses import Senses
from mercator_design.sim.robot_model import load_robot_model
from tests.robot.devices import CLEAR
from tests.robot.lines import QUIET
from tests.robot.simulated import SimulatedPort

SENSES = ("proximity", "neighbours", "ground")
DISPENSABLE = (
    "enable_battery_voltage_state_change_notify",
    "enable_motor_fault_notify",
    "enable_motor_stall_notify",
    "enable_motor_thermal_protection_status_notify",
    "reset_yaw",
    "reset_locator_x_and_y",
)
"""Commands of the start that inform people, who are told if the RVR refuses them."""
NEAR = ReferenceModel().neighbour_range


@contextmanager
def robot_on(devices, reads=SENSES, extra=(), **settings):
    settings = Settings(ports=devices.names, **settings)
    labels = settings.labels_of({})
    with open_ports(settings.ports) as opened, closing(Mercator(settings, opened, reads, labels, extra)) as robot:
        robot.start()
        yield robot


@pytest.fixture
def devices(simulated):
    return simulated


def told(robot, seconds=0.3):
    """What the robot perceives once the devices have told it."""
    robot.attend(time.monotonic() + seconds)
    return robot.readings()


class TestReadings:
    def test_one_after_the_other(self, devices):
        """One robot through all senses, as it takes a second to start."""
        with robot_on(devices, extra=SERVICE_OF) as robot:
            self.nothing_in_sight(robot)
            self.axes(devices, robot)
            self.ground(devices, robot)
            self.obstacles(devices, robot)
            self.robots(devices, robot)
            self.robots_after_a_turn(devices, robot)

    def nothing_in_sight(self, robot):
        expected = Readings(ground_red=0.0, ground_green=0.0, ground_blue=0.0)
        assert tuple(told(robot)) == pytest.approx(tuple(expected), abs=1e-5)  # lines have rounded numbers

    def axes(self, devices, robot):
        """What is to the right, forwards and up on the line is forwards, to the left and up here."""
        right_forwards_up, degree = (0.25, 0.5, 1.0), math.pi / 180.0
        devices.measured |= {
            "accelerometer": right_forwards_up,
            "gyroscope": [degree * turn for turn in right_forwards_up],
            "locator": (0.5, -0.25),  # of an arena, in which the robot faced +x
            "velocity": right_forwards_up[:2],
            "quaternion": (0.1, 0.2, 0.3, 0.4),
            "imu": (10.0 * degree, 20.0 * degree, 90.0 * degree),
            "ambient_light": (500.0,),
        }
        told(robot)
        values = {name: sample.values for name, sample in robot.senses.samples.items()}
        expected = {
            "acceleration": (0.5 * 9.80665, -0.25 * 9.80665, 9.80665),
            "turning": (0.5 * degree, -0.25 * degree, degree),
            "position": (0.5, -0.25),
            "velocity": (0.5, -0.25),
            "orientation": (0.1, 0.3, -0.2, 0.4),
            "attitude": (20.0 * degree, -10.0 * degree, 90.0 * degree),
            "ambient_light": (500.0,),
        }
        for name, vector in expected.items():
            assert values[name] == pytest.approx(vector, abs=2e-5), name

    def ground(self, devices, robot):
        devices.measured["ground_sensors"] = 190, 200, 30
        assert told(robot)[5:8] == (255.0, 255.0, 0.0)
        assert robot.senses.samples["ground"].values == (190, 200, 30)

    def obstacles(self, devices, robot):
        """Sensor 7 looks to the left; less than 0.05 m is too near, more than 2 m too far."""
        devices.measured["proximity"] = [2.5, math.inf, 2.0, 0.401, *[math.inf] * 3, 0.2]
        readings = told(robot)
        weight = proximity_weight(ReferenceModel(), 0.2)
        assert (readings.proximity_x, readings.proximity_y) == pytest.approx((0.0, weight))
        devices.measured["proximity"] = [math.inf, 0.03, *CLEAR[2:]]
        assert told(robot)[:2] == pytest.approx((1.0, 0.0))

    def robots(self, devices, robot):
        """One in front, over the end of the ring; one to the left and behind; one that is too far."""
        devices.heads = [(0.01, 0.4), (2.5, 0.7), (-2.0, NEAR + 0.1)]
        readings = told(robot, 0.6)
        assert readings.neighbours == 2
        places = sorted(robot.senses.neighbours)
        assert places[0] == pytest.approx((0.4, 0.01), abs=0.01)
        assert places[1] == pytest.approx((0.7, 2.5), abs=0.01)
        pulls = [(1 / 1.4, 0.01), (1 / 1.7, 2.5)]
        x = sum(weight * math.cos(angle) for weight, angle in pulls)
        y = sum(weight * math.sin(angle) for weight, angle in pulls)
        assert (readings.neighbours_x, readings.neighbours_y) == pytest.approx((x, y), abs=0.01)

    def test_where_its_sensors_look(self, devices):
        """As the settings say, which are turned here: the hub's sensors to the right, the lidar to the left."""
        right, left = -math.pi / 2.0, math.pi / 2.0
        angles = tuple(angle + right for angle in Settings().proximity_angles)
        with robot_on(devices, proximity_angles=angles, lidar_angle=left) as robot:
            devices.measured["proximity"] = [math.inf, 0.2, *CLEAR[2:]]
            devices.heads = [(0.0, 0.4)]
            readings = told(robot, 0.5)
        weight = proximity_weight(ReferenceModel(), 0.2)
        assert (readings.proximity_x, readings.proximity_y) == pytest.approx((0.0, -weight))
        assert robot.senses.neighbours == [pytest.approx((0.4, left), abs=0.01)]

    def test_what_is_not_valid_is_not_heard(self):
        streamed = {"color_detection": QUIET["color_detection"]}
        for is_valid in (False, True):
            found = [*converted(StreamData(Processor.ST, 1, is_valid=is_valid, values=streamed))]
            assert bool(found) == is_valid

    def test_a_hub_with_a_sensor_that_is_off_tells_nothing(self):
        for mask in (0xFF, 0xFE):
            assert bool([*converted(Distances((500,) * 8, mask))]) == (mask == 0xFF)

    def robots_after_a_turn(self, devices, robot):
        """What was seen before the robot turned is still where it was."""
        devices.heads = [(0.0, 0.4)]
        told(robot, 0.6)
        devices.silent = {"lidar"}
        devices.measured["imu"] = 0.0, 0.0, devices.measured["imu"][2] + math.radians(30.0)
        told(robot)
        assert robot.senses.neighbours == [pytest.approx((0.4, -math.radians(30.0)), abs=0.02)]

    def test_the_ring_of_sensors_is_that_of_the_simulated_robot(self):
        assert Settings().proximity_angles == load_robot_model("mercator").proximity.angles
        assert Settings().limits.speed == load_robot_model("mercator").drive.maximum_speed

    def test_what_is_not_needed_and_silent_is_neutral(self, devices):
        devices.silent = {"color_detection"}
        with robot_on(devices, ("proximity",)) as robot:
            assert told(robot)[5:8] == (255.0, 255.0, 255.0)
            devices.silent.add("proximity")
            robot.attend(time.monotonic() + 0.7)
            with pytest.raises(
                RobotStopped,
                match=r"^proximity: nothing for 0\.\d\d s; the limit is 0\.5 s; it was heard before: are all",
            ):
                robot.readings()


ASKED = "get_active_control_system_id"


def say_nothing(devices):
    """Of commands that run out, or of speed zero."""
    devices.instead[ASKED] = {"error": 2}
    devices.rvr._notifies["robot_has_stopped"] = False


def tell_that_it_stopped(devices, after):
    """And no more than this."""
    say_nothing(devices)
    asked = []
    devices.then(lambda: ASKED in [name for _, name, _ in devices.commands], lambda: asked.append(devices.now))
    devices.then(lambda: devices.now >= asked[0] + after, lambda: devices.tell("robot_has_stopped"))


def unplug_one(devices):
    devices.hub.plugged_in = 0x7F


class TestStart:
    def test_an_rvr_that_sleeps_and_does_not_hear_the_first_wake(self, devices):
        devices.rvr.sleep()
        devices.when(lambda: devices.now > 1.0)  # nobody hears it fall asleep
        devices.deaf.add("rvr")
        devices.then(lambda: devices.now > 1.2, devices.deaf.clear)
        with robot_on(devices):
            assert devices.rvr.is_awake

    def test_commands(self, devices):
        with robot_on(devices) as robot:
            assert robot.facts["firmware_st"] == "9.2.482"
            assert robot.facts["battery"] == "87 %"
            assert robot.facts["commands_end"] == "seen after 0.3 s"
        names = [name for _, name, _ in devices.commands]
        ends = [*["stop_streaming_service"] * 2, *["clear_streaming_service"] * 2]
        assert names[:6] == ["disable_notifications_and_active_commands", *ends, "wake"]
        assert names.index("drive_stop") < names.index("drive_tank_si_units")
        values = {name: values for _, name, values in devices.commands[::-1]}
        assert values["set_custom_control_system_timeout"] == {"command_timeout": round(1000 * COMMANDS_END)}
        assert names.index("reset_yaw") < names.index("start_streaming_service")
        assert [values[name] for name in DISPENSABLE] == [{"is_enabled": True}] * 4 + [{}] * 2
        assert values["enable_color_detection"] == {"is_enabled": True}
        assert not devices.drives()
        assert [*dict.fromkeys(devices.lidar_commands)] == ["force_stop", "stop", "health", "device_info", "scan"]
        assert min(map(devices.lidar_commands.count, ("health", "device_info"))) >= 2  # until two answers agree

    def test_a_lidar_that_still_scans_and_does_not_hear_the_first_stop(self, devices, monkeypatch):
        lost, obey = ["force_stop", "stop"], devices.lidar.obey

        def hear(command, now):
            if command in lost:
                lost.remove(command)
                return b""
            return obey(command, now)

        devices.lidar._scans = 0.0
        monkeypatch.setattr(devices.lidar, "obey", hear)
        with robot_on(devices) as robot:
            assert robot.facts["lidar"].startswith("model 6, ")

    @pytest.mark.parametrize(
        ("prepare", "is_seen"),
        [
            (say_nothing, False),
            (lambda d: tell_that_it_stopped(d, 0.3), True),
            (lambda d: tell_that_it_stopped(d, 0.0), False),
        ],
    )
    def test_whether_commands_end(self, devices, prepare, is_seen):
        """However that is known; if it is not, people are warned."""
        prepare(devices)
        told = []
        with robot_on(devices, ()) as robot:
            robot.introduce(told.append)
            assert robot.facts["commands_end"] == ("seen after 0.3 s" if is_seen else "not seen")
        warning = "Warning: not confirmed that the RVR stops by itself 0.3 s after the last command"
        assert told[1:] == ([] if is_seen else [warning])

    def test_commands_that_do_not_end(self, devices):
        """Such a robot is not driven, unless somebody permits it."""
        devices.instead["set_custom_control_system_timeout"] = {}
        refusal = r"^rvr: .* does not end after 0.3 s, .* limits.unending_commands in robot.yaml$"
        with pytest.raises(RobotError, match=refusal), robot_on(devices, ()):
            pass
        devices.when(devices.is_let_go)
        with robot_on(devices, (), limits=Limits(unending_commands=True)) as robot:
            assert robot.facts["commands_end"] == "not seen"

    @pytest.mark.parametrize(
        ("prepare", "words"),
        [
            (lambda d: setattr(d.rvr, "level", 5.0), r"^rvr: the battery is critical; charge it$"),
            (lambda d: d.rvr.heat({0: 75.0}), r"^rvr: the left motor is too hot \(75 degrees\); let it cool"),
            (lambda d: d.rvr.set_motor_fault(is_fault=True), r"^rvr: a motor has a fault$"),
            (lambda d: d.silent.add("rvr"), r"^rvr: no answer; is it switched on"),
            (lambda d: d.silent.add("lidar"), r"^lidar: no answer; has it power"),
            (lambda d: d.silent.add("proximity"), r"^proximity: no answer; is this the hub's port"),
            (lambda d: d.silent.add("imu"), r"^attitude: nothing yet; the RVR itself is heard: switch it off and on"),
            (
                lambda d: d.silent.add("color_detection"),
                r"^ground: nothing yet; the RVR itself is heard: switch it off and on",
            ),
            (lambda d: setattr(d, "is_stuck", True), r"^lidar: nothing yet; it was heard before: has it power"),
            (
                unplug_one,
                r"^proximity: nothing yet; it was heard before: are all sensors plugged in, ",
            ),
            (
                lambda d: d.instead.update(set_custom_control_system_timeout={"error": 3}),
                r"^rvr: set_custom_control_system_timeout was refused: not yet implemented; its firmware does",
            ),
            (
                lambda d: d.instead.update(set_custom_control_system_timeout={"error": 0x55}),
                r"^rvr: set_custom_control_system_timeout was refused: error 0x55; switch it off and on",
            ),
            *(
                (lambda d, name=name: d.instead.update({name: {"error": 4}}), rf"^rvr: {name} was refused: restricted")
                for name in ("enable_color_detection", "drive_stop")
            ),
            (lambda d: setattr(d.lidar, "health", 2), r"^lidar: it reports an error"),
        ],
    )
    def test_refused(self, devices, prepare, words):
        prepare(devices)
        causes = "critical", "too hot", "a motor has a fault"
        with pytest.raises(RobotError, match=words) as refused, robot_on(devices):
            pass
        assert refused.value.exit_code == (4 if any(cause in words for cause in causes) else 1)
        assert not devices.drives()
        assert [name for _, name, _ in devices.commands].count("drive_stop") >= 2

    def test_another_baud_rate_is_reported(self, devices):
        devices.wrong_baud = {"rvr"}
        words = r"\d+ bytes from it make no sense: another device, or another baud rate"
        with pytest.raises(RobotError, match=words), robot_on(devices):
            pass

    def test_a_sense_that_it_has_not(self):
        with pytest.raises(RobotError, match=r"proximity, neighbours, ground, .*, found one that reads light"):
            Mercator(Settings(ports=PortNames()), (None, None, None), {"light", "proximity"}, {})


def test_the_end(devices, monkeypatch):
    """What does not work keeps nothing else from being ended."""
    ended = []

    def end(name):
        ended.append(name)
        raise RobotError(name)

    monkeypatch.setattr(mercator, "stop_rvr", lambda _link: end("rvr"))
    monkeypatch.setattr(mercator, "stop_lidar", lambda _link: end("lidar"))
    with robot_on(devices, ()) as robot:
        robot.drive(drive(0.5, 0.5))
        devices.when(devices.drives)
    assert ended == ["rvr", "lidar"]
    devices.come_to_rest()


def test_damaged_bytes(devices):
    """One byte of a thousand is wrong: one frame of thirty, of which five in a row make the robot stop (2e-8).

    One packet of the lidar in ten is lost, and with it perhaps the robot that is there, never all the time (1e-20).
    """
    devices.damaged = set(DEVICES)
    devices.heads = [(0.5, 0.5)]
    with robot_on(devices) as robot:
        found = [told(robot, 0.1).neighbours for _ in range(25)]
        robot.drive(drive(0.5, 0.5))
    assert set(found[5:]) | {0.0} == {0.0, 1.0}


def test_who_was_held_up_senses_anew(devices):
    """What came meanwhile, and waits in the ports, is of any time ago."""
    with robot_on(devices) as robot:
        devices.measured["proximity"] = (0.1, *CLEAR[1:])
        time.sleep(1.0)
        devices.measured["proximity"] = CLEAR
        devices.heads = [(0.0, 0.4)]
        devices.settle()
        robot.sense_anew()
        assert all(time.monotonic() - sample.time < 0.3 for sample in robot.senses.samples.values())
        readings = robot.readings()
        assert (readings.proximity_x, readings.neighbours) == (0.0, 1.0)


def test_what_is_refused_is_noted_and_the_robot_goes_on(devices, monkeypatch):
    refused = "get_battery_percentage", "get_battery_voltage_state", "set_all_leds"
    with robot_on(devices, ()) as robot:
        devices.instead = {name: {"error": 4} for name in refused}
        robot.show(dict.fromkeys(LIGHTS, (0, 0, 0)))
        monkeypatch.setattr(mercator, "QUERY_EVERY", 0.0)
        robot.query()
        robot.attend(time.monotonic() + 0.2)
        notes = []
        robot.notes.send_to(notes.append)
        noted = [note for note in notes if "refused" in note]
        assert sorted(noted) == [f"{name} was refused: restricted" for name in refused]
        assert robot.monitor.battery == "87 %"


def test_a_lidar_that_sees_nothing_is_noted(devices):
    notes = []

    def lidar_notes(robot):
        robot.attend(time.monotonic() + 2.5)
        return [note.partition(";")[0] for note in notes if note.startswith("lidar")]

    with robot_on(devices, ()) as robot:
        robot.notes.send_to(notes.append)
        assert lidar_notes(robot) == ["lidar: it has seen nothing for 2 s"]
        devices.heads = [(0.0, 0.4)]
        _, again = lidar_notes(robot)
        assert again.startswith("lidar: it sees something again (")


class Port:
    """Takes all; what `read` returns waits in `said`."""

    name, in_waiting = "/dev/serial0", 4096

    def __init__(self):
        self.written, self.rvr = [], RvrEnd()
        self._here, self._there = socket.socketpair()
        self.fileno = self._here.fileno
        self.say = self._there.send

    def write(self, data):
        self.written.append(data)

    def read(self, size):
        return self._here.recv(size)

    def refuse(self, error):
        """Refuse the command that was written last."""
        self.say(self.rvr.answer(self.rvr.receive(self.written[-1])[-1].frame, error))


@pytest.fixture
def port():
    port = Port()
    yield port
    port._here.close()
    port._there.close()


def robot_over(port):
    return Mercator(Settings(), {"rvr": port}, SENSES, {})


def test_of_commands_that_are_refused_one_matters():
    """A response with an error has no values."""
    settings = Settings()
    monitor = Monitor(settings.limits, Senses(settings, (), {}), Answers(), str)
    for name in COMMANDS:
        (note,) = monitor.take(Response(name, Processor.NORDIC, {}, Error.RESTRICTED, 1))
        assert note == (f"{name} was refused: restricted", False)


def test_a_command_to_drive_that_is_refused_stops_the_robot(port):
    robot = robot_over(port)
    robot.drive(drive(0.5, -0.5))
    port.refuse(Error.RESTRICTED)
    with pytest.raises(RobotStopped) as stopped:
        robot.attend(0.0)
    assert str(stopped.value) == "rvr: it does not drive: restricted; switch it off and on (rvr on /dev/serial0)"


@pytest.mark.parametrize("error", [Error.BAD_DATA_LENGTH, Error.BAD_DATA_VALUE])
def test_a_command_to_drive_that_was_damaged_is_repeated(port, error):
    """Once; and nothing is after a stop."""
    robot = robot_over(port)
    robot.drive(drive(0.5, -0.5))
    port.refuse(error)
    for _ in range(3):
        robot.attend(0.0)
        port.refuse(error)
    assert [RvrEnd().receive(data)[0].values for data in port.written] == [
        {"left_velocity": pytest.approx(0.15), "right_velocity": pytest.approx(-0.15)}
    ] * 2
    assert robot.lines()["rvr"][-1] == 1
    robot.drive(drive(0.5, -0.5))
    robot.brake.stop("SIGTERM")
    sent = len(port.written)
    port.refuse(error)
    robot.attend(0.0)
    assert len(port.written) == sent


def test_an_rvr_that_answers_too_little_stops_the_robot():
    """The message has the remedy, which the link gives."""

    def looks(commands):
        settings, answers = Settings(), Answers()
        monitor = Monitor(settings.limits, Senses(settings, (), {}), answers, "{0} remedy".format)
        for number in range(commands):
            answers.send(number, 0.0)
        assert [*monitor.check(0.1, {})] == []
        return [note.text for note in monitor.check(4.5, {})]

    remedy = "rvr remedy"
    with pytest.raises(RobotStopped) as stopped:
        looks(9)
    assert str(stopped.value) == f"rvr: only 77 % of the commands to it are answered; the limit is 80 %; {remedy}"
    assert looks(5) == [f"rvr: only 87 % of the commands to it are answered; below 80 % the robot stops; {remedy}"]


def test_lamps_are_set_again(devices):
    """As a frame may have been lost; but not in each cycle."""

    def shown():
        return [name for _, name, _ in devices.commands].count("set_all_leds")

    with robot_on(devices, ()) as robot:
        colours = dict.fromkeys(LIGHTS, (0, 158, 115))
        for _ in range(3):
            robot.show(colours)
        devices.when(shown)
        time.sleep(0.1)
        assert shown() == 1
        time.sleep(1.0)
        robot.show(colours)
        devices.when(lambda: shown() == 2)


def test_the_lidar_s_motor(devices, monkeypatch):
    """Turns as long as the line DTR is high."""
    heights = []
    monkeypatch.setattr(SimulatedPort, "dtr", property(lambda _: None, lambda _, high: heights.append(high)))
    with robot_on(devices, ()):
        assert heights[-2:] == [False, True]
    assert heights[-1] is False


def test_wheels_and_lamps(devices):
    with robot_on(devices, (), limits=Settings().limits) as robot:
        robot.drive(drive(1.0, -0.5))
        robot.show(dict.fromkeys(LIGHTS, (0, 158, 115)))
        robot.attend(time.monotonic() + 0.1)
        assert devices.wheels[-1][1:] == pytest.approx((0.3, -0.15))
        _, _, lamps = next(each for each in devices.commands[::-1] if each[1] == "set_all_leds")
        assert lamps["led_group"] == 0x3FFFFFFF
        assert bytes(lamps["led_brightness_values"]) == bytes((0, 158, 115)) * 10
        with pytest.raises(RobotStopped, match=r"found 0\.3, nan"):
            robot.drive(drive(1.0, math.nan))
        with pytest.raises(RobotStopped, match=r"found 0\.3, nan"):  # once and for all
            robot.drive(drive(0.1, 0.1))


def test_no_zero_has_a_sign():
    """Of axes that are turned the other way."""
    values = {name: QUIET[name] for name in STREAMED}
    for _, found in converted(StreamData(Processor.ST, 1, is_valid=True, values=values)):
        assert [math.copysign(1.0, value) for value in found] == [1.0] * len(found)
