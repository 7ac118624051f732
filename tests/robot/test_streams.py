"""What the RVR streams, refuses and marks as invalid: what `mercator-robot check` and `run` say and do."""

import itertools
import time

import pytest

from mercator_design.robot.cli import main
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import Line, open_port
from mercator_design.robot.devices.samples import SERVICE_OF, Sample, heading
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.streams import start_streams
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.setup import check as checking
from mercator_design.twin.devices.rvr import Refused
from tests.robot.log_events import read
from tests.robot.ways import GO, check

GROUND = "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 1"
"""Stops once it sees black."""
FAILED, BUSY, RESTRICTED = 6, 8, 4


def refuses(command, service=None, error=FAILED):
    return lambda devices: setattr(devices.rvr, "refused", (Refused(command, service, error),))


def does_not_stream(*services):
    return lambda devices: setattr(devices.rvr.senses, "silent", frozenset(services))


def streams_slowly(service, period):
    return lambda devices: setattr(devices.rvr.senses, "slow", {service: period})


def marks_as_invalid(*services):
    return lambda devices: setattr(devices.rvr.senses, "invalid", frozenset(services))


def without_lamp(devices):
    devices.rvr.senses.lamp_fails = True


def configures(service):
    return refuses("configure_streaming_service", service)


@pytest.fixture
def devices(simulated, monkeypatch):
    monkeypatch.setattr(checking, "DURATION", 1.0)
    simulated.heads = [(1.0, 2.0)]
    simulated.measured["ground_sensors"] = (120.0, 130.0, 125.0)
    return simulated


@pytest.fixture
def checked(robot_command, devices, tmp_path):
    """Check the RVR; the exit code, and mark and words by what was checked."""

    def run(settings=""):
        file = tmp_path / "robot.yaml"
        file.write_text(f"ports: {{rvr: {devices.names.rvr}}}\n{settings}")
        code, out, _ = robot_command("check", "--robot", file, "--without", "lidar", "--without", "proximity")
        return code, {line[7:34].strip(): (line[:5].strip(), line[34:]) for line in out.splitlines()}

    return run


