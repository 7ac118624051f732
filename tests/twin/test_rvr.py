"""The twin's RVR: every command, what ends by itself, sleep, streaming, and the sessions of the maker's SDK."""

import math
import random
import struct

import pytest

from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.protocols.rvr import Flags, Frame, Host, Notification, Response, Unknown
from mercator_design.robot.protocols.rvr_messages import COMMANDS, LIGHTS, Error, Processor, lights
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData, streaming
from mercator_design.twin.devices.rvr import SLEEPS, WAKES, TwinRvr
from tests.twin.recordings import sdk

TREAD_DISTANCE = 0.2
STILL = {
    "ground_sensors": [10.0, 20.4, 250.0],
    "ambient_light": [120.5],
    "velocity": [0.0, 0.3],
    "accelerometer": [0.1, -0.2, 1.0],
    "gyroscope": [0.0, 0.0, math.pi / 2],
    "imu": [0.0, 0.0, math.radians(120.0)],
    "locator": [0.0, 0.0],
    "quaternion": [1.0, 0.0, 0.0, 0.0],
    "treads": [0.5, -0.25],
}


class Talk:
    """A host, and an RVR that measures what `world` holds, at a time that goes on as it is told to."""

    def __init__(self):
        self.world = {name: list(values) for name, values in STILL.items()}
        self.rvr = TwinRvr(self.world.__getitem__, tread_distance=TREAD_DISTANCE, number=3)
        self.host, self.now = Host(), 0.0

    def send(self, name, /, **values):
        """What the robot says to a command."""
        return self.hear(self.host.send(name, **values))

    def hear(self, data):
        return self.host.receive(self.rvr.receive(data, self.now))

    def ask(self, name, /, **values):
        """What it answers."""
        (response,) = (event for event in self.send(name, **values) if isinstance(event, Response))
        return response.error or response.values

    def wait(self, seconds, step=0.01):
        """What it says in the meantime, with the times."""
        said = []
        for _ in range(round(seconds / step)):
            self.now = round(self.now + step, 6)
            said += [(self.now, event) for event in self.host.receive(self.rvr.advance(self.now))]
        return said

    def notes(self, seconds):
        """Notifications of some time, by name."""
        return {event.name: event.values for _, event in self.wait(seconds) if isinstance(event, Notification)}


@pytest.fixture
def talk():
    return Talk()


VALUES = {
    "f32": 0.25, "bool": True, "bytes": b"", "text": "x",
    "configuration": bytes.fromhex("000902"), "token": 3, "led_group": 0b111, "led_brightness_values": (1, 2, 3),
    "data": b"\x8d\xd8\xab", "error": 6, "left_mode": 1, "right_mode": 2, "period": 50, "interval": 100,
    "id0": 4, "id1": 5,
}  # fmt: skip


def any_size(message, chance):
    """Random bytes, of as many as the values of a message are, at least."""
    return chance.randbytes(message.carries._head.size + chance.randrange(3))


def any_values(message):
    kinds = message.carries._kinds
    return {name: VALUES.get(name, VALUES.get(kind, 1)) for name, kind in kinds.items()}


