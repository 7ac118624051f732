"""The lidar's last turn: any number of readings, anywhere in the turn, and nothing older."""

import math

import pytest

from benchmarks.turning import ROBOTS, perceived
from mercator_design.fsm import ReferenceModel
from mercator_design.modules.clustering import lidar_neighbours
from mercator_design.robot.devices.sweep import BINS, STEP, Sweep
from mercator_design.robot.protocols.ydlidar import SAMPLE_RATE, Packet, correction
from tests.tiers import some

TURN = 360 * 64
THREE = [(0.0, 0.3), (2.0, 0.6), (-1.0, 0.5)]


def packets(heads, n=714, *, wall=0.0, size=40):
    """A turn of n readings: heads of other lidars, 7 cm across, at angles [rad] and distances [m], before a wall."""
    angles = [round(TURN * k / n) for k in range(n)]
    ranges = [reading(-math.tau * angle / TURN, heads, wall) for angle in angles]
    for k in range(0, n, size):
        samples = tuple(round(4000 * distance) for distance in ranges[k : k + size])
        yield Packet(angles[k], angles[min(k + size, n) - 1], samples, is_ring_start=k == 0)


def reading(towards, heads, wall):
    """What the lidar reads towards an angle; where that is depends on how far it is."""
    for at, distance in heads:
        off = towards + correction(distance) - at
        if abs((off + math.pi) % math.tau - math.pi) < math.asin(0.035 / distance):
            return distance
    return wall


def found(sweep):
    rows = [0.0] * BINS, [0.0] * BINS, [0.0] * BINS
    n = lidar_neighbours(ReferenceModel(), sweep.ranges(), 0.0, STEP, *rows)
    return sorted((rows[0][k], math.atan2(rows[2][k], rows[1][k])) for k in range(n))


@pytest.mark.parametrize("n", [360, 500, 714, 719, 833, 1000])
@pytest.mark.parametrize("front", [0.0, 1.0])
def test_any_number_of_readings(n, front):
    sweep = Sweep(front)
    for packet in [*packets(THREE, n)] * 3:
        sweep.add(packet)
    expected = [(0.3, front), (0.5, front - 1.0), (0.6, front + 2.0)]
    assert [place == pytest.approx(each, abs=0.02) for place, each in zip(found(sweep), expected, strict=True)] == [
        True
    ] * 3


def test_while_it_turns_there_is_always_a_whole_turn():
    sweep = Sweep()
    turn = [*packets(THREE)]
    for packet in [*turn, turn[0]]:
        sweep.add(packet)
    for packet in turn[1:] * 3 + turn * 3:
        sweep.add(packet)
        assert len(found(sweep)) == 3


def test_what_has_gone_is_forgotten_when_the_lidar_has_come_by():
    sweep = Sweep()
    for packet in [*packets([(2.0, 0.6)])] * 2:
        sweep.add(packet)
    assert len(found(sweep)) == 1
    for packet in packets([], 700):
        sweep.add(packet)
    sweep.add(Packet(0, 0, (0,), is_ring_start=True))
    assert found(sweep) == []


def test_a_turn_has_ended_when_the_lidar_comes_by():
    sweep, turn = Sweep(), [*packets(THREE)]
    middle = len(turn) // 2
    assert not any(map(sweep.add, [*turn[middle:], *turn]))  # it began in the middle of a turn
    assert [*map(sweep.add, turn)] == [True] + [False] * (len(turn) - 1)
    assert sweep.add(turn[0])
    assert sum(map(sweep.add, [*turn[1:middle], *turn[middle + 3 :], turn[0]])) == 1  # three packets are lost


def test_ring_starts_of_a_lidar_that_does_not_turn_end_none():
    """Nor do those that are not at the same angle each time."""
    sweep = Sweep()
    for packet in [*packets(THREE)] * 2:
        sweep.add(packet)
    starts = [Packet(angle % TURN, angle % TURN, (2000,), is_ring_start=True) for angle in (0, 20, -20, 0, 30)]
    sweep.add(starts[0])  # the end of what was a turn
    assert not any(map(sweep.add, starts * 50))


def test_what_was_near_in_the_turn_before_hides_nothing():
    """The wall behind a robot that has gone is seen as soon as the lidar has come by."""
    sweep, other = Sweep(), Sweep()
    for packet in packets([(1.0, 0.5)], wall=4.0):
        sweep.add(packet)
    for packet in packets([], wall=4.0):
        sweep.add(packet)
        other.add(packet)
    sweep.add(Packet(0, 0, (0,), is_ring_start=True))
    other.add(Packet(0, 0, (0,), is_ring_start=True))
    assert sweep.ranges() == other.ranges()


def test_what_is_far_does_not_hide_what_is_near():
    """Corrected angles of a wall behind a head reach over the head's: not one of its readings is lost."""
    sweep = Sweep()
    for packet in [*packets([(1.0, 0.5)])] * 2:
        sweep.add(packet)
    alone = sum(0.4 < distance < 0.6 for distance in sweep.ranges())
    for packet in [*packets([(1.0, 0.5)], wall=4.0)] * 2:
        sweep.add(packet)
    assert sum(0.4 < distance < 0.6 for distance in sweep.ranges()) == alone
    assert len(found(sweep)) == 1


