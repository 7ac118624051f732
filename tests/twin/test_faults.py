"""What goes wrong by a script, and what a script may say."""

import math
import random
import re
from collections import Counter
from pathlib import Path
from typing import get_args

import pytest

from mercator_design.errors import SettingsError
from mercator_design.robot.protocols.multiflex import BINARY_MODE, Acknowledgement
from mercator_design.robot.protocols.rvr import Flags, Response
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData, streaming
from mercator_design.robot.protocols.ydlidar import Packet, Turns, encode_command
from mercator_design.twin.devices.lidar import with_intensities
from mercator_design.twin.faults import (
    Battery,
    Blind,
    Damage,
    Double,
    Fault,
    Flip,
    Heat,
    Insert,
    InvalidStream,
    LampOff,
    LockedSlots,
    Lose,
    NoStream,
    OldHub,
    OtherLidar,
    PortLoss,
    Post,
    RefusedCommand,
    Script,
    Service,
    Silence,
    SlowStream,
    SlowTurns,
    Stall,
    WrongBaud,
    read_script,
)
from tests.twin.arenas import Talk

pytestmark = pytest.mark.together("kernels")  # compiled once

DATA = random.Random(1).randbytes(20_000)
LINE = {"at": 1.0, "duration": 2.0, "robot": 0, "device": "rvr"}


def damaged(*faults, now=1.5, direction="from_robot", seed="1"):
    return Damage(faults, direction, seed)(DATA, now)


class TestDamage:
    """Rates are those of the seeds here."""

    def test_bits_are_flipped(self):
        found = damaged(Flip(**LINE, rate=0.1))
        hit = [a ^ b for a, b in zip(DATA, found, strict=True) if a != b]
        assert len(hit) == pytest.approx(2000, rel=0.1)
        assert {each.bit_count() for each in hit} == {1}
        assert len(set(hit)) == 8

    def test_bytes_are_lost_doubled_and_put_in(self):
        assert len(damaged(Lose(**LINE, rate=0.1))) == pytest.approx(18_000, rel=0.01)
        assert len(damaged(Double(**LINE, rate=0.1))) == pytest.approx(22_000, rel=0.01)
        inserted = damaged(Insert(**LINE, rate=0.1))
        assert len(inserted) == pytest.approx(22_000, rel=0.01)
        rest = iter(inserted)
        assert all(byte in rest for byte in DATA)  # all that was there, in its order

    def test_nothing_or_only_garbage_comes_through(self):
        assert damaged(Silence(**LINE)) == b""
        garbage = damaged(WrongBaud(**LINE))
        assert len(garbage) == len(DATA)
        assert sum(a == b for a, b in zip(DATA, garbage, strict=True)) < 200

    def test_only_while_it_lasts_and_in_its_direction(self):
        fault = Lose(**LINE, direction="to_robot", rate=1.0)
        assert [len(damaged(fault, now=now, direction="to_robot")) for now in (0.99, 1.0, 2.99, 3.0)] == [
            len(DATA), 0, 0, len(DATA),
        ]  # fmt: skip
        assert damaged(fault) == DATA

    def test_a_seed_gives_the_same_again(self):
        fault = Flip(**LINE, rate=0.1)
        assert damaged(fault) == damaged(fault) != damaged(fault, seed="2")


