"""The twin's X4: its packets, what a decoder makes of them, its motor, and the sessions of the maker's program."""

import math

import numpy as np
import pytest

from mercator_design.robot.protocols.ydlidar import (
    SAMPLE_RATE,
    DeviceInfo,
    Health,
    Packet,
    ScanStarted,
    Turns,
    decoder,
    encode_command,
)
from mercator_design.twin.devices.lidar import FINE, SPINS_UP, TwinLidar
from tests.twin.recordings import ydlidar_sessions

SAMPLES = 719
BEAMS = FINE * SAMPLES
SESSIONS = ydlidar_sessions()


class Talk:
    """A lidar among ranges that a test sets, and a decoder."""

    def __init__(self, ranges=2.0, *, is_open=True):
        self.ranges = np.full(BEAMS, ranges) if np.isscalar(ranges) else ranges
        self.lidar = TwinLidar(lambda _: (self.ranges, 0.0), samples=SAMPLES, number=5)
        self.decoder, self.now = decoder(), 10.0
        if is_open:
            self.lidar.set_motor(on=True, now=0.0)

    def send(self, *commands):
        return self.hear(b"".join(map(encode_command, commands)))

    def hear(self, data):
        return self.decoder.receive(self.lidar.receive(data, self.now))

    def wait(self, seconds):
        said = b""
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            said += self.lidar.advance(self.now)
        return self.decoder.receive(said)

    def turn(self):
        """Points of a whole turn: angles [degrees, -180 to 180], ranges."""
        turns = Turns()
        self.send("stop", "scan")
        (first, *_) = [turn for packet in self.wait(0.5) if (turn := turns.receive(packet))]
        return np.array([[(math.degrees(angle) + 180.0) % 360.0 - 180.0, r] for angle, r in first])


def degrees(beams):
    """Angles of beams, -180 to 180."""
    return (beams * 360.0 / BEAMS + 180.0) % 360.0 - 180.0


class TestScans:
    def test_as_many_packets_and_samples_as_the_real_one(self):
        talk = Talk()
        assert talk.send("scan") == [ScanStarted()]
        packets = talk.wait(10.0)
        samples = sum(len(packet.samples) for packet in packets)
        assert SAMPLE_RATE * 10.0 - 40 <= samples <= SAMPLE_RATE * 10.0
        assert sum(packet.is_ring_start for packet in packets) == math.ceil(SAMPLE_RATE * 10 / SAMPLES)
        assert {len(packet.samples) for packet in packets if packet.is_ring_start} == {1}
        assert {len(packet.samples) for packet in packets} == {1, 40, (SAMPLES - 1) % 40}
        assert packets[0].is_ring_start
        assert packets[0].first == 0
        assert talk.decoder.counts.lost == 0

    @pytest.mark.parametrize("ranges", [0.12, 0.3, 1.0, 10.0])
    def test_a_round_wall(self, ranges):
        points = Talk(ranges).turn()
        assert len(points) == SAMPLES
        assert points[:, 1] == pytest.approx(ranges, abs=0.13e-3)
        gaps = np.diff(np.sort(points[:, 0]))
        assert gaps == pytest.approx(360.0 / SAMPLES, abs=0.1)

    def test_things_are_where_they_are_after_the_correction(self):
        """Within a third of a sample; but in the shadow of an edge nothing is seen."""
        ranges = np.full(BEAMS, 3.0)
        angles = degrees(np.arange(BEAMS))
        near = np.abs(angles - 40.0) < 6.0
        ranges[near] = 0.5
        ranges[np.abs(angles + 90.0) < 3.0] = 0.0
        points = Talk(ranges).turn()
        seen = points[points[:, 1] == 0.5]
        assert (seen[:, 0].min(), seen[:, 0].max()) == pytest.approx((34.0, 46.0), abs=0.5)  # a sample
        assert len(seen) == pytest.approx(12.0 * SAMPLES / 360.0, abs=1)
        for angle, found in points:
            beam = round(angle * BEAMS / 360.0)
            assert found == 0.0 or found in {ranges[(beam + k) % BEAMS] for k in (-2, -1, 0, 1, 2)}
        assert np.mean(points[:, 1] == 0.0) < 0.04

    def test_a_sloping_wall(self):
        angles = np.radians(degrees(np.arange(BEAMS)))
        ranges = 1.0 / np.maximum(np.cos(angles), 0.2)
        points = Talk(ranges).turn()
        inside = np.abs(points[:, 0]) < 75.0
        x = points[inside, 1] * np.cos(np.radians(points[inside, 0]))
        assert x == pytest.approx(1.0, abs=0.008)
        assert inside.sum() == pytest.approx(150.0 * SAMPLES / 360.0, abs=2)

    def test_nothing_in_range(self):
        assert set(Talk(0.0).turn()[:, 1]) == {0.0}


class TestCommands:
    def test_who_it_is_and_how(self):
        talk = Talk()
        assert talk.send("device_info", "health") == [DeviceInfo(6, (1, 4), 1, "2026112100000005"), Health(0)]
        talk.lidar.health = 2
        assert talk.hear(b"\xa5\x91") == [Health(2)]  # as the manual has it

    def test_while_it_scans_it_hears_only_what_ends_that(self):
        talk = Talk()
        talk.send("scan")
        assert all(isinstance(event, Packet) for event in talk.send("device_info", "health", "scan") + talk.wait(0.1))
        assert all(isinstance(event, Packet) for event in talk.send("stop"))
        assert talk.wait(0.5) == []
        assert talk.send("health") == [Health(0)]
        assert talk.send("force_scan") == [ScanStarted()]
        assert talk.wait(0.01)[0].is_ring_start

    def test_a_reboot_takes_a_while(self):
        talk = Talk()
        talk.send("scan")
        talk.wait(0.1)
        talk.send("soft_reboot")
        assert talk.send("health") == []
        assert talk.wait(0.6) == []
        assert talk.send("health") == [Health(0)]


class TestMotor:
    def test_nothing_is_measured_before_it_is_up_to_speed(self):
        talk = Talk(is_open=False)
        assert talk.send("scan") == [ScanStarted()]
        assert talk.wait(1.0) == []
        talk.lidar.set_motor(on=True, now=talk.now)
        assert talk.wait(SPINS_UP - 0.02) == []
        first, *_ = talk.wait(0.1)
        assert first.is_ring_start

    def test_it_stops_with_the_port(self):
        talk = Talk()
        talk.send("scan")
        talk.wait(0.1)
        talk.lidar.set_motor(on=False, now=talk.now)
        assert talk.wait(1.0) == []


@pytest.mark.parametrize("program", SESSIONS)
def test_the_makers_program_starts_a_scan(program):
    """What each version of the YDLidar SDK sends, when it did, from when the port is opened."""
    talk = Talk(is_open=False)
    talk.lidar.set_motor(on=True, now=talk.now)
    began, said = talk.now, []
    for time, sent in SESSIONS[program]:
        said += talk.wait(began + time - talk.now)
        said += talk.hear(sent)
    said += talk.wait(2.0)
    health, info, started, *packets = said
    assert (type(health), type(info), type(started)) == (Health, DeviceInfo, ScanStarted)
    turns = Turns()
    whole = [turn for packet in packets if (turn := turns.receive(packet))]
    assert len(whole) >= 12
    assert all(len(turn) == SAMPLES for turn in whole)