def cycles(robot):
    return [event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle"]


def notes(robot):
    return [event["text"] for event in read(robot.folder / "log.jsonl") if event["event"] == "note"]


def grounds(robot):
    return {tuple(event["readings"][5:8]) for event in cycles(robot)}


def services(devices):
    """What the RVR was asked to stream when it was asked last."""
    slots = devices.rvr._line.slots
    return {name for processor in Processor for names in slots.of(processor).values() for name in names}


class TestCheck:
    @pytest.mark.parametrize(
        ("prepare", "sensor", "mark", "words"),
        [
            (
                does_not_stream("color_detection"),
                "ground",
                "WRONG",
                "0.0 samples a second; a run that reads the ground",
            ),
            (does_not_stream("imu"), "attitude", "WRONG", "0.0 samples a second; every run is refused"),
            (does_not_stream("ambient_light"), "ambient light", "look", "0.0 samples a second"),
            (
                streams_slowly("color_detection", 0.4),
                "ground",
                "WRONG",
                "2.5 samples a second, up to 0.40 s apart; the",
            ),
            (streams_slowly("color_detection", 0.2), "ground", "look", "5.0 samples a second, not 20.0 (rvr.period)"),
            (streams_slowly("locator", 0.4), "velocity", "look", "2.5 samples a second, up to 0.4"),
            (marks_as_invalid("color_detection"), "ground", "WRONG", "0.0 samples a second, and 20 of 20 marked as"),
            (
                marks_as_invalid("ambient_light"),
                "ambient light",
                "look",
                "0.0 samples a second, and 20 of 20 marked as",
            ),
            (configures("ambient_light"), "ambient light", "look", "the RVR does not stream ambient_light: failed"),
            (configures("gyroscope"), "turning", "look", "the RVR does not stream gyroscope: failed"),
            (
                configures("color_detection"),
                "ground",
                "WRONG",
                "the RVR does not stream color_detection: failed; a run",
            ),
            (refuses("configure_streaming_service"), "attitude", "WRONG", "the RVR does not stream imu: failed; every"),
            (refuses("start_streaming_service"), "attitude", "WRONG", "the RVR does not stream imu: failed; every"),
        ],
    )
    def test_streams(self, checked, devices, prepare, sensor, mark, words):
        prepare(devices)
        code, found = checked()
        assert found[f"rvr's {sensor}"][0] == mark
        assert found[f"rvr's {sensor}"][1].startswith(words)
        assert code == (mark == "WRONG")
        assert not any(devices.rvr.senses.is_streaming(each) for each in Processor)

    def test_echoes_that_the_rvr_refuses(self, checked, devices):
        """A run asks for none; a refusal shows that the line carries commands and answers."""
        refuses("echo")(devices)
        code, found = checked()
        mark, words = found["rvr's echoes"]
        assert (code, mark, words) == (0, "ok", "20 of 20 were answered")

    def test_services_beside_one_that_is_refused_are_streamed(self, checked, devices):
        configures("accelerometer")(devices)
        _, found = checked()
        marks = {name: found[f"rvr's {name.replace('_', ' ')}"][0] for name in SERVICE_OF}
        assert marks == {**dict.fromkeys(SERVICE_OF, "ok"), "acceleration": "look"}

    @pytest.mark.parametrize(
        ("levels", "prepare", "settings", "mark", "words"),
        [
            ((120.0, 130.0, 125.0), lambda _: None, "", "ok", "120 130 125, which is gray"),
            ((3.0, 0.0, 2.0), lambda _: None, "", "ok", "3 0 2, which is black"),
            (
                (90.0, 90.0, 90.0),
                lambda _: None,
                "labels: {black: [80, 90, 90], white: [200, 200, 200]}",
                "ok",
                "90 90 90",
            ),
            ((0.0, 0.0, 0.0), lambda _: None, "", "look", "0 0 0 in all samples: is the lamp below on"),
            ((120.0, 130.0, 125.0), without_lamp, "", "look", "0 0 0 in all samples: is the lamp below on"),
            (
                (0.0, 0.0, 0.0),
                lambda _: None,
                "limits: {dark: null}",
                "look",
                "0 0 0 in all samples, which is black by",
            ),
        ],
    )
    def test_the_colour_of_the_ground(self, checked, devices, levels, prepare, settings, mark, words):
        devices.measured["ground_sensors"] = levels
        prepare(devices)
        code, found = checked(settings)
        assert (code, found["ground's colour"][0]) == (0, mark)
        assert found["ground's colour"][1].startswith(words)

    @pytest.mark.parametrize(
        ("prepare", "what", "mark", "words"),
        [
            (
                refuses("enable_motor_stall_notify"),
                "rvr's reports",
                "look",
                "a run does without what the RVR refuses: e",
            ),
            (
                refuses("get_motor_fault_state", error=None),
                "rvr's reports",
                "look",
                "a run does without what the RVR re",
            ),
            (refuses("get_motor_thermal_protection_status"), "motors", "look", "not known"),
            (refuses("get_main_application_version"), "firmware st", "look", "not known"),
            (refuses("get_battery_percentage"), "battery", "look", "not known"),
            (
                refuses("enable_color_detection"),
                "ground's lamp",
                "WRONG",
                "the RVR does not switch it on: failed; a run",
            ),
            (refuses("drive_stop"), "rvr", "WRONG", "drive_stop was refused: failed; switch it off and on"),
            (refuses("set_custom_control_system_timeout"), "rvr", "WRONG", "set_custom_control_system_timeout was ref"),
            (
                refuses("drive_tank_si_units", error=RESTRICTED),
                "rvr's drive",
                "WRONG",
                "it does not drive: restricted;",
            ),
            (refuses("get_active_control_system_id"), "rvr's drive", "ok", "commands end by themselves"),
        ],
    )
    def test_commands(self, checked, devices, prepare, what, mark, words):
        """Only what a run cannot do without is wrong."""
        prepare(devices)
        code, found = checked()
        assert (code, found[what][0]) == (int(mark == "WRONG"), mark)
        assert found[what][1].startswith(words)

    def test_streams_of_a_program_that_was_killed(self, checked, devices):
        """The RVR still streams, and changes no slots meanwhile."""
        with open_port("rvr", devices.names.rvr) as port:
            start_streams(Link([Line("rvr", port)]), ["ground", "attitude"], [], 0.05)
        devices.rvr.locks_slots = True
        code, found = checked()
        assert (code, found["rvr's ground"]) == (0, ("ok", "20.0 samples a second"))

    def test_a_stop_of_such_streams_that_was_lost(self, checked, devices):
        with open_port("rvr", devices.names.rvr) as port:
            start_streams(Link([Line("rvr", port)]), ["ground", "attitude"], [], 0.05)
        devices.rvr.locks_slots = True
        devices.once["stop_streaming_service"] = {"error": BUSY}
        code, found = checked()
        assert (code, found["rvr's ground"]) == (0, ("ok", "20.0 samples a second"))


class TestRun:
    @pytest.mark.parametrize(
        ("prepare", "words"),
        [
            (does_not_stream("color_detection"), "ground: nothing yet; the RVR itself is heard: switch it off and on"),
            (
                streams_slowly("color_detection", 0.4),
                "ground: 0.40 s between two samples; the limit is 0.25 s; the RVR itself is heard",
            ),
            (streams_slowly("imu", 30.0), "attitude: nothing for 4."),
            (marks_as_invalid("color_detection"), "ground: nothing yet, as the RVR marks all samples as invalid ("),
            (configures("color_detection"), "rvr: it does not stream color_detection, so there is no ground: failed;"),
            (refuses("start_streaming_service"), "rvr: it does not stream imu, so there is no attitude: failed;"),
        ],
    )
    def test_refused(self, robot, devices, prepare, words):
        prepare(devices)
        robot.run(GROUND)
        assert check(robot, 1, words, zeros=False)
        assert not devices.drives()

    @pytest.mark.parametrize(
        ("prepare", "words"),
        [
            (configures("gyroscope"), "rvr: it does without turning: failed"),
            (refuses("configure_streaming_service", "locator", None), "rvr: it does without position: no answer"),
            (refuses("enable_motor_stall_notify"), "rvr: it does without enable motor stall notify: failed"),
            (refuses("reset_yaw"), "rvr: it does without reset yaw: failed"),
            (refuses("get_motor_fault_state", error=None), "rvr: it does without get motor fault state: no answer"),
            (refuses("get_battery_percentage", error=None), "rvr: it does without get battery percentage: no answer"),
        ],
    )
    def test_what_informs_is_named_and_not_needed(self, robot, devices, prepare, words):
        prepare(devices)
        robot.run(GROUND, "--duration", "1")
        assert words in check(robot, 0, "The duration is over")
        assert words in notes(robot)
        assert {"ground", "attitude"} <= cycles(robot)[-1]["sensed"].keys()

    @pytest.mark.parametrize("query", ["get_motor_fault_state", "get_battery_voltage_state"])
    def test_a_query_that_is_refused_is_not_repeated(self, robot, devices, query):
        refuses(query)(devices)
        robot.run(GO, "--duration", "3")
        check(robot, 0, "The duration is over")
        names = [name for _, name, _ in devices.commands]
        assert names.count(query) == 1
        assert names.count("get_battery_percentage") > 2

    @pytest.mark.parametrize(
        ("fsm", "streamed"),
        [
            ("--nstates 1 --s0 1", {"imu", "locator"}),
            (GO, {"imu", "gyroscope", "locator"}),  # it turns away from obstacles
            (GROUND, {"imu", "gyroscope", "locator", "color_detection"}),
        ],
    )
    def test_only_what_the_pfsm_reads_is_streamed(self, robot, devices, fsm, streamed):
        asked = []
        robot.act(
            lambda _: asked.append(services(devices)),
            when=lambda: "set_all_leds" in {n for _, n, _ in devices.commands},
        )
        robot.run(fsm, "--duration", "1")
        check(robot, 0, "The duration is over")
        assert asked == [streamed]

    def test_the_period_and_the_timeout_of_robot_yaml(self, robot, devices):
        robot.run(GO, "--duration", "1", settings="}\nrvr: {period: 0.1, timeout: 0.5")
        assert "commands end seen after 0.5 s" in check(robot, 0, "The duration is over")
        values = {name: values for _, name, values in devices.commands[::-1]}
        assert values["start_streaming_service"] == {"period": 100}
        assert values["set_custom_control_system_timeout"] == {"command_timeout": 500}

    def test_no_light_is_no_black(self, robot, devices):
        without_lamp(devices)
        robot.run(GROUND, "--duration", "1")
        assert "ground: it reads nothing but 0, 0, 0, which counts as not seen" in check(
            robot, 0, "The duration is over"
        )
        assert grounds(robot) == {(255.0, 255.0, 255.0)}
        assert sum(text.startswith("ground: it reads nothing") for text in notes(robot)) == 1

    def test_a_lamp_that_fails_and_comes_back(self, robot, devices):
        robot.act(lambda _: without_lamp(devices))
        robot.act(
            lambda _: setattr(devices.rvr.senses, "lamp_fails", False), lambda: time.monotonic() > robot.began + 1.5
        )
        robot.run(GROUND.replace("--p0x0 1", "--p0x0 0"), "--duration", "4")
        check(robot, 0, "The duration is over")
        lost, found = (text for text in notes(robot) if text.startswith("ground: "))
        assert lost.startswith("ground: it reads nothing but 0, 0, 0,")
        assert found == "ground: it is seen again"
        gray, black, white = (127.0,) * 3, (0.0,) * 3, (255.0,) * 3
        seen = [tuple(event["readings"][5:8]) for event in cycles(robot)]
        assert [each for each, _ in itertools.groupby(seen)] == [gray, black, white, gray]
        assert seen.count(black) <= 6  # limits.dark

    def test_black_floors_that_read_0_0_0_by_the_settings(self, robot, devices):
        devices.measured["ground_sensors"] = (0.0, 0.0, 0.0)
        robot.run(GROUND, "--duration", "1", settings="}\nlimits: {dark: null")
        check(robot, 0, "The duration is over")
        assert grounds(robot) == {(0.0, 0.0, 0.0)}
        assert not any(text.startswith("ground: ") for text in notes(robot))


class TestHeading:
    def test_without_a_gyroscope(self):
        latest = {"attitude": Sample(1.0, (0.0, 0.0, 0.5))}
        assert heading(latest, 1.04) == 0.5
        latest["turning"] = Sample(1.0, (0.0, 0.0, 2.0))
        assert heading(latest, 1.04) == pytest.approx(0.58)
        latest["turning"] = Sample(0.4, (0.0, 0.0, 2.0))
        assert heading(latest, 1.04) == 0.5


def test_the_limit_is_longer_than_the_period(tmp_path, run_command):
    file = tmp_path / "robot.yaml"
    file.write_text("rvr: {period: 0.2}\n")
    code, _, err = run_command("mercator-robot", main, "check", "--robot", file)
    assert code == 3
    assert "limits.rvr: expected at least twice rvr.period, 0.4 s, found 0.25" in err
    assert Settings().limits.rvr >= 2.0 * Settings().rvr.period
