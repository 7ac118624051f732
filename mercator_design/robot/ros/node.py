"""A node of ROS 1 that replaces those that drove Mercator: it publishes the robot's senses and obeys two topics."""

import http.client
import importlib
import math
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

from mercator_design.config.colours import COLOURS, Levels
from mercator_design.errors import RobotError
from mercator_design.robot.devices.samples import SERVICE_OF, Sample
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.sweep import Sweep
from mercator_design.robot.protocols.rvr_messages import LIGHTS
from mercator_design.robot.protocols.ydlidar import Packet
from mercator_design.robot.ros import messages
from mercator_design.robot.ros.messages import LEDS, MADE_HERE, OBEYED, PUBLISHED, WHEELS, Fields
from mercator_design.robot.run.control import in_control
from mercator_design.robot.run.safety import Brake, raise_priority
from mercator_design.robot.run.senses import DEVICE_OF, Senses

NAME = "mercator_robot"
"""Name of the node."""

_ABSENT = (
    "ros: {}; on Debian and Ubuntu: apt install python3-rospy python3-sensor-msgs python3-nav-msgs, and run this with "
    "the system's Python: /usr/bin/python3 mercator-robot.pyz ros"
)
_LIGHTS_OF = (
    ("headlight_left",),
    ("headlight_right",),
    ("battery_door_front", "battery_door_rear"),  # on the left side
    ("power_button_front", "power_button_rear"),  # on the right side
    ("brakelight_left", "brakelight_right"),
)
"""The lamps of each colour in an rvr_ros/Leds."""
_PERIOD = 0.05  # [s] of its cycles
_MASTER_CHECK_EVERY = 0.5  # [s]
MASTER_WAIT = 2.0  # [s] for the master's answer
REGISTER_WAIT = 5.0  # [s] for registering at the master; ROS's client would try without end
LEAVE_WAIT = 2.0  # [s] for unregistering


class RosNode:
    """This program as a node of ROS."""

    def __init__(self) -> None:
        """Register the node, with the names and remappings in sys.argv.

        Raises:
            RobotError: if ROS's client for Python is not installed, or there is no master.
        """
        raise_priority(1)  # for its threads, too: a waiting one may hold the interpreter's lock
        try:
            self._rospy, self._message, self._dynamic = map(load_module, ("rospy", "genpy.message", "genpy.dynamic"))
            self.types = {name: self._type(name) for name in {*OBEYED.values(), *(t.type for t in PUBLISHED.values())}}
        except ImportError as error:
            raise RobotError(_ABSENT.format(error)) from None
        try:
            self._master: str = load_module("rosgraph").get_master_uri()
            self._reach_master()
            self._publishers: dict[str, Any] = {}
            self._register(self._begin)
        except (self._rospy.ROSException, ValueError) as error:
            raise RobotError(f"ros: {error}") from None
        self.name = str(self._rospy.get_name())
        self.namespace = str(self._rospy.get_namespace()).strip("/").replace("/", "_")

    def close(self) -> None:
        """Unregister the node, without waiting for a master that does not answer."""
        leaving = threading.Thread(target=self._rospy.signal_shutdown, args=("it has ended",), daemon=True)
        leaving.start()
        leaving.join(LEAVE_WAIT)

    def publish(self, topic: str, fields: Fields) -> None:
        message = self.types[PUBLISHED[topic].type]()
        self._message.fill_message_args(message, [fields])
        self._publishers[topic].publish(message)

    def obey(self, brake: Brake, orders: "Orders") -> None:
        """Subscribe to orders, which come in threads of their own; pull the brake if the node or the master ends.

        Raises:
            RobotError: if there is no master any more.
        """
        self._reach_master()
        self._rospy.on_shutdown(lambda: brake.stop("ros: the node was shut down"))
        threading.Thread(target=self._watch_master, args=(brake,), daemon=True).start()

        def subscribe() -> None:
            for topic, take in ((WHEELS, orders.take_speeds), (LEDS, orders.take_colours)):
                self._rospy.Subscriber(topic, self.types[OBEYED[topic]], take, queue_size=10)

        self._register(subscribe)

    def now(self) -> float:
        """The time of ROS [s]."""
        return float(self._rospy.get_time())

    def _type(self, name: str) -> Any:  # noqa: ANN401 - a class of messages
        if name in MADE_HERE:
            definition, part = MADE_HERE[name]
            parts = f"\n{80 * '='}\nMSG: {part}\n{self._type(part)._full_text}"  # noqa: SLF001 - no other name for it
            return self._dynamic.generate_dynamic(name, definition + parts)[name]
        package, _, kind = name.partition("/")
        return getattr(load_module(f"{package}.msg"), kind)

    def _begin(self) -> None:
        self._rospy.init_node(NAME, disable_signals=True)
        for name, topic in PUBLISHED.items():
            self._publishers[name] = self._rospy.Publisher(
                name, self.types[topic.type], queue_size=topic.queue, latch=topic.latched
            )

    def _register(self, register: Callable[[], None]) -> None:
        """Let ROS's client register something at the master, in a thread, as it would try without end.

        Raises:
            RobotError: if that takes too long.
            Exception: any error of the client.
        """
        ended: list[Exception | None] = []

        def attempt() -> None:
            try:
                register()
                ended.append(None)
            except Exception as error:  # noqa: BLE001 - raised again below
                ended.append(error)

        thread = threading.Thread(target=attempt, daemon=True)
        thread.start()
        try:
            thread.join(REGISTER_WAIT)
        finally:
            if not ended:
                self.close()
        if not ended:
            raise RobotError(f"ros: the master at {self._master} does not answer any more; does roscore run there?")
        if ended[0] is not None:
            raise ended[0]

    def _reach_master(self) -> None:
        if urlsplit(self._master).hostname is None:
            raise RobotError(f"ros: ROS_MASTER_URI: expected http://HOST:PORT/, found {self._master}")
        try:
            with xmlrpc.client.ServerProxy(self._master, _Impatient()) as master:
                master.getPid(f"/{NAME}")
        except Exception as error:  # noqa: BLE001 - what answers may be any program
            raise RobotError(f"ros: no master at {self._master}: {error}; does roscore run there?") from None

    def _watch_master(self, brake: Brake) -> None:
        """Pull the brake if the master does not answer; ROS does not report this to nodes."""
        while not brake.why:
            try:
                self._reach_master()
            except RobotError as error:
                brake.stop(str(error))
            time.sleep(_MASTER_CHECK_EVERY)


