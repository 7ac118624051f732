"""mercator-robot calibrate: sensors are measured while somebody, here a test, puts robot and hand in their places."""

import contextlib
import errno
import fcntl
import math
import os
import random
import subprocess
import sys
import termios
import time

import pytest

from mercator_design.errors import MercatorError, RobotError
from mercator_design.robot.cli import main
from mercator_design.robot.cli.calibrate import _write
from mercator_design.robot.devices import settings_file
from mercator_design.robot.devices.ports import open_ports
from mercator_design.robot.devices.settings import Settings, read_settings
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.setup import ground_calibration, prompt, proximity_calibration
from mercator_design.robot.setup.ground_calibration import check_light, confused, ground_sensor, warnings
from mercator_design.robot.setup.proximity_calibration import direction, hub
from mercator_design.twin.devices import hub as twin_hub
from tests.processes import LIMIT, wait_until
from tests.robot.devices import CLEAR, Devices
from tests.robot.ways import MAIN, ROOT, SOON, made_in_time

RING = Settings().proximity_angles
OFTEN = """
from mercator_design.robot.setup import ground_calibration
start = ground_calibration.start_streams
ground_calibration.start_streams = lambda link, needed, optional, _: start(link, needed, optional, 0.033)
"""
"""The RVR tells more in less time."""
COMMAND = [sys.executable, "-c", SOON + OFTEN + MAIN, "calibrate"]


@pytest.fixture
def live(monkeypatch):
    """Devices in real time, for a process."""
    monkeypatch.setattr(twin_hub, "RATE", 800.0)
    with Devices() as devices:
        yield devices


@pytest.fixture
def devices(simulated):
    return simulated


