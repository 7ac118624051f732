"""What happens to a process when the memory of the machine is short."""

import contextlib
from pathlib import Path

_SCORE = "500"
"""Linux adds so many thousandths of the machine's memory to what this process uses when it chooses one to kill."""


def die_first() -> None:
    """Let the system kill this process and those that it starts rather than others, such as the one that started it."""
    with contextlib.suppress(OSError):  # not on Linux
        Path("/proc/self/oom_score_adj").write_text(_SCORE, encoding="ascii")
