"""How soon wheels come to rest, whatever drove them, and runs that go on as long as they should.

Time that this machine takes to get to a process when it has much else to do is not the program's, so of three attempts
the best counts.
"""

import itertools
import socket

LATEST = 0.25
"""[s] from a fault to wheels at rest."""
ATTEMPTS = 3
OFTEN = "from mercator_design.robot import mercator; mercator._POLL = 0.5\n"
"""Lets a program ask after the battery more often."""


def in_time(attempt):
    """Make an attempt, and again if a control loop stalled, as its assertions say then."""
    for number in range(ATTEMPTS):
        try:
            return attempt(number)
        except AssertionError as error:
            if "the control loop stalled" not in str(error) or number == ATTEMPTS - 1:
                raise
    return None


def soonest(attempt, most=LATEST):
    """The least of what an attempt takes, made again if it takes too long."""
    times, numbers = [], itertools.count()
    while len(times) < ATTEMPTS and (not times or min(times) > most):
        times.append(in_time(lambda _: attempt(next(numbers))))
    return min(times)


def asked(devices):
    """How often the robot was asked after its battery."""
    return [name for _, name, _ in devices.commands].count("get_battery_percentage")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]