class TestScripts:
    def test_all_kinds(self, tmp_path):
        file = tmp_path / "faults.yaml"
        file.write_text("""
schema: 1
seed: 7
faults:
  - {kind: flip, at: 5, duration: 10, robot: 0, device: rvr, rate: 0.01}
  - {kind: silence, at: 5, robot: 2, device: lidar, direction: from_robot}
  - {kind: port_loss, at: 20, duration: 2, robot: 1, device: proximity}
  - {kind: battery, at: 1, robot: 0, level: 3}
  - {kind: stall, at: 1, duration: 3, robot: 0, motor: left}
  - {kind: heat, at: 1, robot: 0, motor: right, temperature: 65}
  - {kind: no_stream, at: 1, robot: 0, service: imu}
  - {kind: slow_stream, at: 1, robot: 0, service: locator, period: 0.4}
  - {kind: invalid_stream, at: 1, robot: 0, service: imu}
  - {kind: lamp_off, at: 1, robot: 0}
  - {kind: refusal, at: 1, robot: 0, command: configure_streaming_service, service: ambient_light, error: 6}
  - {kind: refusal, at: 1, robot: 0, command: drive_stop, error: null}
  - {kind: locked_slots, at: 1, robot: 0}
""")
        assert read_script(file) == Script(
            seed=7,
            faults=(
                Flip(at=5, duration=10, robot=0, device="rvr", rate=0.01),
                Silence(at=5, robot=2, device="lidar", direction="from_robot"),
                PortLoss(at=20, duration=2, robot=1, device="proximity"),
                Battery(at=1, robot=0, level=3),
                Stall(at=1, duration=3, robot=0, motor="left"),
                Heat(at=1, robot=0, motor="right", temperature=65),
                NoStream(at=1, robot=0, service="imu"),
                SlowStream(at=1, robot=0, service="locator", period=0.4),
                InvalidStream(at=1, robot=0, service="imu"),
                LampOff(at=1, robot=0),
                RefusedCommand(at=1, robot=0, command="configure_streaming_service", service="ambient_light", error=6),
                RefusedCommand(at=1, robot=0, command="drive_stop", error=None),
                LockedSlots(at=1, robot=0),
            ),
        )

    def test_the_one_in_the_documents(self, tmp_path):
        text = (Path(__file__).parents[2] / "docs" / "reference" / "twin.md").read_text()
        file = tmp_path / "faults.yaml"
        file.write_text(re.search(r"^```\n(schema: 1\nseed.*?)^```", text, re.MULTILINE | re.DOTALL)[1])
        assert len(read_script(file).faults) == 15
        kinds = {
            kind for row in re.findall(r"^\| (`[a-z_`, ]+`) \|", text, re.MULTILINE) for kind in re.findall(r"\w+", row)
        }
        assert {each.__dataclass_fields__["kind"].default for each in get_args(Fault)} <= kinds

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("{kind: flop, at: 1, robot: 0}", r"faults\[0\].kind: expected one of flip, lose, .*did you mean 'flip'\?"),
            ("{kind: flip, at: 1, robot: 0, device: rvr}", r"faults\[0\].rate: missing key"),
            ("{kind: flip, at: 1, robot: 0, device: rvr, rate: 2}", r"faults\[0\].rate: expected"),
            (
                "{kind: no_stream, at: 1, robot: 0, service: colour}",
                r"faults\[0\].service: expected one of quaternion, ",
            ),
            (
                "{kind: refusal, at: 1, robot: 0, command: fly}",
                r"faults\[0\].command: expected a command of the RVR, f",
            ),
            ("{kind: stall, at: 1, robot: 0, motor: middle}", r"faults\[0\].motor: expected one of left, right"),
            (
                "{kind: silence, at: 1, robot: 0, device: radar}",
                r"faults\[0\].device: expected one of rvr, lidar, prox",
            ),
        ],
    )
    def test_mistakes_have_their_line(self, tmp_path, line, words):
        file = tmp_path / "faults.yaml"
        file.write_text(f"schema: 1\nfaults:\n  - {line}\n")
        with pytest.raises(SettingsError, match=rf"faults.yaml:3: {words}"):
            read_script(file)

    def test_a_robot_that_is_not_there(self):
        with pytest.raises(
            SettingsError, match=r"^script of faults: faults\[0\].robot: expected a robot's number, 0 to"
        ):
            Talk(script=Script(faults=(Battery(at=1, robot=3, level=3),)))

    def test_a_robot_that_is_not_there_has_its_line(self, tmp_path):
        file = tmp_path / "faults.yaml"
        file.write_text("schema: 1\nfaults:\n  - {kind: battery, at: 1, robot: 3, level: 3}\n")
        with pytest.raises(SettingsError, match=r"faults.yaml:3: faults\[0\].robot: expected a robot's number, 0 to 0"):
            Talk(script=read_script(file))


