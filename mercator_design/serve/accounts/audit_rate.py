"""Limit of the audit log's lines on unknown senders, so that nobody fills the log without a login."""

from collections import OrderedDict
from collections.abc import Callable

from mercator_design.serve.accounts.endpoint import network_of

MAX_LINES = 10
"""Maximum number of lines of an address at once."""
PERIOD = 6.0
"""Seconds after which an address is allowed one more line."""
MAX_ADDRESSES = 10_000  # that are remembered


class AuditRateLimit:
    """Limit of lines for each address.

    Args:
        clock: Monotonic time [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._found: OrderedDict[str, tuple[float, float]] = OrderedDict()  # lines that count, as of a time

    def is_exceeded(self, address: str) -> bool:
        """Whether an address has used up its lines; if not, count one more."""
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
