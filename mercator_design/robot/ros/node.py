"""A node of ROS 1 in the place of those that drove Mercator: publishes what the robot senses, obeys two topics."""

import http.client
import importlib
import math
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from mercator_design.config.colours import COLOURS, Levels
from mercator_design.errors import RobotError
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.sweep import Sweep
from mercator_design.robot.protocols.rvr_messages import LIGHTS
from mercator_design.robot.protocols.ydlidar import Packet
from mercator_design.robot.ros import messages
from mercator_design.robot.ros.messages import LEDS, MADE_HERE, OBEYED, PUBLISHED, WHEELS, Fields
from mercator_design.robot.run.control import in_control
from mercator_design.robot.run.mercator import PERIOD
from mercator_design.robot.run.safety import Brake, raise_priority
from mercator_design.robot.run.senses import Senses

NAME = "mercator_robot"
"""Of the node."""

_SENSES = ("ground", "neighbours", "proximity")
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
"""Which lamps each colour of an rvr_ros/Leds is for."""
_OF_RVR = {"ground", "ambient_light", "attitude", "turning", "acceleration", "orientation", "position", "velocity"}
"""Samples."""
_MASTER_LOOK = 0.5  # [s] between looks after the master
_MASTER_ANSWER = 2.0  # [s] that it may take to answer
_REGISTER = 5.0  # [s] that ROS's client may take to tell the master of us, ...
_LEAVE = 2.0  # ... and that we are gone; it would try for ever


class RosNode:
    """This program as a node of ROS."""

    def __init__(self) -> None:
        """Become one, by the names and remappings in sys.argv.

        Raises:
            RobotError: if ROS's client for Python is not there, or no master is.
        """
        raise_priority(1)  # its threads too: one that waits for a processor may have the interpreter's lock
        try:
            self._rospy, self._message, self._dynamic = map(_module, ("rospy", "genpy.message", "genpy.dynamic"))
            self.types = {name: self._type(name) for name in {*OBEYED.values(), *(t.type for t in PUBLISHED.values())}}
        except ImportError as error:
            raise RobotError(_ABSENT.format(error)) from None
        try:
            self._master: str = _module("rosgraph").get_master_uri()
            self._reach_master()
            self._publishers: dict[str, Any] = {}
            self._register(self._begin)
        except (self._rospy.ROSException, ValueError) as error:
            raise RobotError(f"ros: {error}") from None
        self.name = str(self._rospy.get_name())
        self.namespace = str(self._rospy.get_namespace()).strip("/").replace("/", "_")

    def close(self) -> None:
        """Be a node no more; a master that does not answer is not waited for."""
        leaving = threading.Thread(target=self._rospy.signal_shutdown, args=("it has ended",), daemon=True)
        leaving.start()
        leaving.join(_LEAVE)

    def publish(self, topic: str, fields: Fields) -> None:
        """Send a message."""
        message = self.types[PUBLISHED[topic].type]()
        self._message.fill_message_args(message, [fields])
        self._publishers[topic].publish(message)

    def obey(self, brake: Brake, orders: "Orders") -> None:
        """Take orders, in threads of their own, from now on; pull the brake if this is a node no more.

        Raises:
            RobotError: if the master has gone.
        """
        self._reach_master()
        self._rospy.on_shutdown(lambda: brake.stop("ros: the node was told to shut down"))
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
        return getattr(_module(f"{package}.msg"), kind)

    def _begin(self) -> None:
        self._rospy.init_node(NAME, disable_signals=True)
        for name, topic in PUBLISHED.items():
            self._publishers[name] = self._rospy.Publisher(
                name, self.types[topic.type], queue_size=topic.queue, latch=topic.latched
            )

    def _register(self, register: Callable[[], None]) -> None:
        """Let ROS's client send something to the master; in a thread, as it would try for ever.

        Raises:
            RobotError: if that takes too long.
            Exception: whatever the client raises.
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
            thread.join(_REGISTER)
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
        except (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError) as error:
            raise RobotError(f"ros: no master at {self._master}: {error}; does roscore run there?") from None

    def _watch_master(self, brake: Brake) -> None:
        """A node is not told that its master has gone."""
        while not brake.why:
            try:
                self._reach_master()
            except RobotError as error:
                brake.stop(str(error))
            time.sleep(_MASTER_LOOK)


class _Impatient(xmlrpc.client.Transport):
    """One that does not wait for ever."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:  # noqa: ANN401 - as the base has it
        connection = super().make_connection(host)
        connection.timeout = _MASTER_ANSWER
        return connection


def _module(name: str) -> Any:  # noqa: ANN401 - ROS's have no types
    """What a robot need not have."""
    return importlib.import_module(name)