def test_lost_and_senseless_packets():
    """A gap in a turn is a gap, not a turn; angles that go backwards elsewhere than through north are nobody's.

    What was seen where a gap is stays for a turn, and no longer, even if the same packets are lost again.
    """
    sweep = Sweep()
    turn = [*packets([(2.0, 0.6), (-1.0, 0.5)])]
    with_gap = [*turn[:3], *turn[9:]]
    for packet in [*turn, *with_gap, turn[0]]:
        sweep.add(packet)
    sweep.add(Packet(TURN // 2, TURN // 2 - 640, (2000, 2000)))
    assert [distance for distance, _ in found(sweep)] == pytest.approx([0.5, 0.6], abs=0.01)
    sweep.add(Packet(turn[0].last - 3, turn[0].last - 3, (0,)))  # a step back
    assert len(found(sweep)) == 2
    for packet in [*with_gap[1:], turn[0]]:
        sweep.add(packet)
    assert [distance for distance, _ in found(sweep)] == pytest.approx([0.6], abs=0.01)


def test_what_has_gone_from_a_gap_is_forgotten_when_the_lidar_has_looked_there():
    sweep, turn, empty = Sweep(), [*packets([(2.0, 0.6), (-1.0, 0.5)])], [*packets([])]
    for packet in [*turn, *empty[:3], *empty[9:], empty[0]]:
        sweep.add(packet)
    assert [distance for distance, _ in found(sweep)] == pytest.approx([0.5], abs=0.01)
    for packet in [*empty[1:], empty[0]]:
        sweep.add(packet)
    assert found(sweep) == []


@pytest.mark.parametrize("size", [8, 40])
@pytest.mark.parametrize("n", [417, 714, 1000])
def test_how_much_of_a_turn_is_lost_is_counted(n, size):
    """A turn of the lidar is a turn, however fast it goes and whatever is near; each lost packet is its own share."""
    sweep, turn = Sweep(), [*packets(THREE, n, wall=0.2, size=size)]
    for packet in [*turn, *turn, turn[0]]:
        sweep.add(packet)
    assert (sweep.swept.lost, sweep.swept.all) == (0, pytest.approx(2 * TURN, rel=0.07))
    before = sweep.swept
    for packet in [*turn[1:3], *turn[5:], turn[0]]:
        sweep.add(packet)
    assert sweep.swept.all - before.all == pytest.approx(TURN, abs=1)
    assert sweep.swept.lost - before.lost == pytest.approx(TURN * (2 * size + 1) / n, abs=2)


def timed(turns):
    """Packets of turns, and when each was measured [s]."""
    samples = 0
    for number in range(turns):
        for packet in packets(THREE, wall=1.0):
            samples += len(packet.samples)
            yield number, packet, samples / SAMPLE_RATE


@pytest.mark.parametrize("period", [2, 3, 5])
def test_whole_turns_that_are_lost_are_counted(period):
    sweep = Sweep()
    for number, packet, measured in timed(60):
        if number % period:
            sweep.add(packet, read=measured)
    assert sweep.swept.lost / sweep.swept.all == pytest.approx(1.0 / period, abs=0.03)


@pytest.mark.swept
@pytest.mark.parametrize("rate", some([0.92, 1.0, 1.08], 2))
@pytest.mark.parametrize("pace", [0.0, 0.1])
def test_packets_that_are_read_late_are_not_lost(rate, pace):
    """The first 0.3 s of each second are read together, or one after the other, ten times as fast as they came."""
    sweep = Sweep()
    for _, packet, measured in timed(60):
        second, part = divmod(measured, 1.0)
        sweep.add(packet, read=(second + max(part, 0.3 + pace * part)) / rate)
    assert sweep.swept.lost == 0


@pytest.mark.parametrize("speed", [0.0, 4.0, -4.0])
def test_a_robot_that_turns_loses_nothing(speed):
    sweep, turned = Sweep(), 0.0
    for packet in [*packets(THREE)] * 20:
        ended = turned + speed * len(packet.samples) / 5000
        sweep.add(packet, turned, ended)
        turned = ended + 0.02 * speed * (-1) ** len(packet.samples)  # what the RVR tells comes late
    assert sweep.swept.lost == 0


@pytest.mark.parametrize("speed", [0.0, 1.0, -2.0, 4.0, -4.0])
def test_the_others_stay_where_they_are_while_the_robot_turns(speed):
    """Each is found once, where it is now; its bearing may be wrong by what the RVR tells late."""
    for found in perceived(speed, 5.0, is_corrected=True):
        assert found.robots == len(ROBOTS)
        assert found.error < 0.02 + 0.005 * abs(speed)


@pytest.mark.parametrize("front", [0.0, 1.0])
def test_a_blind_sector_turns_with_the_robot(front):
    """A part of the robot is never seen, what stands beside it is, wherever the robot looks."""
    sweep = Sweep(front, [(math.degrees(2.0 + front) - 15.0, math.degrees(2.0 + front) + 15.0)])
    for k in range(6):
        for packet in packets([(2.0, 0.3), (-1.0, 0.5)]):
            sweep.add(packet, 0.7 * k, 0.7 * k)
        near = [bearing for distance, bearing in found(sweep) if distance < 0.4]
        assert (near, len(found(sweep))) == ([], 1 if k else len(found(sweep)))


def test_a_sector_over_the_front():
    sweep = Sweep(0.0, [(350.0, 10.0)])
    for packet in [*packets(THREE)] * 2:
        sweep.add(packet)
    assert [distance for distance, _ in found(sweep)] == [pytest.approx(0.5, abs=0.01), pytest.approx(0.6, abs=0.01)]