class TestCommands:
    @pytest.mark.parametrize("name", COMMANDS)
    def test_each_is_obeyed_and_answered(self, talk, name):
        message = COMMANDS[name]
        for processor in message.processors:
            frame = talk.host.send(name, target=processor, reply=Flags.ANSWER, **any_values(message))
            (response,) = (event for event in talk.hear(frame) if isinstance(event, Response))
            assert response.processor == processor
            assert response.error == (Error.FAILED if name == "generate_api_error" else Error.SUCCESS)
            returns = message.returns._kinds if message.returns and not response.error else {}
            assert response.values.keys() == returns.keys()

    def test_nothing_is_said_unless_it_is_wanted(self, talk):
        assert talk.send("reset_yaw") == []
        assert talk.send("reset_yaw", reply=Flags.ANSWER | Flags.ONLY_ERRORS) == []
        (response,) = talk.send("reset_yaw", reply=Flags.ANSWER)
        assert response.error == Error.SUCCESS

    @pytest.mark.parametrize(
        ("did", "cid", "target", "data", "error"),
        [
            (0x77, 0x01, 1, b"", Error.BAD_DEVICE),
            (0x16, 0xEE, 2, b"", Error.BAD_COMMAND),
            (0x16, 0x06, 1, b"", Error.BAD_TARGET),
            (0x16, 0x32, 2, b"\0\0\0", Error.BAD_DATA_LENGTH),
            (0x16, 0x01, 2, b"\3\1\1\1", Error.BAD_DATA_VALUE),
            (0x16, 0x32, 2, struct.pack(">ff", math.nan, 0.1), Error.BAD_DATA_VALUE),
            (0x16, 0x34, 2, struct.pack(">ffB", 0.0, math.inf, 0), Error.BAD_DATA_VALUE),
            (0x16, 0x38, 2, struct.pack(">ffffB", 0, 0, 1, 1, 3), Error.BAD_DATA_VALUE),
            (0x16, 0x38, 2, struct.pack(">ffffB", 0, 0, 1, -1, 0), Error.BAD_DATA_VALUE),
            (0x16, 0x07, 2, struct.pack(">BHB", 51, 360, 0), Error.BAD_DATA_VALUE),
            (0x16, 0x07, 2, struct.pack(">BHB", 51, 359, 64), Error.BAD_DATA_VALUE),
            (0x18, 0x4A, 2, b"\4\6", Error.BAD_DATA_VALUE),
            (0x10, 0x00, 1, bytes(17), Error.BAD_DATA_LENGTH),
            (0x16, 0x3E, 2, struct.pack(">f", 0.0), Error.BAD_DATA_VALUE),
            (0x16, 0x3C, 2, struct.pack(">ffffB", 0, 0, 0, -1.0, 1), Error.BAD_DATA_VALUE),
            (0x16, 0x46, 2, b"\x09", Error.BAD_DATA_VALUE),
            (0x16, 0x0E, 2, b"\x01\x0a", Error.BAD_DATA_VALUE),
            (0x16, 0x0E, 2, b"\x04\x02", Error.BAD_DATA_VALUE),  # tank is not a controller of RC
            (0x18, 0x39, 1, bytes.fromhex("01000002"), Error.BAD_DATA_VALUE),
            (0x18, 0x3A, 2, b"\0\0", Error.BAD_DATA_VALUE),
            (0x18, 0x35, 1, b"\1\0\0\0", Error.BAD_DATA_VALUE),
            (0x13, 0x27, 1, b"\2", Error.BAD_DATA_VALUE),
            (0x13, 0x25, 1, b"\3", Error.BAD_DATA_VALUE),
            (0x1A, 0x1A, 1, bytes.fromhex("8000000001"), Error.BAD_DATA_VALUE),
        ],
    )
    def test_what_cannot_be_done_is_refused(self, talk, did, cid, target, data, error):
        flags = Flags.ACTIVITY | Flags.ANSWER | Flags.ONLY_ERRORS
        frame = Frame(did=did, cid=cid, seq=7, data=data, flags=flags, target=target)
        (unknown,) = talk.hear(frame.encode())
        assert isinstance(unknown, Unknown)  # the host has not sent it
        answer = unknown.frame
        assert (answer.did, answer.cid, answer.seq, answer.source, answer.error) == (did, cid, 7, target, error)
        assert talk.rvr.drive.target == (0.0, 0.0)

    @pytest.mark.parametrize("name", COMMANDS)
    def test_nothing_that_is_sent_breaks_it(self, talk, name):
        """Any data: it answers, and its treads are at numbers that they can be at."""
        chance, message = random.Random(name), COMMANDS[name]
        flags = Flags.ACTIVITY | Flags.ANSWER
        for seq in range(50):
            data = chance.choice((chance.randbytes(chance.randrange(24)), any_size(message, chance)))
            target = chance.choice(message.processors)
            frame = Frame(did=message.did, cid=message.cid, seq=seq, data=data, flags=flags, target=target)
            answers = [event.frame for event in talk.hear(frame.encode()) if isinstance(event, Unknown)]
            assert [(answer.seq, answer.error in list(Error)) for answer in answers if answer.error is not None] == [
                (seq, True)
            ]
            talk.wait(0.1, step=0.05)
            assert all(abs(speed) <= 2.0 for speed in (*talk.rvr.drive.target, *talk.rvr.drive.treads))
            if not talk.rvr.is_awake:
                talk.send("wake")
                talk.wait(WAKES + 0.1, step=0.05)

    def test_it_is_who_it_is(self, talk):
        assert talk.ask("get_processor_name", target=Processor.ST) == {"name": "ST"}
        nordic, st = (talk.ask("get_main_application_version", target=target) for target in Processor)
        assert nordic != st
        assert talk.ask("echo", data=b"\x8d\xab") == {"data": b"\x8d\xab"}
        assert talk.ask("generate_api_error", reply=Flags.ANSWER, error=8) == Error.BUSY
        assert talk.ask("get_bluetooth_advertising_name") == {"name": "RV-0003"}
        talk.wait(1.5)
        assert talk.ask("get_core_up_time_in_milliseconds") == {"up_time": 1500}

    def test_lamps(self, talk):
        talk.send("set_all_leds", **lights({"headlight_left": (1, 2, 3), "brakelight_right": (4, 5, 6)}))
        assert light(talk.rvr, "headlight_left") == (1, 2, 3)
        assert light(talk.rvr, "brakelight_right") == (4, 5, 6)
        assert light(talk.rvr, "headlight_right") == (0, 0, 0)
        talk.send("release_led_requests")
        assert not any(any(light(talk.rvr, name)) for name in LIGHTS)


