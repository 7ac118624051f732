"""Failed attempts to log in: an address with too many has to wait."""

import ipaddress
import threading
from collections import OrderedDict
from collections.abc import Callable

MAX_FAILURES = 10
"""Failures of an address at once."""
PERIOD = 6.0
"""Seconds after which one failure is forgotten."""
MAX_ADDRESSES = 10_000  # that are remembered


class Attempts:
    """Counts failures of addresses; safe for several threads."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._found: OrderedDict[str, tuple[float, float]] = OrderedDict()  # failures that count, as of a time
        self._lock = threading.Lock()

    def wait(self, address: str) -> float:
        """Seconds that an address has to wait; 0 if it may try now."""
        with self._lock:
            return max(0.0, self._level(_network(address)) - MAX_FAILURES + 1) * PERIOD

    def count(self, address: str) -> None:
        """Count an attempt as failed; `forgive` takes it back."""
        self._change(address, 1.0)

    def forgive(self, address: str) -> None:
        """Take an attempt back, which was successful."""
        self._change(address, -1.0)

    def _change(self, address: str, change: float) -> None:
        network = _network(address)
        with self._lock:
            self._found[network] = max(0.0, self._level(network) + change), self._clock()
            self._found.move_to_end(network)
            while len(self._found) > MAX_ADDRESSES:
                self._found.popitem(last=False)

    def _level(self, network: str) -> float:
        level, since = self._found.get(network, (0.0, 0.0))
        return max(0.0, level - (self._clock() - since) / PERIOD)


def _network(address: str) -> str:
    """Who can choose among many addresses: the 64 bits in front of an address of IPv6."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    return str(found.ipv4_mapped or ipaddress.ip_network((int(found) >> 64 << 64, 64)))