@contextlib.contextmanager
def calibrate(folder, devices, *arguments, settings=""):
    """A process that asks; `robot.yaml` is in the folder."""
    names = devices.names
    ports = f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\n"
    (folder / "robot.yaml").write_text(f"# mine\n{ports}{settings}")
    process = subprocess.Popen(
        [*COMMAND, *arguments, "--robot", "robot.yaml"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def settle(devices):
    """Until what was measured before has come to the program."""
    devices.settle()
    devices.when(devices.is_silent)
    time.sleep(0.03)


def answer(process, devices, act):
    """Press Enter at every question, once `act` has done what it says; the lines that were said."""
    said = []
    for line in process.stderr:
        said.append(line.rstrip("\n"))
        if line.endswith(", then press Enter.\n"):
            act(line)
            settle(devices)
            process.stdin.write("\n")
            process.stdin.flush()
    process.wait()
    return said


FLOOR = {"black": (7, 8, 6), "gray": (93, 99, 90), "white": (214, 220, 205)}


def lamp(devices):
    """When it was switched on and off."""
    return [values["is_enabled"] for _, name, values in devices.commands if name == "enable_color_detection"]


class TestColor:
    @pytest.mark.timing
    @made_in_time
    def test_from_the_command_to_robot_yaml(self, live, tmp_path):
        def put_on(line):
            name = line.split()[4].rstrip(",")
            live.measured["ground_sensors"] = FLOOR[name]

        kept = "labels: {red: [90, 10, 10]}  # by hand\n"
        with calibrate(tmp_path, live, "color", "black", "gray", "white", "--seconds", "0.6", settings=kept) as process:
            said = answer(process, live, put_on)
            assert process.returncode == 0, said
            printed = process.stdout.read()
        assert printed == "labels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n  white: [214, 220, 205]\n"
        assert [line for line in said if "then press" not in line] == [
            *(
                f"{name}: {red}.0 {green}.0 {blue}.0, spread 0.0, of {n} measurements"
                for (name, (red, green, blue)), n in zip(FLOOR.items(), counts(said), strict=True)
            ),
            "Written to robot.yaml",
        ]
        assert read_settings(tmp_path / "robot.yaml").labels == {"red": (90, 10, 10), **FLOOR}
        text = (tmp_path / "robot.yaml").read_text()
        assert text.startswith("# mine\n")
        assert text.endswith("white: [214, 220, 205]}  # by hand\n")
        assert not live.drives()
        assert lamp(live) == [True, False]

    @pytest.mark.timing
    @made_in_time
    def test_a_robot_that_knows_one_colour_only_is_reported(self, live, tmp_path):
        live.measured["ground_sensors"] = FLOOR["gray"]
        with calibrate(tmp_path, live, "color", "gray", "--seconds", "0.6") as process:
            said = answer(process, live, lambda _: None)
        assert "Note: the robot knows only gray now; measure all other colours of its floors, too" in said

    @pytest.mark.parametrize(
        ("kind", "keys"),
        [
            (["color"], ["labels"]),
            (["proximity"], ["proximity_angles"]),
            (["proximity", "--distance", "0.3"], ["proximity_angles", "proximity_offsets"]),
        ],
    )
    def test_before_anything_is_measured_the_file_is_tried(self, kind, keys, robot_command, tmp_path, monkeypatch):
        def refuse(text, way, value):
            raise ValueError

        file = tmp_path / "robot.yaml"
        file.write_text("name: r7\n")
        monkeypatch.setattr(settings_file, "put", refuse)
        words = f"Error: {file} is written in a way that cannot be changed; put {', '.join(keys)} there yourself\n"
        assert robot_command("calibrate", *kind, "--robot", file) == (3, "", words)

    def test_a_disk_that_is_full(self, tmp_path, monkeypatch, capsys):
        def fail(_):
            raise OSError(errno.ENOSPC, "No space left on device")

        file = tmp_path / "robot.yaml"
        file.write_text("name: r7\n")
        monkeypatch.setattr(os, "fsync", fail)
        with pytest.raises(MercatorError, match=r"robot.yaml: cannot be written: No space left on device$"):
            _write(file, labels=FLOOR)
        assert capsys.readouterr().out.startswith("labels:\n  black: [7, 8, 6]\n")
        assert [each.read_text() for each in tmp_path.iterdir()] == ["name: r7\n"]

    @pytest.mark.timing
    @made_in_time
    def test_an_input_that_ends_changes_nothing(self, live, tmp_path):
        with calibrate(tmp_path, live, "color", "--seconds", "0.6") as process:
            out, said = process.communicate("\n", timeout=LIMIT)
        assert (process.returncode, out) == (1, "")
        assert "Put the robot on gray, then press Enter.\nError: the input has ended without Enter" in said
        assert read_settings(tmp_path / "robot.yaml").labels is None
        live.when(lambda: lamp(live) == [True, False])

    @pytest.mark.timing
    @made_in_time
    def test_a_signal_puts_out_the_lamp(self, live, tmp_path):
        with calibrate(tmp_path, live, "color") as process:
            assert process.stderr.readline() == "Put the robot on black, then press Enter.\n"
            process.terminate()
            assert process.wait(LIMIT) == 143
        live.when(lambda: lamp(live) == [True, False])

    def test_a_sensor_that_is_silent(self, devices):
        devices.silent.add("color_detection")
        with (
            ground_sensor(Settings(ports=devices.names)) as sensor,
            pytest.raises(
                RobotError, match=r"^ground: 0 measurements in 0.2 s; the RVR itself is heard: switch it off and on"
            ),
        ):
            sensor.measure(0.2)

    def test_a_sensor_whose_samples_are_invalid(self, devices):
        devices.rvr.senses.invalid = frozenset({"color_detection"})
        words = r"^ground: 0 measurements in 0.2 s, and \d that the RVR marks as invalid; the RVR itself is heard"
        with ground_sensor(Settings(ports=devices.names)) as sensor, pytest.raises(RobotError, match=words):
            sensor.measure(0.2)

    def test_what_was_measured_before_does_not_count(self, devices):
        with ground_sensor(Settings(ports=devices.names)) as sensor:
            devices.measured["ground_sensors"] = 200, 0, 0
            time.sleep(0.1)
            devices.measured["ground_sensors"] = 100, 0, 0
            settle(devices)
            assert {red for red, _, _ in sensor.measure(0.5)} == {100.0}

    def test_it_is_kept_awake(self, devices, monkeypatch):
        monkeypatch.setattr(ground_calibration, "KEEP_AWAKE_EVERY", 0.0)
        with ground_sensor(Settings(ports=devices.names)) as sensor:
            time.sleep(0.1)
            before = len(devices.commands)
            sensor.attend()
            devices.when(lambda: len(devices.commands) > before)
        assert devices.commands[before][1] == "get_battery_percentage"

    def test_what_is_doubtful(self):
        def gray(level, n=60):
            return [(level, level, level)] * n

        assert list(warnings("gray", gray(93.0))) == []
        assert "keep the robot still" in next(warnings("gray", gray(80.0, 30) + gray(120.0, 30)))
        assert "darker than usual: brightness 100, not 255" in next(warnings("white", gray(100.0)))
        assert "brighter than usual: brightness 99, not 0" in next(warnings("black", gray(99.0)))
        assert list(warnings("black", [*gray(0.0), (0.0, 0.0, 1.0)])) == []
        assert "is the sensor's lamp on, and the robot on the floor?" in next(warnings("black", gray(0.0)))

    def test_without_light(self):
        check_light("black", [(0.0, 0.0, 0.0)] * 60)
        with pytest.raises(RobotError, match=r"^ground: white reads as nothing; is the sensor's lamp on"):
            check_light("white", [(1.0, 1.0, 1.0)] * 60)

    def test_colours_that_cannot_be_told_from_each_other_are_given_no_labels(self, devices):
        levels = {"black": 7, "white": 8}

        def put_on(line):
            devices.measured["ground_sensors"] = (levels[line.split()[-1]],) * 3

        with (
            ground_sensor(Settings(ports=devices.names)) as sensor,
            pytest.raises(RobotError, match="black and white are 2 levels"),
        ):
            ground_calibration.calibrate(sensor, levels, {}, 1.0, put_on, lambda _said: None)

    def test_colours_that_would_be_confused(self):
        """The middle between 90 and 96 is one standard deviation from both; beyond it lies 15.9 % of a normal one."""
        draw = random.Random(1)
        sd = 3.0**0.5  # along the diagonal 6 levels are 6 sqrt(3), their half 3 sqrt(3), which is three of these

        def around(level):
            return [(draw.gauss(level, 3.0 * sd),) * 3 for _ in range(20000)]

        labels = {"gray": (90.0,) * 3, "white": (90.0 + 6.0 * sd,) * 3, "black": (7.0,) * 3}
        (said,) = confused({"gray": around(90.0)}, labels)
        assert said.startswith(
            "gray and white are 18 levels apart, 1.0 standard deviations from the middle between them"
        )
        share = float(said.split()[-4].rstrip("%"))
        assert share == pytest.approx(15.9, abs=0.6)
        assert list(confused({"black": [(7.0, 7.0, 7.0)] * 60}, labels)) == []
        (said,) = confused({"gray": [(90.0,) * 3] * 60, "white": around(90.0 + 6.0 * sd)}, labels)
        assert ", 1.0 standard deviations" in said  # of the wider of two
        (said,) = confused({"red": [(90.0, 90.0, 90.0)] * 60}, {"red": (90.0,) * 3, **labels} | {"white": (255.0,) * 3})
        assert said.startswith("red and gray are 0 levels apart, 0.0 standard deviations")


def test_enter_that_was_pressed_before_is_no_answer(monkeypatch):
    fingers, terminal = os.openpty()
    monkeypatch.setattr(prompt, "STDIN", terminal)
    os.write(fingers, b"\n\n")
    wait_until(lambda: fcntl.ioctl(terminal, termios.FIONREAD, bytes(4)) == (2).to_bytes(4, sys.byteorder))
    waited = []

    def press():
        waited.append(time.monotonic())
        if len(waited) == 1:
            os.write(fingers, b"\n")

    prompt.ask("Wait", press)
    assert len(waited) >= 2
    os.close(fingers)
    os.close(terminal)


def counts(said):
    return [line.split()[-2] for line in said if line.endswith(" measurements")]


WIRED = (3, 0, 1, 2, 7, 6, 5, 4)
"""The place on the ring of each sensor, where somebody plugged them in otherwise."""


class Hand:
    """Somebody who holds something where the question says, seen by one sensor, which reads a little too much."""

    def __init__(self, devices, distance=0.3):
        self.devices, self.distance = devices, distance
        self.questions = []

    def __call__(self, question):
        self.questions.append(question)
        self.devices.measured["proximity"] = [*CLEAR]
        for sensor, place in enumerate(WIRED):
            if direction(RING[place]) in question:
                self.hold(sensor)

    def hold(self, sensor):
        self.devices.measured["proximity"][sensor] = self.distance + 0.002 * sensor - 0.003


def find(devices, ask, distance=None):
    said = []

    def question(text):
        ask(text)
        settle(devices)

    with hub(devices.names) as link:
        return proximity_calibration.calibrate(link, RING, distance, 1.0, question, said.append), said


class TestProximity:
    @pytest.mark.timing
    @made_in_time
    def test_from_the_command_to_robot_yaml(self, live, tmp_path):
        with calibrate(tmp_path, live, "proximity", "--distance", "0.3", "--seconds", "0.2") as process:
            said = answer(process, live, Hand(live))
            assert process.returncode == 0, said
            printed = process.stdout.read()
        assert "sensor 1 looks front left (+45 degrees), and reads -0.001 m too much" in said
        assert printed.startswith("proximity_angles: [-1.5708, 0.7854, 0.0,")
        settings = read_settings(tmp_path / "robot.yaml")
        assert settings.proximity_angles == pytest.approx([RING[place] for place in WIRED], abs=1e-4)
        assert settings.proximity_offsets == pytest.approx([0.002 * k - 0.003 for k in range(8)])
        assert not live.drives()

    def test_without_a_distance_there_are_no_offsets(self, devices):
        hand = Hand(devices, 0.07)
        found, _ = find(devices, hand)
        assert found == (tuple(RING[place] for place in WIRED), None)
        assert [question.split(", ")[0] for question in hand.questions[:3]] == [
            "Leave nothing within 0.75 m around the robot",
            "Hold something flat in front (+0 degrees)",
            "Hold something flat front left (+45 degrees)",
        ]

    def test_what_is_unclear_is_asked_again(self, devices):
        class Clumsy(Hand):
            """Leaves things about, holds its hand before two sensors, then before none, then before another."""

            wrong = iter([(5,), None, (1, 2), (), None, (2,), None])

            def __call__(self, question):
                super().__call__(question)
                if (sensors := next(self.wrong, None)) is not None:
                    self.devices.measured["proximity"] = [*CLEAR]
                    for sensor in sensors:
                        self.hold(sensor)

        found, said = find(devices, Clumsy(devices))
        assert found.angles == tuple(RING[place] for place in WIRED)
        assert [line.removeprefix("Once more: ") for line in said if line.startswith("Once more")] == [
            "something is nearer than 0.75 m before sensor 5",
            "sensors 1, 2 see it; hold something smaller, and stand aside",
            "no sensor sees it; not found yet, perhaps dead: sensors 0, 1, 2, 3, 4, 5, 6, 7",
            "sensor 2 sees it, but was found in front (+0 degrees)",
        ]

    def test_a_dead_sensor(self, devices):
        class Dead(Hand):
            def hold(self, sensor):
                if sensor != 1:
                    super().hold(sensor)

        with pytest.raises(RobotError, match=r"after 3 attempts: no sensor sees it; .* sensors 0, 1, 3, 4, 5, 6, 7$"):
            find(devices, Dead(devices))

    @pytest.mark.parametrize(
        ("distance", "words"), [(0.02, "or it is too near"), (0.55, "sensor 2 sees it at 0.55 m, not 0.3 m")]
    )
    def test_something_held_elsewhere(self, devices, distance, words):
        with pytest.raises(RobotError, match=f"after 3 attempts: .*{words}"):
            find(devices, Hand(devices, distance), 0.3)

    def test_a_sensor_that_is_unplugged(self, devices):
        devices.hub.plugged_in = 0xF6
        with pytest.raises(RobotError, match="proximity: the hub reports as not plugged in: sensors 0, 3"):
            find(devices, Hand(devices))

    def test_a_hub_that_falls_silent(self, devices):
        with hub(devices.names) as link:
            devices.silent.add("proximity")
            with pytest.raises(RobotError, match=r"proximity: 0 measurements in 0.5 s; it was heard before"):
                proximity_calibration.measured(link, 0.5)

    def test_offsets_are_taken_from_what_a_robot_senses(self, devices):
        devices.measured["proximity"] = [0.312, 0.055, 0.02, *CLEAR[3:]]
        settings = Settings(ports=devices.names, proximity_offsets=(0.012, 0.2, 0.1, 0.1, -0.1, 0.0, 0.0, 0.0))
        with (
            open_ports(settings.ports) as ports,
            contextlib.closing(Mercator(settings, ports, ["proximity"], {})) as robot,
        ):
            robot.start()
            robot.attend(time.monotonic() + 0.3)
            values = robot.senses.samples["proximity"].values
        assert values == pytest.approx((0.3, 0.0, -float("inf"), *[float("inf")] * 5))


def test_directions():
    degrees = {
        0: "in front (+0",
        45: "front left (+45",
        180.02: "behind (+180",
        -180: "behind (+180",
        -100: "right (-100",
    }
    for angle, words in degrees.items():
        assert direction(math.radians(angle)) == f"{words} degrees)"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["color", "grau"], "'grau' is not one of"),
        (["color", "--seconds", "0"], "--seconds"),
        (["proximity", "--distance", "3"], "--distance"),
    ],
)
def test_wrong_usage(run_command, arguments, words):
    code, _, said = run_command("mercator-robot", main, "calibrate", *arguments)
    assert (code, words in said) == (2, True), said