def light(rvr, name):
    """Red, green, blue of one of the `LIGHTS`."""
    return tuple(rvr.leds[LIGHTS[name] : LIGHTS[name] + 3])


def drive(talk, left=0.25, right=0.125):
    talk.send("drive_tank_si_units", left_velocity=left, right_velocity=right)


class TestDriving:
    @pytest.mark.parametrize(
        ("name", "values", "treads"),
        [
            ("drive_tank_si_units", {"left_velocity": 0.25, "right_velocity": -0.5}, (0.25, -0.5)),
            ("drive_tank_si_units", {"left_velocity": 3.0, "right_velocity": -9.0}, (2.0, -2.0)),
            ("drive_tank_normalized", {"left_velocity": 127, "right_velocity": -127}, (2.0, -2.0)),
            (
                "raw_motors",
                {"left_mode": 1, "left_duty_cycle": 255, "right_mode": 2, "right_duty_cycle": 51},
                (2.0, -0.4),
            ),
            (
                "raw_motors",
                {"left_mode": 0, "left_duty_cycle": 255, "right_mode": 1, "right_duty_cycle": 0},
                (0.0, 0.0),
            ),
            (
                "drive_rc_si_units",
                {"yaw_angular_velocity": math.degrees(1.0), "linear_velocity": 0.5, "flags": 0},
                (0.4, 0.6),
            ),
            ("drive_rc_normalized", {"yaw_angular_velocity": 0, "linear_velocity": -127, "flags": 0}, (-2.0, -2.0)),
            ("drive_with_heading", {"speed": 51, "heading": 0, "flags": 0}, (0.4, 0.4)),
            ("drive_with_heading", {"speed": 51, "heading": 0, "flags": 1}, (-0.4, -0.4)),
            ("drive_with_yaw_si", {"yaw_angle": 0.0, "linear_velocity": 0.3}, (0.3, 0.3)),
            ("drive_with_yaw_normalized", {"yaw_angle": 0, "linear_velocity": 127}, (2.0, 2.0)),
        ],
    )
    def test_what_the_treads_are_told(self, talk, name, values, treads):
        talk.send(name, **values)
        assert talk.rvr.drive.target == pytest.approx(treads, abs=1e-6)
        assert talk.rvr.drive.cause == name
        talk.wait(0.01)
        assert talk.rvr.drive.treads == pytest.approx(treads, abs=1e-6)

    def test_a_command_ends_after_two_seconds_and_the_robot_brakes(self, talk):
        drive(talk, 0.5, 0.5)
        talk.wait(1.99)
        assert talk.rvr.drive.treads == (0.5, 0.5)
        talk.wait(0.02)
        assert (talk.rvr.drive.target, talk.rvr.drive.cause) == ((0.0, 0.0), "timeout")
        assert 0.4 < talk.rvr.drive.treads[0] < 0.5
        said = talk.wait(0.3)
        assert talk.rvr.drive.treads == (0.0, 0.0)
        (stopped,) = [time for time, event in said if event.name == "robot_has_stopped"]
        assert stopped == pytest.approx(2.25, abs=0.011)  # 0.5 m/s at 2 m/s2

    def test_how_long_commands_last_can_be_set(self, talk):
        talk.send("set_custom_control_system_timeout", command_timeout=300)
        for _ in range(5):
            drive(talk)
            talk.wait(0.29)
            assert talk.rvr.drive.target == (0.25, 0.125)
        talk.wait(0.02)
        assert talk.rvr.drive.target == (0.0, 0.0)
        talk.send("restore_default_control_system_timeout")
        drive(talk)
        talk.wait(1.9)
        assert talk.rvr.drive.target == (0.25, 0.125)

    def test_the_active_controller(self, talk):
        def controller():
            return talk.ask("get_active_control_system_id")["controller_id"]

        assert controller() == 0
        drive(talk)
        assert controller() == 2
        talk.wait(2.1)
        assert controller() == 0
        talk.send("raw_motors", left_mode=1, left_duty_cycle=1, right_mode=1, right_duty_cycle=1)
        assert controller() == 1

    def test_stop(self, talk):
        drive(talk, 0.5, 0.5)
        talk.wait(0.1)
        assert talk.ask("get_stop_controller_state") == {"stopped": False}
        talk.send("drive_stop")
        assert talk.rvr.drive.target == (0.0, 0.0)
        assert list(talk.notes(0.3)) == ["robot_has_stopped"]
        assert talk.ask("get_stop_controller_state") == {"stopped": True}
        drive(talk, 0.5, 0.5)
        talk.wait(0.1)
        talk.send("drive_stop_custom_decel", deceleration_rate=0.5)
        talk.wait(0.5)
        assert talk.rvr.drive.treads == pytest.approx((0.25, 0.25), abs=0.01)

    @pytest.mark.parametrize(
        ("kind", "usual", "other", "drive"),
        [
            (3, 4, 3, ("drive_with_yaw_si", {"yaw_angle": 0.0, "linear_velocity": 1.0})),
            (3, 4, 3, ("drive_with_heading", {"speed": 128, "heading": 0, "flags": 0})),
            (4, 5, 6, ("drive_rc_si_units", {"yaw_angular_velocity": 0.0, "linear_velocity": 1.0, "flags": 0})),
        ],
    )
    def test_the_default_controller_of_a_type_is_the_one_that_drives(self, talk, kind, usual, other, drive):
        """The other one takes time to reach a speed, at 0.5 m/s2."""

        def driven():
            name, values = drive
            talk.send(name, **values)
            talk.wait(0.2)
            found = talk.ask("get_active_control_system_id")["controller_id"], talk.rvr.drive.treads[0]
            talk.send("drive_stop")
            talk.wait(1.0)
            return found

        assert driven() == (usual, pytest.approx(1.0, abs=0.01))
        talk.send("set_default_control_system_for_type", control_system_type=kind, controller_id=other)
        assert driven() == (other, pytest.approx(0.1, abs=0.01))
        talk.send("restore_initial_default_control_systems")
        assert driven() == (usual, pytest.approx(1.0, abs=0.01))

    def test_the_speed_of_rc_may_slew(self, talk):
        talk.send("drive_rc_si_units", yaw_angular_velocity=0.0, linear_velocity=1.0, flags=1)
        talk.wait(0.5)
        assert talk.rvr.drive.treads == pytest.approx((0.25, 0.25), abs=0.01)
        slew = talk.ask("get_drive_target_slew_parameters")
        talk.send("set_drive_target_slew_parameters", **{**slew, "linear_acceleration": 10.0})
        talk.send("drive_rc_si_units", yaw_angular_velocity=0.0, linear_velocity=1.0, flags=1)
        talk.wait(0.1)
        assert talk.rvr.drive.treads == pytest.approx((1.0, 1.0))
        talk.send("restore_default_drive_target_slew_parameters")
        assert talk.ask("get_drive_target_slew_parameters") == slew

    def test_a_stalled_motor_is_cut_off(self, talk):
        talk.send("enable_motor_stall_notify", is_enabled=True)
        drive(talk)
        for stalled, told, treads in (
            ([1], [(1, True)], (0.25, 0.0)),
            ([1, 1], [], (0.25, 0.0)),
            ([0], [(0, True), (1, False)], (0.0, 0.125)),
            ([], [(0, False)], (0.25, 0.125)),
        ):
            talk.rvr.drive.stall(stalled)
            assert [(*event.values.values(),) for _, event in talk.wait(0.02)] == told
            assert talk.rvr.drive.treads == treads