class TestInATwin:
    def test_a_line_that_falls_silent_both_ways(self):
        talk = Talk(script=Script(faults=(Silence(at=1.0, duration=1.0, robot=0, device="rvr"),)))
        talk.send("set_custom_control_system_timeout", command_timeout=300)
        talk.drive(0.2, 0.2, 2.0)
        wheels = [(event["time"], event["left"], event["by"]) for event in talk.events("wheels")]
        assert [(left, by) for _, left, by in wheels] == [
            (0.0, "start"),
            (0.2, "drive_tank_si_units"),
            (0.0, "timeout"),
        ]
        assert wheels[-1][0] == pytest.approx(1.2, abs=0.021)  # 300 ms after the last command that came through
        said = talk.drive(0.2, 0.2, 0.5)
        assert talk.robot.rvr.drive.target == pytest.approx((0.2, 0.2))
        assert said["lidar"] == []
        faults = [(event["time"], event["kind"], event["begins"]) for event in talk.events("fault")]
        assert faults == [(1.0, "silence", True), (2.0, "silence", False)]

    def test_a_wrong_baud_rate(self):
        talk = Talk(script=Script(faults=(WrongBaud(at=0.0, robot=0, device="proximity"),)))
        assert talk.wait(2.0)["proximity"] == []
        assert talk.ends["proximity"].counts.lost > 200

    def test_the_battery_falls_and_is_charged(self):
        talk = Talk(script=Script(faults=(Battery(at=1.0, duration=1.0, robot=0, level=3),)))
        talk.send("enable_battery_voltage_state_change_notify", is_enabled=True)
        states = [event.values["state"] for event in talk.wait(3.0)["rvr"]]
        assert states == [3, 1]

    @pytest.mark.parametrize(
        ("first", "second", "levels"),
        [
            ({"at": 1.0, "duration": 3.0, "level": 20}, {"at": 2.0, "level": 10}, [100, 20, 10, 10, 10]),
            ({"at": 1.0, "level": 10}, {"at": 2.0, "duration": 1.0, "level": 20}, [100, 10, 10, 10, 10]),
            ({"at": 1.0, "duration": 1.0, "level": 30}, {"at": 2.0, "duration": 2.0, "level": 3}, [100, 30, 3, 3, 100]),
        ],
    )
    @pytest.mark.parametrize("turned", [False, True])
    def test_the_lowest_level_counts_as_long_as_it_is_on(self, first, second, levels, turned):
        faults = [Battery(robot=0, **first), Battery(robot=0, **second)]
        talk = Talk(script=Script(faults=tuple(reversed(faults) if turned else faults)))
        found = []
        for seconds in (0.5, 1.0, 1.0, 1.0, 1.0):
            talk.wait(seconds)
            found.append(talk.robot.rvr.level)
        assert found == levels

    @pytest.mark.parametrize(
        ("first", "second", "over"),
        [((0.5, 1.0), (0.7, 0.2), 1.5), ((0.7, 0.2), (0.5, 1.0), 1.5), ((0.5, 0.5), (1.0, 0.5), 1.5)],
    )
    def test_a_motor_is_stuck_as_long_as_any_says_so(self, first, second, over):
        stalls = (Stall(at=at, duration=duration, robot=0, motor="left") for at, duration in (first, second))
        talk = Talk(script=Script(faults=tuple(stalls)))
        talk.send("enable_motor_stall_notify", is_enabled=True)
        before = [event.values["is_triggered"] for event in talk.wait(over - 0.02)["rvr"]]
        after = [event.values["is_triggered"] for event in talk.wait(0.04)["rvr"]]
        assert (before, after) == ([True], [False])

    def test_a_motor_stalls(self):
        talk = Talk(script=Script(faults=(Stall(at=0.5, duration=0.5, robot=0, motor="right"),)))
        talk.send("enable_motor_stall_notify", is_enabled=True)
        said = talk.drive(0.2, 0.2, 2.0)["rvr"]
        assert [event.values for event in said] == [
            {"motor_index": 1, "is_triggered": True},
            {"motor_index": 1, "is_triggered": False},
        ]
        assert talk.arena.poses[0, 2] < -0.3  # it turned to the right meanwhile

    def test_a_motor_that_is_stuck_already_is_told_to_who_asks(self):
        talk = Talk(script=Script(faults=(Stall(at=0.5, robot=0, motor="right"),)))
        talk.wait(1.0)
        (told,) = talk.send("enable_motor_stall_notify", is_enabled=True)
        assert told.values == {"motor_index": 1, "is_triggered": True}
        assert talk.send("enable_motor_stall_notify", is_enabled=False) == []

    def test_a_motor_gets_hot(self):
        """From 70 degrees on it is cut off, whatever it is told; of several faults the hottest counts."""
        faults = [Heat(at=at, duration=1.0, robot=0, motor="right", temperature=t) for at, t in ((0.5, 75), (1.0, 65))]
        talk = Talk(script=Script(faults=tuple(faults)))
        talk.send("enable_motor_thermal_protection_status_notify", is_enabled=True)
        said = talk.drive(0.2, 0.2, 1.0)["rvr"]
        assert talk.robot.rvr.drive.treads == (pytest.approx(0.2), 0.0)
        said += talk.drive(0.2, 0.2, 1.5)["rvr"]
        assert talk.robot.rvr.drive.treads == pytest.approx((0.2, 0.2))
        found = [(event.values["right_motor_temperature"], event.values["right_motor_status"]) for event in said]
        assert found == [(75.0, 2), (65.0, 1), (30.0, 0)]
        assert {event.values["left_motor_status"] for event in said} == {0}

    def stream(self, *faults):
        """The services of the slots, and whether they are valid, that come in the first, second and third second."""
        talk = Talk(script=Script(faults=faults))
        talk.send("enable_color_detection", is_enabled=True)
        for name, target, values in streaming(["imu", "gyroscope", "color_detection", "ambient_light"], 100):
            talk.hear("rvr", talk.host.send(name, target=target, **values))
        talk.wait(0.05)
        return [
            Counter((*event.values, event.is_valid) for event in talk.wait(1.0)["rvr"] if isinstance(event, StreamData))
            for _ in range(3)
        ]

    @pytest.mark.parametrize(
        ("fault", "slot", "during"),
        [
            (NoStream(at=1.05, duration=1.0, robot=0, service="color_detection"), ("color_detection",), {}),
            (
                SlowStream(at=1.05, duration=1.0, robot=0, service="imu", period=0.5),
                ("imu", "gyroscope"),
                {("imu", "gyroscope", True): 2},
            ),
            (
                InvalidStream(at=1.05, duration=1.0, robot=0, service="ambient_light"),
                ("ambient_light",),
                {("ambient_light", False): 10},
            ),
        ],
    )
    def test_streams(self, fault, slot, during):
        before, meanwhile, after = self.stream(fault)
        usual = {(*each, True): 10 for each in (("imu", "gyroscope"), ("color_detection",), ("ambient_light",))}
        assert before == after == usual
        del usual[*slot, True]
        assert meanwhile == usual | during

    def test_a_lamp_that_fails(self):
        talk = Talk(script=Script(faults=(LampOff(at=1.0, duration=1.0, robot=0),)), floor="{background: white}")
        found = []
        talk.send("enable_color_detection", is_enabled=True)
        for _ in range(3):
            talk.wait(0.9)
            (answer,) = talk.send("get_rgbc_sensor_values")
            found.append(any(answer.values.values()))
        assert found == [True, False, True]

    def test_a_command_that_is_refused(self):
        faults = (
            RefusedCommand(at=0.0, robot=0, command="drive_stop", error=8),
            RefusedCommand(at=0.0, robot=0, command="reset_yaw", error=None),
            RefusedCommand(at=0.0, robot=0, command="configure_streaming_service", service="ambient_light"),
        )
        talk = Talk(script=Script(faults=faults))
        talk.wait(0.1)
        errors = {}
        for name, target, values in [
            ("drive_stop", None, {}),
            ("reset_yaw", None, {}),
            ("reset_locator_x_and_y", None, {}),
            *streaming(["imu", "ambient_light"], 100),
        ]:
            answers = talk.hear("rvr", talk.host.send(name, target=target, reply=Flags.ANSWER, **values))
            errors[name, target] = [answer.error for answer in answers if isinstance(answer, Response)]
        assert errors["drive_stop", None] == [8]
        assert errors["reset_yaw", None] == []
        assert errors["reset_locator_x_and_y", None] == [0]
        assert errors["configure_streaming_service", Processor.NORDIC] == [6]
        assert errors["configure_streaming_service", Processor.ST] == [0]

    def test_slots_that_are_locked_while_they_are_streamed(self):
        talk = Talk(script=Script(faults=(LockedSlots(at=0.0, robot=0),)))
        talk.wait(0.1)
        (configured, *_) = streaming(["imu"], 100)

        def error(name, **values):
            (answer,) = talk.hear("rvr", talk.host.send(name, target=Processor.ST, reply=Flags.ANSWER, **values))
            return answer.error

        assert error(configured[0], **configured[2]) == 0
        assert error("start_streaming_service", period=100) == 0
        talk.send("disable_notifications_and_active_commands")
        assert len(talk.wait(1.0)["rvr"]) == 10
        assert error(configured[0], **configured[2]) == 4
        assert error("clear_streaming_service") == 4
        assert error("stop_streaming_service") == 0
        assert error("clear_streaming_service") == 0
        assert error(configured[0], **configured[2]) == 0

    def test_services_are_those_of_the_rvr(self):
        assert set(get_args(Service)) == SERVICES.keys()

    def test_a_drive_to_a_position_ends_when_the_port_is_closed(self):
        """No time ends it; one that began before must not go on for nobody."""
        talk = Talk()
        talk.robot.note_port("rvr", is_open=True, now=0.0)
        talk.send("drive_to_position_si", yaw_angle=0.0, x=0.0, y=1.0, linear_speed=0.2, flags=0)
        talk.wait(3.0)
        assert talk.robot.rvr.drive.target != (0.0, 0.0)
        talk.robot.note_port("lidar", is_open=False, now=talk.now)
        assert talk.robot.rvr.drive.target != (0.0, 0.0)
        talk.robot.note_port("rvr", is_open=False, now=talk.now)
        assert (talk.robot.rvr.drive.target, talk.robot.rvr.drive.cause) == ((0.0, 0.0), "port closed")
        assert talk.events("wheels")[-1]["by"] == "port closed"
        talk.send("drive_tank_si_units", left_velocity=0.1, right_velocity=0.1)
        talk.robot.note_port("rvr", is_open=False, now=talk.now)
        assert talk.robot.rvr.drive.cause == "drive_tank_si_units"  # that ends by itself

    def test_the_port_goes_away(self):
        talk = Talk(script=Script(faults=(PortLoss(at=0.5, duration=0.5, robot=0, device="lidar"),)))
        there = []
        for _ in range(3):
            talk.wait(0.4)
            there.append([talk.robot.is_plugged_in(device) for device in ("rvr", "lidar", "proximity")])
        assert there == [[True] * 3, [True, False, True], [True] * 3]