class _Impatient(xmlrpc.client.Transport):
    """A transport with a time limit."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:  # noqa: ANN401 - as in the base class
        connection = super().make_connection(host)
        connection.timeout = MASTER_WAIT
        return connection


def load_module(name: str) -> Any:  # noqa: ANN401 - ROS's have no types
    """Import a module of ROS, which a robot need not have."""
    return importlib.import_module(name)


class Orders:
    """The latest orders of other nodes: ROS's threads set them, the control loop reads them."""

    def __init__(self, brake: Brake, silence: float, report: Callable[[str], None]) -> None:
        """Make orders of zero speed.

        Args:
            brake: The brake; invalid speeds pull it.
            silence: Time for which speeds are valid [s].
            report: Called with messages on ignored orders.
        """
        self._brake, self._silence, self._report = brake, silence, report
        self._speeds = (-math.inf, 0.0, 0.0)
        self._ignored = ""
        self.colours: dict[str, Levels] = dict.fromkeys(LIGHTS, (0, 0, 0))

    def take_speeds(self, message: Any) -> None:  # noqa: ANN401 - any type with these fields
        """Take a Float32MultiArray: the speeds of the left and right tread [m/s].

        The first message after a silence is not obeyed: on a latched topic it may be old.
        """
        now = time.monotonic()
        speeds = [round(speed, 6) for speed in message.data]  # 0.3, not 0.30000001192: they have single precision
        if len(speeds) != 2:
            self._brake.stop(f"{WHEELS}: expected 2 speeds, found {len(speeds)}")
            return
        self._brake.check(*speeds)
        left, right = speeds if now - self._speeds[0] <= self._silence else (0.0, 0.0)
        self._speeds = now, left, right

    def take_colours(self, message: Any) -> None:  # noqa: ANN401
        """Take a Leds: five colours with levels from 0 to 255."""
        colours: dict[str, Levels] = {}
        for lights, colour in zip(_LIGHTS_OF, message.led_colors, strict=True):
            found = colour.r, colour.g, colour.b
            if not all(0.0 <= level <= 255.0 for level in found):
                ignored = f"{LEDS}: expected levels from 0 to 255, found {found}; ignored"
                if ignored != self._ignored:
                    self._ignored = ignored
                    self._report(ignored)
                return
            red, green, blue = map(int, found)
            colours |= dict.fromkeys(lights, (red, green, blue))
        self.colours = dict.fromkeys(LIGHTS, (0, 0, 0)) | colours

    def speeds(self, now: float) -> tuple[float, float]:
        """The ordered speeds at a time [s]; zero if the last message is too old."""
        came, left, right = self._speeds
        return (left, right) if now - came <= self._silence else (0.0, 0.0)