def go(talk, seconds):
    """Let the robot go where its treads take it."""
    for _ in range(round(seconds / 0.01)):
        yield from talk.wait(0.01)
        left, right = talk.rvr.drive.treads
        x, y = talk.world["locator"]
        yaw = talk.world["imu"][2] + 0.01 * (right - left) / TREAD_DISTANCE
        talk.world["imu"][2] = yaw
        talk.world["locator"] = [
            x + 0.005 * (left + right) * math.cos(yaw),
            y + 0.005 * (left + right) * math.sin(yaw),
        ]


class TestPlaces:
    def stream(self, talk, *services):
        for name, target, values in streaming(services, 50):
            talk.send(name, target=target, **values)
        (_, data), *_ = [(time, event) for time, event in talk.wait(0.05) if event.values]
        talk.send("clear_streaming_service", target=data.processor)
        return data.values

    def test_yaw_and_place_are_from_where_the_robot_was(self, talk):
        talk.world["imu"][2] += math.radians(90.0)
        talk.world["locator"] = [-1.0, 0.0]  # forwards was at 120 degrees
        values = self.stream(talk, "imu", "locator")
        assert values["imu"]["yaw"] == pytest.approx(90.0)
        assert values == {"imu": values["imu"]}
        x, y = self.stream(talk, "locator")["locator"].values()
        assert (x, y) == pytest.approx((-math.cos(math.pi / 6), math.cos(math.pi / 3)), abs=1e-5)
        talk.send("reset_yaw")
        assert self.stream(talk, "imu")["imu"]["yaw"] == pytest.approx(0.0, abs=1e-6)
        assert (*self.stream(talk, "locator")["locator"].values(),) == pytest.approx((x, y), abs=1e-5)
        talk.world["locator"] = [-1.0 + math.cos(math.radians(210)), math.sin(math.radians(210))]
        assert (*self.stream(talk, "locator")["locator"].values(),) == pytest.approx((x, y + 1.0), abs=1e-5)
        talk.send("reset_locator_x_and_y")
        assert (*self.stream(talk, "locator")["locator"].values(),) == pytest.approx((0.0, 0.0), abs=1e-5)

    def test_vectors_turn_with_the_yaw_that_is_zero(self, talk):
        assert self.stream(talk, "velocity")["velocity"] == pytest.approx({"x": 0.0, "y": 0.3}, abs=1e-6)
        talk.world["imu"][2] += math.radians(90.0)
        talk.send("reset_yaw")
        assert self.stream(talk, "velocity")["velocity"] == pytest.approx({"x": 0.3, "y": 0.0}, abs=1e-6)
        half = math.sqrt(0.5)
        talk.world["quaternion"] = [half, 0.0, 0.0, half]
        assert self.stream(talk, "quaternion")["quaternion"] == pytest.approx(
            {"w": 1, "x": 0, "y": 0, "z": 0}, abs=1e-6
        )

    @pytest.mark.parametrize(("heading", "yaw"), [(90, -90.0), (270, 90.0), (10, -10.0), (180, 180.0)])
    def test_to_a_heading_clockwise(self, talk, heading, yaw):
        for _ in range(20):
            talk.send("drive_with_heading", speed=26, heading=heading, flags=0)
            list(go(talk, 0.1))
        assert math.cos(math.radians(self.stream(talk, "imu")["imu"]["yaw"] - yaw)) > 0.999
        assert talk.rvr.drive.target == pytest.approx((0.2, 0.2), abs=0.02)

    @pytest.mark.parametrize("flags", [0, 1, 2, 4])
    def test_to_a_place(self, talk, flags):
        list(go(talk, 0.1))
        talk.send("drive_to_position_si", yaw_angle=45.0, x=0.5, y=-0.5, linear_speed=0.5, flags=flags)
        results = [event.values for _, event in go(talk, 10.0) if event.name == "xy_position_drive_result"]
        assert results == [{"success": True}]
        place = self.stream(talk, "locator")["locator"]
        assert (place["x"], place["y"]) == pytest.approx((0.5, -0.5), abs=0.03)
        assert self.stream(talk, "imu")["imu"]["yaw"] == pytest.approx(45.0, abs=5.0)
        assert talk.rvr.drive.treads == (0.0, 0.0)


