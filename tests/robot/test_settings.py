"""A robot's settings: what a file may say, and which colours its floor may have."""

from pathlib import Path

import pytest

from mercator_design.config.loading import parse
from mercator_design.config.schema import fields_of
from mercator_design.config.writing import dump
from mercator_design.errors import FsmError, SettingsError
from mercator_design.fsm import ReferenceModel
from mercator_design.robot.devices.ports import PortNames
from mercator_design.robot.devices.settings import Limits, Settings, control_period_of, nearest, read_settings


def settings(text):
    return parse(text, Settings, error=SettingsError)


def test_all_may_be_left_out(tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text("name: r7\n")
    assert read_settings(file) == Settings(name="r7")
    assert settings(dump(Settings())) == Settings()
    for nothing in ("", "\n# a robot as usual\n"):
        file.write_text(nothing)
        assert read_settings(file) == Settings()


def test_the_example_in_the_documents_has_every_key():
    document = (Path(__file__).parents[2] / "docs" / "reference" / "robot-yaml.md").read_text()
    example = document.partition("\n## robot.yaml")[2].split("```")[1]
    read = settings(example)
    assert (read.name, read.missions) == ("mercator-3", {"aggregation": ("black", "gray")})
    keys = {line.partition(":")[0].strip() for line in example.splitlines()}
    assert keys >= {*fields_of(Settings), *fields_of(Limits)} - {"schema"}


def test_ports_that_are_left_out_are_the_usual_ones():
    assert settings("ports: {proximity: usb:0483:5740:A1}").ports == PortNames(proximity="usb:0483:5740:A1")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("limits: {spede: 0.3}", "limits.spede: unknown key; did you mean 'speed'"),
        ("limits: {speed: 1.6}", r'limits.speed: expected a number >= 0.01 and <= 1.55 \[m/s\], found "1.6"'),
        ("limits: {rvr: 0.09}", "limits.rvr: expected a number >= 0.1"),
        ("limits: {proximity: 0.2}", "limits.proximity: expected a number >= 0.3"),
        ("limits: {lidar: 0.2}", "limits.lidar: expected a number >= 0.3"),
        ("swarm: {heartbeat: 0.06}", "swarm.heartbeat: expected a number >= 0.3"),
        ("labels: {blak: [0, 0, 0]}", "labels.blak: expected one of black.*; did you mean 'black'?"),
        ("labels: {black: [0, 0, 256]}", "labels.black\\[2\\]"),
        ("missions: {aggregation: []}", "missions.aggregation: expected a list of at least 1"),
        ("proximity_angles: [0, 1]", "proximity_angles: expected a list"),
        ("swarm: {port: null, heartbeat: 1}", "swarm.heartbeat: there is no port to receive it on"),
        ("reference_model: {neighbour_memory: 5}", "reference_model.neighbour_memory: expected 0"),
        ("ports: {lider: /dev/ttyUSB0}", "ports.lider"),
        (
            "ports: {lidar: ttyUSB0}",
            r'ports.lidar: expected text: a path or usb:VENDOR:PRODUCT\[:SERIAL\], found "ttyUSB0"',
        ),
        ("ports: {lidar: usb:10C4:EA60}", "ports.lidar: expected text: a path or"),
        (r'ports: {rvr: "/dev/a\0b"}', "ports.rvr: expected text: a path or"),
        (r'ports: {rvr: "/dev/a\n"}', "ports.rvr: expected text: a path or"),
        ("ports: {rvr: /dev/a, proximity: /dev/a}", "ports.proximity: /dev/a is the port of rvr already"),
        ("ports: {rvr: /dev/ttyACM0}", "ports.proximity: /dev/ttyACM0 is the port of rvr already"),
    ],
)
def test_what_is_wrong_is_named(text, words):
    with pytest.raises(SettingsError, match=f"text:2: {words}") as refused:
        settings(f"# a robot\n{text}\n")
    assert refused.value.exit_code == 3


