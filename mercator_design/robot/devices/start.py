"""Start-up of each device, with its identity and health, and its shut-down."""

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple, TypeVar

from mercator_design.errors import RobotError, RobotStopped
from mercator_design.robot.devices.health import charge
from mercator_design.robot.devices.link import ANSWER_WAIT, Heard, Link
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.streams import end_streaming
from mercator_design.robot.protocols import multiflex
from mercator_design.robot.protocols.multiflex import Acknowledgement, Distances
from mercator_design.robot.protocols.rvr import Notification
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.ydlidar import MODEL, DeviceInfo, Health, Packet, ScanStarted, encode_command

_ERROR = 2  # health of a lidar
_TRIES = 5  # to get the same answer twice from a lidar
_DISTANCES_WAIT = 0.5  # [s] for distances of the hub, which come 6 times a second
_STOP = encode_command("force_stop") + encode_command("stop")
S = TypeVar("S", Health, DeviceInfo)
WAKE_WAIT = 2.0  # [s] for the RVR to wake up
UNKNOWN = "not known"
"""Word for a fact that a device does not report."""
_NOTIFICATIONS = ("battery_voltage_state_change", "motor_fault", "motor_stall", "motor_thermal_protection_status")
DRIVE = "drive_tank_si_units"
"""The command that drives."""
_STOPPED = "robot_has_stopped"
_TANK, _BRAKING = 2, 0  # controllers of the drive
BATTERY_QUERIES = ("get_battery_voltage_state", "get_battery_percentage")
MOTOR_QUERIES = ("get_motor_thermal_protection_status", "get_motor_fault_state")


class RvrIdentity(NamedTuple):
    """Firmware and battery of an RVR; what it refuses to tell is missing."""

    firmware: Mapping[Processor, tuple[int, int, int]]  # major and minor number and revision
    battery: int | None  # [%] of charge
    battery_state: int  # 0 unknown, 1 good, 2 low, 3 critical
    refused: Mapping[str, str]  # why it does not tell about the battery, by question

    def words(self) -> dict[str, str]:
        """The same for people, by name."""
        versions = {
            firmware_name(of): ".".join(map(str, self.firmware[of])) if of in self.firmware else UNKNOWN
            for of in Processor
        }
        return versions | {"battery": UNKNOWN if self.battery is None else charge(self.battery)}


class LidarIdentity(NamedTuple):
    """Identity and health of a lidar."""

    info: DeviceInfo | None  # None if there was no answer, or no two answers were the same
    health: Health | None  # None if there was no answer
    has_answered: bool = True  # whether there was an answer to `device_info`
    is_one_way: bool = False  # whether it sends packets unasked, and answers nothing

    @property
    def warning(self) -> int | None:
        """The code of its warning; None if there is none."""
        return self.health.error_code if self.health is not None and self.health.status else None

    def words(self) -> dict[str, str]:
        """The same for people, by name."""
        info = self.info
        if info is not None:
            model = f"model {info.model}, firmware {info.firmware[0]}.{info.firmware[1]}, serial {info.serial}"
        elif self.has_answered:
            model = "model and firmware are not certain: all answers differ"
        else:
            model = "model and firmware are not known: no answer"
        facts = {"lidar": model}
        if self.health is None:
            facts["lidar_health"] = "not known: no answer"
        elif self.warning is not None:
            facts["lidar_health"] = f"a warning, {self.warning:#x}"
        return facts

    def doubts(self) -> dict[str, str]:
        """Unusual facts that do not prevent a run, by names of `words`."""
        if self.is_one_way:
            return {
                "lidar": "it sends unasked and answers nothing: is it a one-way model, or is the wire to its RX loose? "
                "It cannot be asked for its health"
            }
        found = {}
        if self.info is None and not self.has_answered:
            found["lidar"] = "it does not answer which model it is: is it an X4?"
        elif self.info is not None and self.info.model != MODEL:
            found["lidar"] = (
                f"it is model {self.info.model}, not an X4 (model {MODEL}): its angles, ranges and rate may differ"
            )
        if self.health is None:
            found["lidar_health"] = "it does not answer how it is; an X4 does"
        return found


def firmware_name(processor: Processor) -> str:
    """The name of a processor's firmware among facts."""
    return f"firmware_{processor.name.lower()}"


def wake_rvr(link: Link) -> RvrIdentity:
    """End what an earlier program has started, and wake the RVR; return its firmware and battery.

    Raises:
        RobotError: if it does not answer.
    """
    link.send_command("disable_notifications_and_active_commands")
    end_streaming(link)
    with contextlib.suppress(RobotError):  # the next question is asked anyway, and says what is wrong
        link.ask("wake")  # repeated until it is answered, as an RVR that sleeps refuses the rest
    link.wait_for(Notification, lambda notification: notification.name == "did_wake", WAKE_WAIT)
    firmware = {}
    for processor in Processor:
        version = link.request("get_main_application_version", processor).values  # both must answer, or refuse
        if version:
            firmware[processor] = version["major"], version["minor"], version["revision"]
    told = {question: link.attempt(question) for question in BATTERY_QUERIES}
    battery = {name: value for values, _ in told.values() for name, value in values.items()}
    refused = {question: why for question, (_, why) in told.items() if why}
    return RvrIdentity(firmware, battery.get("percentage"), battery.get("state", 0), refused)


def secure_rvr(link: Link, timeout: float) -> None:
    """Check that the RVR stops when it is told to, and let its commands end after a time [s].

    Raises:
        RobotError: if it refuses; then it must not drive.
    """
    link.ask("drive_stop")
    link.ask("set_custom_control_system_timeout", command_timeout=round(1000 * timeout))