class TestPower:
    def test_it_sleeps_when_told_and_wakes_in_two_seconds(self, talk):
        drive(talk)
        (slept,) = talk.send("sleep")
        assert slept.name == "did_sleep"
        assert (talk.rvr.drive.treads, talk.rvr.is_awake) == ((0.0, 0.0), False)
        assert talk.ask("get_battery_percentage") == {"percentage": 100}
        (refused,) = talk.send(
            "drive_tank_si_units", reply=Flags.ANSWER | Flags.ONLY_ERRORS, left_velocity=0.1, right_velocity=0.1
        )
        assert refused.error == Error.RESTRICTED
        assert talk.rvr.drive.target == (0.0, 0.0)
        talk.send("wake")
        talk.wait(WAKES - 0.02)
        assert not talk.rvr.is_awake
        assert talk.notes(0.1) == {"did_wake": {}}
        drive(talk)
        assert talk.rvr.drive.target == (0.25, 0.125)

    def test_what_it_refuses_asleep_it_has_not_done(self, talk):
        talk.send("sleep")
        (_, target, configuration), *_ = streaming(["imu"], 50)
        asked = {"target": target, "reply": Flags.ANSWER, **configuration}
        assert talk.ask("configure_streaming_service", **asked) == Error.RESTRICTED
        talk.send("wake")
        talk.wait(WAKES + 0.1)
        talk.send("start_streaming_service", target=target, period=50)
        assert talk.wait(0.2) == []  # there is nothing to stream
        assert talk.ask("configure_streaming_service", **asked) == {}
        assert talk.wait(0.2) != []

    def test_it_falls_asleep_of_itself_but_warns(self, talk):
        said = [(time, event.name) for time, event in talk.wait(SLEEPS + 5.0, step=0.5)]
        assert said == [(SLEEPS - 10.0, "will_sleep"), (SLEEPS, "did_sleep")]

    def test_commands_keep_it_awake(self, talk):
        for _ in range(3):
            assert talk.wait(SLEEPS - 11.0, step=1.0) == []
            talk.send("get_battery_percentage")
        talk.wait(SLEEPS - 5.0, step=1.0)
        talk.send("reset_yaw")
        assert talk.wait(SLEEPS - 11.0, step=1.0) == []

    def test_its_battery(self, talk):
        talk.send("enable_battery_voltage_state_change_notify", is_enabled=True)
        states = []
        for level in (40, 20, 34, 3, 6, 30, 100):
            talk.rvr.level = level
            states += [values["state"] for values in talk.notes(0.05).values()]
            assert talk.ask("get_battery_percentage") == {"percentage": level}
        assert states == [2, 3, 2, 1]  # 34 and 6 % are above the thresholds, but by less than the hysteresis
        talk.send("disable_notifications_and_active_commands")
        talk.rvr.level = 1
        assert talk.notes(0.05) == {}
        assert talk.ask("get_battery_voltage_state") == {"state": 3}


