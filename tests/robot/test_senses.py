"""What a robot perceives over damaged lines, in simulated time, by the bytes of a twin."""

import pytest

from benchmarks.damaged_lines import perceived
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.settings import Limits, Settings
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.run.monitor import Monitor, Note
from mercator_design.robot.run.senses import Senses
from tests.tiers import some

pytestmark = pytest.mark.together("kernels")  # compiled once


def monitor_of(senses, settings):
    return Monitor(settings.limits, senses, Answers(), str)


def mean(values):
    values = [*values]
    return sum(values) / len(values)


@pytest.mark.swept
@pytest.mark.parametrize("is_moving", some([False, True], 1))
def test_a_line_with_a_few_damaged_bytes_costs_few_neighbours(is_moving):
    """Of three; without damage exactly so. The bytes that are hit are those of the seed."""
    assert {cycle.neighbours for cycle in perceived(0.0, 1.0, is_moving=is_moving)} == {3}
    cycles = [*perceived(0.001, 5.0, is_moving=is_moving)]
    assert mean(cycle.neighbours for cycle in cycles) > 2.9
    assert mean(cycle.share for cycle in cycles) == pytest.approx(0.999**90, abs=0.03)
    assert not any(cycle.is_silent for cycle in cycles)


@pytest.mark.swept
@pytest.mark.parametrize("rate", some([0.005, 0.02], 1))
def test_a_damaged_line_is_silent_before_neighbours_are_missed_for_long(rate):
    """Once lines have been heard for two seconds it is silent, and stays so."""
    cycles = [*perceived(rate, 3.0, is_moving=False)]
    assert mean(cycle.neighbours for cycle in cycles) < 2.9  # as they would be counted
    assert all(cycle.is_silent for cycle in cycles)


def test_a_damaged_line_is_noted_once_though_the_robot_senses_anew():
    senses, now, notes = Senses(Settings(), (), {}), 0.0, []
    monitor = monitor_of(senses, Settings())
    for _ in range(4):
        for k in range(1, 31):
            now += 0.1
            counts = {"rvr": Counts(), "lidar": Counts(), "proximity": Counts(200 * k, 60 * k, k)}
            notes += monitor.check(now, counts)
        senses.forget()
    assert len(notes) == 1


def test_what_is_not_needed_and_damaged_is_neutral():
    settings = Settings(limits=Limits(proximity_whole=0.5))
    senses = Senses(settings, (), {})
    monitor = monitor_of(senses, settings)
    senses.take(Distances((200, *(65535,) * 7)), 0.1)
    near = senses.readings(0.1)
    counts = {"rvr": Counts(), "lidar": Counts()}
    notes = [*monitor.check(0.1, counts | {"proximity": Counts(20, 0, 0)})]
    assert notes == []
    assert [*monitor.check(0.3, counts | {"proximity": Counts(22, 2, 1)})] == []  # one frame of the first few
    senses.take(Distances((200, *(65535,) * 7)), 1.9)
    assert senses.readings(1.9)[:2] == near[:2]
    notes = [*monitor.check(2.0, counts | {"proximity": Counts(60, 30, 2)})]
    assert notes == [
        Note(
            "proximity: only 28 % of what it sends arrives whole; below 50 % it counts as silent; proximity",
            matters=True,
        )
    ]
    assert near[:2] != (0.0, 0.0)
    assert senses.readings(2.0)[:2] == (0.0, 0.0)
    assert senses.stale(2.0).keys() == {"attitude"}