def commands_end(
    link: Link, settings: Settings, drive: Callable[[], None], attend: Callable[[float], Iterable[Heard]]
) -> bool:
    """Whether a drive command is seen to end by itself after the time that was set.

    The maker's documents do not say what the RVR answers then: only an answer that it still drives is an error.

    Args:
        link: The link to the RVR.
        settings: The robot's settings.
        drive: Sends a drive command of speed zero.
        attend: Reads the devices until a time [s], and returns their events.

    Raises:
        RobotError: if the RVR reports that it still drives, and the settings do not permit that.
    """
    timeout = settings.rvr.timeout
    drive()
    sent = time.monotonic()
    first = _controller(link)
    attend(sent + 0.5 * timeout)  # a stop until then is due to the speed of zero
    heard = attend(sent + timeout + 0.1)
    has_stopped = any(isinstance(event, Notification) and event.name == _STOPPED for event, _ in heard)
    last = _controller(link)
    if has_stopped or (first, last) == (_TANK, _BRAKING):
        return True
    if settings.limits.unending_commands or not first == last == _TANK:
        return False
    attend(sent + 2.0 * timeout)  # this computer, or the line, may have been late
    if _controller(link) == _TANK:
        raise RobotError(
            f"rvr: it reports that a drive command does not end after {timeout:g} s, so it would drive on if "
            "this program died; update its firmware, or permit this with limits.unending_commands in robot.yaml"
        )
    return False


def _controller(link: Link) -> int | None:
    """The active controller of the RVR's drive; None if it does not tell."""
    told, _ = link.attempt("get_active_control_system_id")
    return told.get("controller_id")


def watch_rvr(link: Link) -> dict[str, str]:
    """Let the RVR report on its battery and motors, and ask after them; return why it refuses, by command."""
    whys = {f"enable_{name}_notify": link.refusal(f"enable_{name}_notify", is_enabled=True) for name in _NOTIFICATIONS}
    whys |= {name: link.refusal(name) for name in MOTOR_QUERIES}
    return {name: why for name, why in whys.items() if why}


def halt(link: Link) -> bytes:
    """The commands that stop the wheels."""
    return link.encode("drive_tank_si_units", left_velocity=0.0, right_velocity=0.0) + link.encode("drive_stop")


def stop_rvr(link: Link) -> None:
    """Return the RVR to its usual state: wheels and lamps off, no streaming, the usual timeout of commands.

    Raises:
        RobotError: if it does not answer, or refuses to stop.
    """
    end_streaming(link)
    link.send_command("enable_color_detection", is_enabled=False)
    link.send_command("release_led_requests")
    link.ask("drive_stop")  # the next command makes drive commands last longer, so this one must be answered
    link.send_command("restore_default_control_system_timeout")
    link.send_command("disable_notifications_and_active_commands")


def start_lidar(link: Link) -> LidarIdentity:
    """Start the lidar's motor and its scan; return its identity and health, which a run does not need.

    Raises:
        RobotError: if it neither answers nor scans, has an error, or its answers about its health differ.
    """
    stop_lidar(link)
    link.lines["lidar"].set_dtr(high=True)
    health, has_answered = _agreed(link, "health", Health)
    if health is None and has_answered:
        raise RobotError(f"its answers about its health differ; {link.damage_remedy('lidar')}", device="lidar")
    if health is not None and health.status == _ERROR:
        code = f"{health.error_code:#x}"
        raise RobotError(f"it reports an error, {code}; take its power away for a moment", device="lidar")
    if not has_answered and link.wait_for(Packet, lambda _: True, ANSWER_WAIT) is not None:
        return LidarIdentity(None, None, has_answered=False, is_one_way=True)
    info, has_answered = _agreed(link, "device_info", DeviceInfo)
    link.exchange("lidar", partial(_behind_stop, "scan"), (ScanStarted, Packet))
    return LidarIdentity(info, health, has_answered)


def _agreed(link: Link, command: str, kind: type[S]) -> tuple[S | None, bool]:
    """The lidar's answer to a command, given twice, as answers have no checksum; and whether there was any.

    None if all answers differ, or there is none.
    """
    answers: list[S] = []
    for _ in range(_TRIES):
        try:
            said = link.exchange("lidar", partial(_behind_stop, command), kind)
        except RobotStopped:
            raise
        except RobotError:
            break
        if said in answers:
            return said, True
        answers.append(said)
    return None, bool(answers)


def _behind_stop(command: str) -> bytes:
    """A command to the lidar behind a stop: while it scans, as a stop before may be lost, it obeys only a stop."""
    return _STOP + encode_command(command)


def stop_lidar(link: Link) -> None:
    """Stop the lidar's scan and motor."""
    link.send("lidar", _STOP)
    link.lines["lidar"].set_dtr(high=False)


def start_hub(link: Link) -> str:
    """Start the hub's output of the distances of all sensors; return what is unusual, if it sends them nevertheless.

    Raises:
        RobotError: if it does not answer, or refuses, and sends no distances.
    """
    doubt = ""
    for command in (multiflex.BINARY_MODE, multiflex.use_sensors(0xFF)):
        acknowledges = partial(lambda code, event: event.code == code, command.code)
        try:
            if link.exchange("proximity", command.encode, Acknowledgement, acknowledges).ok:
                continue
            doubt = f"it refuses command {command.code:#04x} as bad: is its firmware too old? Update it"
            failure = RobotError(doubt, device="proximity")
        except RobotStopped:
            raise
        except RobotError as error:
            doubt = f"it does not acknowledge command {command.code:#04x}: is its firmware too old?"
            failure = error
        if link.wait_for(Distances, lambda _: True, _DISTANCES_WAIT) is None:
            raise failure
    return doubt