class Orders:
    """What others want, as their messages come, in threads of ROS; the control loop looks it up."""

    def __init__(self, brake: Brake, silence: float, report: Callable[[str], None]) -> None:
        """Begin at rest.

        Args:
            brake: Pulled by what cannot be obeyed.
            silence: How long [s] speeds last.
            report: Called with what is ignored.
        """
        self._brake, self._silence, self._report = brake, silence, report
        self._speeds = (-math.inf, 0.0, 0.0)
        self._ignored = ""
        self.colours: dict[str, Levels] = dict.fromkeys(LIGHTS, (0, 0, 0))

    def take_speeds(self, message: Any) -> None:  # noqa: ANN401 - of any type with these fields
        """Take a Float32MultiArray: the speeds of the left and right tread [m/s].

        Of messages that follow each other, the first is not obeyed: a topic that is latched has it from any time ago.
        """
        now = time.monotonic()
        speeds = [round(speed, 6) for speed in message.data]  # 0.3, not 0.30000001192: it has single precision
        if len(speeds) != 2:
            self._brake.stop(f"{WHEELS}: expected 2 speeds, found {len(speeds)}")
            return
        self._brake.check(*speeds)
        left, right = speeds if now - self._speeds[0] <= self._silence else (0.0, 0.0)
        self._speeds = now, left, right

    def take_colours(self, message: Any) -> None:  # noqa: ANN401
        """Take a Leds: five colours, of 0 to 255."""
        colours: dict[str, Levels] = {}
        for lights, colour in zip(_LIGHTS_OF, message.led_colors, strict=True):
            found = colour.r, colour.g, colour.b
            if not all(0.0 <= level <= 255.0 for level in found):
                self._ignore(f"{LEDS}: expected levels from 0 to 255, found {found}; ignored")
                return
            red, green, blue = map(int, found)
            colours |= dict.fromkeys(lights, (red, green, blue))
        self.colours = dict.fromkeys(LIGHTS, (0, 0, 0)) | colours

    def speeds(self, now: float) -> tuple[float, float]:
        """Those that are wanted at a time [s]; zero if the last message is too old."""
        came, left, right = self._speeds
        return (left, right) if now - came <= self._silence else (0.0, 0.0)

    def _ignore(self, why: str) -> None:
        if why != self._ignored:
            self._ignored = why
            self._report(why)


class Reports:
    """What is to be published: of the RVR at a rate, of the lidar each turn, of the hub each measurement."""

    def __init__(self, senses: Senses, sweep: Sweep, namespace: str, rate: float) -> None:
        """Begin; `rate` is the RVR's [Hz], and `namespace` that of the node, without slashes."""
        self._senses, self._sweep, self._namespace, self._period = senses, sweep, namespace, 1.0 / rate
        self._due = self._turned = self._measured = -math.inf

    def due(self, now: float, ros_now: float) -> Iterator[tuple[str, Fields]]:
        """Topics and messages that are due at a time [s], for which ROS has another number."""
        samples, later = self._senses.samples, ros_now - now
        if now >= self._due and samples.keys() >= _OF_RVR:
            self._due = max(self._due + self._period, now)
            light = samples["ambient_light"]
            red, green, blue = samples["ground"].values
            yield "rvr/ground_color", messages.colour((red, green, blue))
            yield "rvr/fixed_color", messages.colour(COLOURS[self._senses.label()])
            yield "rvr/ambient_light", messages.illuminance(later + light.time, light)
            yield "rvr/imu", messages.imu(later + samples["attitude"].time, samples)
            yield "rvr/odom", messages.odometry(later + samples["position"].time, samples)
        before, self._turned = self._turned, samples["lidar"].time
        if self._sweep.is_whole and math.isfinite(before) and before < self._turned:
            yield "scan", messages.scan(later + before, self._sweep.ranges(), self._turned - before)
        before, self._measured = self._measured, samples["proximity"].time
        if before < self._measured:
            distances = samples["proximity"].values
            yield "ranges", messages.range_array(later + self._measured, distances, self._namespace)


def serve(settings: Settings, node: RosNode, rate: float, silence: float, report: Callable[[str], None]) -> None:
    """Be the robot's node, until something stops the wheels.

    Args:
        settings: The robot.
        node: What it is in ROS.
        rate: At which the RVR's senses are published [Hz].
        silence: After which the wheels are at rest [s].
        report: Called with messages for people.

    Raises:
        Stopped: if something stopped the wheels, with what it was.
        RobotError: if a device cannot be used.
        Signalled: if a signal came.
    """
    with in_control(settings, _SENSES, settings.labels_of({}), None) as control:
        robot = control.robot
        robot.introduce(report)
        sweep = Sweep(settings.lidar_angle)  # as the robot saw it, wherever it turned
        orders, reports = Orders(robot.brake, silence, report), Reports(robot.senses, sweep, node.namespace, rate)
        robot.notes.send_to(report)
        node.obey(robot.brake, orders)
        report(f"{node.name} runs; the wheels turn from the second message on {WHEELS} on")
        control.arm()
        for now in control.cycles(PERIOD):
            for event, _ in control.heard:
                if isinstance(event, Packet):
                    sweep.add(event)
            robot.check_ages()
            robot.brake.drive(*orders.speeds(now))
            robot.query()
            robot.show(orders.colours)
            for topic, fields in reports.due(now, node.now()):
                node.publish(topic, fields)
