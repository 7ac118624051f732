"""Sensors and the values of their samples stand in one table, as it is measured and as robot models have it."""

from mercator_design.calibration.sensors import SENSORS
from mercator_design.robot.devices.samples import FIELDS, STREAMED, converted
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import StreamData
from tests.robot.lines import QUIET


def test_samples_have_the_values_of_the_table():
    streamed = StreamData(Processor.ST, 1, is_valid=True, values={name: QUIET[name] for name in STREAMED})
    samples = dict([*converted(streamed), *converted(Distances((500,) * 8))])
    assert {name: len(values) for name, values in samples.items()} == {
        name: len(values) for name, values in FIELDS.items()
    }


def test_the_noise_of_each_can_be_measured():
    assert {sensor.recorded for sensor in SENSORS} == {*FIELDS, "lidar"}