class TestAsRaced:
    def test_an_old_file_tells_nothing(self):
        assert Settings().as_raced({"mission": "aggregation"}) == Settings()
        assert control_period_of({}) == 0.1

    def test_a_new_one_does(self):
        header = {"maximum speed": "0.2", "reference model": '{"neighbour_range": 0.5}', "control period": "0.05"}
        raced = settings("limits: {speed: 0.5}\nreference_model: {neighbour_range: 0.5}").as_raced(header)
        assert (raced.limits.speed, raced.reference_model.neighbour_range) == (0.2, 0.5)
        assert Settings().as_raced(header).reference_model == ReferenceModel(neighbour_range=0.5)
        assert control_period_of(header) == 0.05

    @pytest.mark.parametrize(
        ("key", "told", "words"),
        [
            ("maximum speed", "0.5", "expected at most limits.speed, 0.3 m/s, found 0.5"),
            ("maximum speed", "nan", "expected a number >= 0.01"),
            (
                "reference model",
                "{}",
                "neighbour_range: expected 0.6, as the robot's reference_model has it, found 0.75",
            ),
            ("reference model", '{"neighbour_rangee": 1}', "unknown key; did you mean 'neighbour_range'"),
            ("reference model", '{"neighbour_memory": 5, "neighbour_range": 0.6}', "this robot has no memory"),
            ("reference model", "{", "not valid YAML"),
            ("control period", "0.2", "expected a number >= 0.05 and <= 0.12"),
        ],
    )
    def test_what_this_robot_cannot_do_is_refused(self, key, told, words):
        with pytest.raises(FsmError) as error:
            settings("reference_model: {neighbour_range: 0.6}").as_raced({key: told})
        assert "header" in str(error.value)
        assert words in str(error.value)


class TestLabels:
    def test_of_a_robot_that_was_not_measured(self):
        labels = Settings().labels_of({"mission": "aggregation"})
        assert list(labels) == ["black", "gray", "white", "red", "green", "blue", "yellow"]
        assert nearest(labels, (60.0, 60.0, 60.0)) == "black"
        assert nearest(labels, (200.0, 200.0, 200.0)) == "white"
        assert nearest(labels, (130.0, 140.0, 120.0)) == "gray"
        assert nearest(labels, (250.0, 240.0, 90.0)) == "yellow"

    def test_of_one_that_was(self):
        """The paper's reason for labels: sensors that read too dark or too bright."""
        labels = settings("labels: {black: [2, 3, 3], gray: [30, 33, 31], white: [80, 85, 82]}").labels_of({})
        assert nearest(labels, (25.0, 25.0, 25.0)) == "gray"
        assert nearest(labels, (70.0, 70.0, 70.0)) == "white"
        assert list(labels) == ["black", "gray", "white"]

    def test_of_a_mission(self):
        text = "labels: {black: [5, 5, 5], red: [90, 10, 10]}\nmissions: {two spots: [black, red]}"
        labels = settings(text).labels_of({"mission": "two spots", "floor": "gray, white"})
        assert labels == {"black": (5.0, 5.0, 5.0), "red": (90.0, 10.0, 10.0)}
        assert nearest(labels, (200.0, 200.0, 200.0)) == "red"
        assert list(settings(text).labels_of({"mission": "another"})) == ["black", "red"]

    def test_of_the_floor_in_the_header_of_an_fsm(self):
        labels = settings("labels: {red: [90, 10, 10], black: [5, 5, 5]}").labels_of({"floor": "red, black"})
        assert labels == {"black": (5.0, 5.0, 5.0), "red": (90.0, 10.0, 10.0)}
        assert Settings().labels_of({"floor": "gray, black"}) == {"black": (0.0,) * 3, "gray": (127.0,) * 3}
        with pytest.raises(FsmError, match=r"floor in the header: expected black, .*, found 'grey'"):
            Settings().labels_of({"floor": "grey, black"})

    def test_of_a_floor_that_was_measured_in_part(self):
        """What a dark sensor reads on white may be nearer to its black than to what others read."""
        measured = settings("labels: {black: [7, 8, 6], red: [90, 10, 10]}")
        words = r"\(black, white, gray\), found none of white, gray; .* `mercator-robot calibrate color white gray`"
        with pytest.raises(SettingsError, match=words):
            measured.labels_of({"floor": "black, gray, white"})

    def test_of_two_that_are_as_near_the_first(self):
        assert nearest({"white": (2.0, 0.0, 0.0), "black": (0.0, 0.0, 0.0)}, (1.0, 0.0, 0.0)) == "white"


def test_a_battery_is_low_before_it_is_critical():
    with pytest.raises(SettingsError, match=r"limits.battery_low: expected at least battery_critical, 50 %, found 20"):
        settings("limits: {battery_critical: 50}")
