"""Where the scheduler of a Dask cluster is: waits for its file, and for someone who answers at its address.

A scheduler that begins with the race writes its file some seconds later. One that was killed leaves its file, with an
address where nobody answers. Dask itself reports the first with a traceback, and the second without the cause.
"""

import json
import re
import socket
import time
from collections.abc import Callable
from pathlib import Path

from mercator_design.errors import RaceError

TIMEOUT = 20.0
"""Seconds to wait for an answer at an address that was given."""
FILE_TIMEOUT = 600.0
"""Seconds to wait for a scheduler file, or for an answer at the address in it."""
_EVERY = 0.5
_PATIENCE = 2.0
"""Seconds before a message says what is waited for."""
_ADDRESS = re.compile(r"(?:\w+://)?\[?([^/\[\]]+?)\]?:(\d+)")


def address_of(
    scheduler: str,
    timeout: float | None = None,
    *,
    announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> str:
    """The address of a scheduler, at which someone listens.

    Args:
        scheduler: An address, or a scheduler file.
        timeout: Seconds to wait. [default: `TIMEOUT`, or `FILE_TIMEOUT` for a file]
        announce: Called with a message when it waits.
        clock: Returns the time [s].
        sleep: Waits for some seconds.

    Raises:
        RaceError: There is no file, or nobody listens there, in this time; or the file is of another kind.
    """
    is_file = "://" not in scheduler and _ADDRESS.fullmatch(scheduler) is None
    limit = timeout if timeout is not None else FILE_TIMEOUT if is_file else TIMEOUT
    begin, announced = clock(), ""
    while True:
        address = _address_in(Path(scheduler)) if is_file else scheduler
        if address is None:
            what = f"{scheduler}: there is no such scheduler file"
        elif (refusal := _refusal(address)) is None:
            return address
        else:
            where = f"{scheduler}: at {address}, which it names," if is_file else f"{scheduler}:"
            what = f"{where} nobody answers ({refusal})"
        if (waited := clock() - begin) >= limit:
            raise RaceError(f"{what}: expected a Dask scheduler there, waited {waited:.0f} s")
        if waited >= _PATIENCE and what != announced:
            announce(f"{what}; the race waits for a scheduler, at most {limit:.0f} s")
            announced = what
        sleep(_EVERY)


def _address_in(file: Path) -> str | None:
    """The address in a scheduler file; None if there is no file, or it is being written."""
    if not file.is_file():
        return None
    try:
        text = file.read_text(encoding="utf-8")
        if not text:
            return None
        return str(json.loads(text)["address"])
    except (OSError, ValueError, KeyError, TypeError):
        raise RaceError(f"{file}: expected a scheduler file of Dask, found another one") from None


def _refusal(address: str) -> str | None:
    """Why nobody can be reached at an address; None if someone listens, or if that cannot be tried."""
    found = _ADDRESS.fullmatch(address)
    if found is None:
        return None
    try:
        socket.create_connection((found[1], int(found[2])), timeout=3.0).close()
    except (OSError, UnicodeError) as error:  # the latter of a name that no host can have
        return getattr(error, "strerror", None) or str(error)
    return None
