"""What other nodes of ROS do with a robot's: run by a Python that has rospy, by tests.

    ros_client.py listen SECONDS        prints as JSON what comes: type and md5sum of each topic, its messages and times
    ros_client.py drive LEFT RIGHT HZ   publishes speeds until it is ended
    ros_client.py say VALUE...          publishes values on /rvr/wheels_speed, once; prints when [s]
    ros_client.py lamps                 prints the md5sum of their type, and publishes five colours until it is ended

Types are made of what the connection says of them, so that nothing here knows the robot's.
"""

import contextlib
import json
import sys
import time

with contextlib.suppress(ImportError):  # tests import the constants
    import rospy
    from genpy.dynamic import generate_dynamic
    from genpy.message import fill_message_args
    from rospy.msg import AnyMsg
    from std_msgs.msg import ColorRGBA, Float32MultiArray

TOPICS = (
    *("/rvr/ground_color", "/rvr/fixed_color", "/rvr/ambient_light", "/rvr/imu", "/rvr/odom"),
    *("/scan", "/ranges"),
)
COLOURS = [[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12], [13, 14, 15]]


def listen(seconds):
    heard = {topic: {"messages": []} for topic in TOPICS}
    classes = {}

    def take(message, topic):
        header = message._connection_header
        if topic not in classes:
            heard[topic] |= {name: header[name] for name in ("type", "md5sum", "latching", "callerid")}
            classes[topic] = generate_dynamic(header["type"], header["message_definition"])[header["type"]]
        heard[topic]["messages"].append([time.monotonic(), plain(classes[topic]().deserialize(message._buff))])

    for topic in TOPICS:
        rospy.Subscriber(topic, AnyMsg, take, topic)
    rospy.sleep(float(seconds))
    json.dump(heard, sys.stdout)


def plain(value):
    """A message as JSON has it; times in seconds."""
    if hasattr(value, "to_sec"):
        return value.to_sec()
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def drive(left, right, rate):
    publisher = rospy.Publisher("/rvr/wheels_speed", Float32MultiArray, queue_size=10, latch=True)
    while not rospy.is_shutdown():
        publisher.publish(data=[float(left), float(right)])
        time.sleep(1.0 / float(rate))


def say(*values):
    publisher = rospy.Publisher("/rvr/wheels_speed", Float32MultiArray, queue_size=10)
    while publisher.get_num_connections() == 0:
        time.sleep(0.01)
    when = time.monotonic()
    publisher.publish(data=[float(value) for value in values])
    sys.stdout.write(f"{when}\n")
    time.sleep(0.5)


def lamps():
    dependency = f"\n{80 * '='}\nMSG: std_msgs/ColorRGBA\n{ColorRGBA._full_text}"
    kind = generate_dynamic("rvr_ros/Leds", f"std_msgs/ColorRGBA[5] led_colors{dependency}")["rvr_ros/Leds"]
    publisher = rospy.Publisher("/rvr/rgb_leds", kind, queue_size=10)
    sys.stdout.write(f"{kind._md5sum}\n")
    sys.stdout.flush()
    message = kind()
    fill_message_args(message, [{"led_colors": [dict(zip("rgb", colour, strict=True), a=255) for colour in COLOURS]}])
    while not rospy.is_shutdown():
        publisher.publish(message)
        time.sleep(0.1)


if __name__ == "__main__":
    _, what, *arguments = sys.argv
    rospy.init_node("client", anonymous=True)
    {"listen": listen, "drive": drive, "say": say, "lamps": lamps}[what](*arguments)