class Reports:
    """The messages to publish: of the RVR at a rate, of the lidar each turn, of the hub each measurement."""

    def __init__(self, senses: Senses, sweep: Sweep, namespace: str, rate: float) -> None:
        """Make reports; `rate` is the RVR's [Hz], and `namespace` the node's, without slashes."""
        self._senses, self._sweep, self._namespace, self._period = senses, sweep, namespace, 1.0 / rate
        self._due = self._turned = self._measured = -math.inf

    def due(self, now: float, ros_now: float) -> Iterator[tuple[str, Fields]]:
        """Topics and messages that are due at a time [s], which is `ros_now` by ROS's clock."""
        samples, later = self._senses.samples, ros_now - now
        if now >= self._due and "attitude" in samples:
            self._due = max(self._due + self._period, now)
            yield from self._of_rvr(samples, later)
        before, self._turned = self._turned, samples["lidar"].time
        if self._sweep.is_whole and math.isfinite(before) and before < self._turned:
            yield "scan", messages.scan(later + before, self._sweep.ranges(), self._turned - before)
        before, self._measured = self._measured, samples["proximity"].time
        if before < self._measured:
            distances = samples["proximity"].values
            yield "ranges", messages.range_array(later + self._measured, distances, self._namespace)

    def _of_rvr(self, samples: Mapping[str, Sample], later: float) -> Iterator[tuple[str, Fields]]:
        """The messages of the RVR's sensors; one of a sensor that it does not stream is left out."""
        if "ground" in samples:
            red, green, blue = samples["ground"].values
            yield "rvr/ground_color", messages.colour((red, green, blue))
            yield "rvr/fixed_color", messages.colour(COLOURS[self._senses.label()])
        if "ambient_light" in samples:
            light = samples["ambient_light"]
            yield "rvr/ambient_light", messages.illuminance(later + light.time, light)
        if samples.keys() >= messages.IMU:
            yield "rvr/imu", messages.imu(later + samples["attitude"].time, samples)
        if samples.keys() >= messages.ODOMETRY:
            yield "rvr/odom", messages.odometry(later + samples["position"].time, samples)


def serve(settings: Settings, node: RosNode, rate: float, silence: float, report: Callable[[str], None]) -> None:
    """Publish the robot's senses and obey orders, until something stops the wheels.

    Args:
        settings: The robot's settings.
        node: The robot's node.
        rate: Rate at which the RVR's senses are published [Hz].
        silence: Time without orders after which the wheels are at rest [s].
        report: Called with messages for people.

    Raises:
        RobotError, RobotStopped, Signalled: as `in_control`.
    """
    with in_control(settings, DEVICE_OF, settings.labels_of({}), None, extra=SERVICE_OF) as control:
        robot = control.robot
        robot.introduce(report)
        sweep = Sweep(settings.lidar_angle, settings.lidar.blind)  # in the robot's frame
        orders, reports = Orders(robot.brake, silence, report), Reports(robot.senses, sweep, node.namespace, rate)
        robot.notes.send_to(report)
        node.obey(robot.brake, orders)
        report(f"{node.name} runs; the wheels turn from the second message on {WHEELS}")
        control.arm()
        for now in control.cycles(_PERIOD):
            for event, _ in control.heard:
                if isinstance(event, Packet):
                    sweep.add(event)
            robot.check_ages()
            robot.brake.drive(*orders.speeds(now))
            robot.query()
            robot.show(orders.colours)
            for topic, fields in reports.due(now, node.now()):
                node.publish(topic, fields)
