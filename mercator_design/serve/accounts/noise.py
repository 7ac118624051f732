"""Lines of unknown senders in the audit log: an address gets few, so nobody fills the log without a login."""

from collections import OrderedDict
from collections.abc import Callable

from mercator_design.serve.accounts.entrance import network_of

MAX_LINES = 10
"""Lines of an address at once."""
PERIOD = 6.0
"""Seconds after which it gets one more."""
MAX_ADDRESSES = 10_000  # that are remembered


class AuditNoise:
    """Counts the lines of addresses.

    Args:
        clock: Seconds that have passed since some time.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._found: OrderedDict[str, tuple[float, float]] = OrderedDict()  # lines that count, as of a time

    def is_too_much(self, address: str) -> bool:
        """Whether an address has had its lines; if not, this is one more."""
        network, now = network_of(address), self._clock()
        lines, since = self._found.get(network, (0.0, 0.0))
        lines = max(0.0, lines - (now - since) / PERIOD)
        if lines > MAX_LINES - 1:
            return True
        self._found[network] = lines + 1, now
        self._found.move_to_end(network)
        while len(self._found) > MAX_ADDRESSES:
            self._found.popitem(last=False)
        return False
