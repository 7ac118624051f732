"""Lines of text in bytes that arrive in pieces."""

MAX_LINE = 1 << 16
"""Bytes in a line; longer lines are dropped."""


class LineSplitter:
    """Splits bytes into lines, and keeps the beginning of a line whose end is still to come."""

    def __init__(self) -> None:
        self._begun = b""

    def receive(self, data: bytes) -> list[bytes]:
        """Take bytes; return the lines that they end, without newlines."""
        *lines, begun = (self._begun + data).split(b"\n")
        self._begun = begun[: MAX_LINE + 1]  # of a line that is too long, what shows that it is
        return [line for line in lines if len(line) <= MAX_LINE]
