"""All of a twin but its ports: devices at work together, and the log."""

import math

import pytest

from mercator_design.modules.clustering import lidar_neighbours
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr_streaming import StreamData, streaming
from mercator_design.robot.protocols.ydlidar import Packet, Turns, encode_command
from tests.twin.arenas import QUIET, Talk

pytestmark = pytest.mark.together("kernels")  # compiled once


def test_what_the_devices_say_is_of_one_world():
    """A robot that drives to a wall, and another robot behind it."""
    talk = Talk((0.2, 0.0, 0.0), (-0.8, 0.0, 0.0))
    talk.robot.note_port("lidar", is_open=True, now=0.0)
    for name, target, values in streaming(["locator", "velocity", "imu"], 100):
        talk.send(name, target=target, **values)
    talk.hear("lidar", encode_command("scan"))
    said = talk.drive(0.2, 0.2, 2.0)
    (x, *_), other = talk.arena.poses
    last = {
        name: values for event in said["rvr"] if isinstance(event, StreamData) for name, values in event.values.items()
    }
    assert last["locator"] == pytest.approx({"x": 0.0, "y": x - 0.2}, abs=0.021)  # y is forwards
    assert last["velocity"] == pytest.approx({"x": 0.0, "y": 0.2}, abs=1e-6)
    *_, frame = (event for event in said["proximity"] if isinstance(event, Distances))
    front, back = frame.metres()[1], frame.metres()[5]
    assert front == pytest.approx(1.226 - x - 0.143, abs=0.04)
    assert back == pytest.approx(x - other[0] - 2 * 0.143, abs=0.04)
    turns = Turns()
    *_, turn = (turn for event in said["lidar"] if isinstance(event, Packet) and (turn := turns.receive(event)))
    nearest, bearing = min((r, angle) for angle, r in turn if r > 0.0)
    assert nearest == pytest.approx(x - other[0] - QUIET.lidar.head_radius, abs=0.04)
    assert bearing == pytest.approx(math.pi, abs=0.02)


def test_what_the_lidar_sees_is_as_many_neighbours_as_there_are():
    places = [(0.0, 0.0, 1.0), (0.6, 0.2, 0.0), (-0.5, 0.5, 0.0), (0.1, -0.5, 2.0)]
    talk = Talk(*places)
    talk.robot.note_port("lidar", is_open=True, now=0.0)
    talk.hear("lidar", encode_command("scan"))
    turns = Turns()
    events = talk.wait(1.2)["lidar"]
    *_, turn = (turn for event in events if isinstance(event, Packet) and (turn := turns.receive(event)))
    turn = sorted(turn)
    ranges = [r for _, r in turn]
    found = [[0.0] * len(turn) for _ in range(3)]
    step = 2.0 * math.pi / len(turn)
    n = lidar_neighbours(QUIET.reference_model, ranges, turn[0][0], step, *found)
    seen = sorted((round(found[0][k], 2), round(math.atan2(found[2][k], found[1][k]), 1)) for k in range(n))
    x, y, heading = places[0]
    head = QUIET.lidar.head_radius
    expected = sorted(
        (
            math.hypot(px - x, py - y) - head,
            (math.atan2(py - y, px - x) - heading + math.pi) % (2.0 * math.pi) - math.pi,
        )
        for px, py, _ in places[1:]
    )
    assert [d for d, _ in seen] == pytest.approx([d for d, _ in expected], abs=0.03)
    assert [b for _, b in seen] == pytest.approx([b for _, b in expected], abs=0.08)


def test_the_log_has_what_happened():
    talk = Talk((0.0, 0.0, 0.0), (0.0, 0.6, 0.0))
    talk.send("set_all_leds", led_group=0b111, led_brightness_values=(1, 2, 3))
    talk.drive(0.2, -0.1, 0.5)
    talk.send("drive_stop")
    talk.send("sleep")
    talk.wait(0.5)
    mine = [event for event in talk.log if event.get("robot") == 0]
    wheels = [(event["left"], event["right"], event["by"]) for event in mine if event["event"] == "wheels"]
    assert wheels == [(0.0, 0.0, "start"), (0.2, -0.1, "drive_tank_si_units"), (0.0, 0.0, "drive_stop")]
    assert [event["awake"] for event in mine if event["event"] == "power"] == [True, False]
    assert [event["leds"][:3] for event in mine if event["event"] == "leds"] == [[0, 0, 0], [1, 2, 3]]
    poses = talk.events("poses")
    assert [event["time"] for event in poses] == [round(0.1 * k, 1) for k in range(11)]
    assert [len(event["poses"]) for event in poses] == [2] * 11
    assert poses[-1]["poses"][0] == pytest.approx(talk.arena.poses[0].tolist(), abs=1e-6)
    assert poses[3]["treads"][0] == pytest.approx([0.2, -0.1])
    assert [event["time"] for event in talk.log] == sorted(event["time"] for event in talk.log)


def test_late_ticks_are_made_up_for():
    """The time of the arena is that of the clock, however late it is looked at."""
    early, late = Talk(), Talk()
    for talk in (early, late):
        talk.send("drive_tank_si_units", left_velocity=0.2, right_velocity=0.25)
    early.wait(1.0)
    said = list(late.twin.advance(1.0))
    assert late.arena.ticks == early.arena.ticks == 100
    assert late.arena.poses.tolist() == early.arena.poses.tolist()
    assert {device for _, device, _ in said} == {"proximity"}