class TestSenses:
    def test_colours_need_the_lamp(self, talk):
        assert talk.ask("get_rgbc_sensor_values") == {"red": 0, "green": 0, "blue": 0, "clear": 0}
        talk.send("enable_color_detection", is_enabled=True)
        assert talk.ask("get_rgbc_sensor_values")["green"] == 257 * 20
        (colour,) = talk.wait(0.01) or talk.send("get_current_detected_color_reading") or talk.wait(0.01)
        assert colour

    def test_colour_notifications(self, talk):
        talk.send("enable_color_detection", is_enabled=True)
        talk.send("get_current_detected_color_reading")
        once = talk.notes(1.0)
        assert once == {"color_detection": dict(once["color_detection"], red=10, green=20, blue=250)}
        talk.send("enable_color_detection_notify", is_enabled=True, interval=250, minimum_confidence_threshold=100)
        said = talk.wait(1.1)
        assert [time - said[0][0] for time, _ in said] == pytest.approx([0.0, 0.25, 0.5, 0.75], abs=0.011)
        talk.send("enable_color_detection", is_enabled=False)
        assert talk.wait(1.0) == []  # nothing is seen with that much confidence
        talk.send("enable_color_detection_notify", is_enabled=False, interval=0, minimum_confidence_threshold=0)
        assert talk.wait(1.0) == []

    def test_what_else_it_measures(self, talk):
        assert talk.ask("get_ambient_light_sensor_value") == {"ambient_light_value": 120.5}
        counts = talk.ask("get_encoder_counts")
        assert counts["left"] == -2 * counts["right"] > 0
        magnetic = talk.ask("get_magnetometer_reading")  # north is 30 degrees to the right
        assert magnetic["x_axis"] / magnetic["y_axis"] == pytest.approx(math.tan(math.pi / 6))
        talk.send("magnetometer_calibrate_to_north")
        assert talk.notes(4.0)["magnetometer_calibration_complete"]["yaw_north_direction"] == -30