class TestLidars:
    """Robot 0 at the origin sees the head of robot 1 to its left, at 1 m."""

    @staticmethod
    def scanning(*faults):
        """A lidar in its scan, with faults from the start."""
        talk = Talk((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), script=Script(faults=faults))
        talk.robot.note_port("lidar", is_open=True, now=0.0)
        talk.wait(0.02)
        return talk, talk.hear("lidar", encode_command("scan"))

    @classmethod
    def seen(cls, *faults):
        """Ranges [m] around 90 degrees and around 270 degrees of each turn of two seconds."""
        talk, _ = cls.scanning(*faults)
        turns = Turns()
        found = [turn for packet in talk.wait(2.5)["lidar"] if (turn := turns.receive(packet)) is not None]
        near = math.radians(3.0)
        return [
            [{round(r, 1) for angle, r in turn if abs(angle - math.radians(at)) < near and r} for at in (90, 270)]
            for turn in found
        ]

    def test_without_a_fault(self):
        assert self.seen() == [[{1.0}, set()]] * 14

    def test_a_sector_or_some_turns_in_which_nothing_is_seen(self):
        assert self.seen(Blind(at=0.0, robot=0)) == [[set(), set()]] * 14
        assert self.seen(Blind(at=0.0, robot=0, sector=(80.0, 100.0))) == [[set(), set()]] * 14
        assert self.seen(Blind(at=0.0, robot=0, sector=(100.0, 80.0))) == [[{1.0}, set()]] * 14
        empty = [not left for left, _ in self.seen(Blind(at=0.0, robot=0, turns=0.25))]
        assert empty == [False, False, False, True] * 3 + [False, False]

    def test_a_part_of_the_robot_is_seen_where_it_is(self):
        assert self.seen(Post(at=0.0, robot=0, sector=(265.0, 275.0), distance=0.2)) == [[{1.0}, {0.2}]] * 14
        assert self.seen(Post(at=0.0, robot=0, sector=(75.0, -75.0), distance=0.2)) == [[{0.2}, {0.2}]] * 14

    def test_turns_at_another_speed(self):
        assert len(self.seen(SlowTurns(at=0.0, robot=0, rate=3.0))) == 6

    def test_other_lidars(self):
        talk, said = self.scanning(OtherLidar(at=0.0, robot=0, model=5, unanswered=("health", "scan")))
        assert said == []
        assert talk.wait(1.0)["lidar"]
        assert talk.hear("lidar", encode_command("stop") + encode_command("health")) == []
        (info,) = talk.hear("lidar", encode_command("device_info"))
        assert info.model == 5

    def test_a_lidar_that_sends_unasked(self):
        talk, _ = self.scanning(OtherLidar(at=0.0, duration=2.0, robot=0, one_way=True))
        assert talk.hear("lidar", encode_command("stop") + encode_command("health")) == []
        assert talk.wait(1.0)["lidar"]
        talk.wait(1.5)
        talk.hear("lidar", encode_command("stop"))
        assert talk.wait(1.0)["lidar"] == []

    def test_samples_of_three_bytes(self):
        """The first byte is an intensity; the checksum is that of the maker's SDK."""
        talk, _ = self.scanning(OtherLidar(at=0.0, robot=0, intensities=True))
        assert {len(packet.samples) for packet in talk.wait(1.0)["lidar"]} <= {1}  # those of range 0 are an X4's, too
        assert talk.ends["lidar"].counts.lost > 8_000
        packet = Packet(0x280, 0x2C0, (0x0FA0, 0x0FA4))
        assert with_intensities(packet) == bytes.fromhex("aa550002010581052e5755a00f55a40f")

    def test_a_hub_with_old_firmware(self):
        talk = Talk(script=Script(faults=(OldHub(at=0.5, duration=1.0, robot=0),)))
        answers = []
        for _ in range(3):
            said = talk.hear("proximity", BINARY_MODE.encode())
            answers += [event for event in said if isinstance(event, Acknowledgement)]
            talk.wait(0.8)
        assert answers == [Acknowledgement(0x11, ok) for ok in (True, False, True)]