class TestStreaming:
    def test_every_service(self, talk):
        talk.send("enable_color_detection", is_enabled=True)
        talk.send("reset_yaw")
        for name, target, values in streaming(list(SERVICES)[:1], 100):
            talk.send(name, target=target, **values)
        for name, target, values in streaming(SERVICES, 100):
            talk.send(name, target=target, **values)
        said = {}
        for _, event in talk.wait(0.105, step=0.005):
            assert event.is_valid
            said |= event.values
        assert said.keys() == SERVICES.keys()
        found = {name: [*values.values()] for name, values in said.items()}
        near = {"rel": 1e-6, "abs": 1e-4}
        assert found["color_detection"] == pytest.approx([10, 20, 250, 255, 1.0])
        assert found["ambient_light"] == pytest.approx([120.5], **near)
        assert found["gyroscope"] == pytest.approx([0.0, 0.0, 90.0], **near)
        assert found["accelerometer"] == pytest.approx([0.1, -0.2, 1.0], **near)
        assert found["velocity"] == pytest.approx([0.0, 0.3], **near)
        assert found["speed"] == pytest.approx([0.3], **near)
        assert found["core_time"] == pytest.approx([0, 100], abs=5)
        assert found["encoders"][0] == -2 * found["encoders"][1]

    def test_each_processor_keeps_its_time_until_it_is_stopped(self, talk):
        for name, target, values in streaming(["imu", "color_detection"], 100):
            talk.send(name, target=target, **values)
        talk.send("start_streaming_service", target=Processor.NORDIC, period=250)

        def counts(seconds):
            heard = [event.processor for _, event in talk.wait(seconds)]
            return heard.count(Processor.NORDIC), heard.count(Processor.ST)

        assert counts(1.0) == (4, 10)
        talk.send("stop_streaming_service", target=Processor.ST)
        assert counts(1.0) == (4, 0)
        talk.send("start_streaming_service", target=Processor.ST, period=50)
        assert counts(1.0) == (4, 20)
        talk.send("clear_streaming_service", target=Processor.ST)
        talk.send("start_streaming_service", target=Processor.ST, period=50)
        assert counts(1.0) == (4, 0)  # nothing is in its slots any more
        talk.send("sleep")
        assert counts(1.0) == (0, 0)

    def test_what_was_missed_is_not_made_up_for(self, talk):
        for name, target, values in streaming(["imu"], 100):
            talk.send(name, target=target, **values)
        assert len(talk.wait(5.0, step=5.0)) == 1
        assert len(talk.wait(1.0)) == 10


class TestTheMakersProgram:
    """Byte by byte what the SDK sends: its start-up, streaming and drive, as the original robot did it."""

    def test_start_stream_drive_stop(self, talk):
        for frame in sdk("original_driver_setup_before_streaming"):
            assert talk.hear(frame) == []
            talk.wait(2.0)
        host = Host()
        for name, target, values in streaming(STREAMED, 200):
            host.send(name, target=target, **values)  # so that it knows what the SDK has put where
        for frame in sdk("stream_start_original_driver"):
            assert talk.hear(frame) == []
        talk.host = host
        said = [event for _, event in talk.wait(1.0)]
        assert all(isinstance(event, StreamData) for event in said)
        assert {(event.processor, event.slot) for event in said} == {(1, 1), (1, 2), (2, 1), (2, 2)}
        assert len(said) == 4 * 5
        for frame in sdk("original_driver_actuation_tick"):
            assert talk.hear(frame) == []
        assert talk.rvr.drive.target == pytest.approx((0.2, 0.18))
        assert light(talk.rvr, "headlight_left") == (237, 239, 144)
        assert light(talk.rvr, "brakelight_right") == (89, 233, 207)
        for frame in sdk("stream_stop_original_driver"):
            talk.hear(frame)
        assert talk.wait(1.0) == []
        assert [event.name for _, event in talk.wait(1.5)] == ["robot_has_stopped"]  # the command had ended
