"""The process of a job: runs `mdesign`, and stops when the service has ended for any reason.

Its standard input is a pipe from the service. When the service ends, the pipe is closed: the race stops when its
running experiments have finished, and can be resumed.
"""

import os
import signal
import sys
import threading
import time

from mercator_design.system.shortage import die_first

_NICE = 10
"""Niceness of races, so that the service answers at once."""
_GRACE = 60.0
"""Time limit of the running experiments at the end of the service [s]."""


def _stop_with_service() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(os.EX_TEMPFAIL)


def main() -> None:
    """Run the command line, which is that of `mdesign`."""
    threading.Thread(target=_stop_with_service, daemon=True).start()
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.nice(_NICE)
    die_first()
    from mercator_design.cli import main as mdesign

    sys.argv[0] = "mdesign"
    mdesign()


if __name__ == "__main__":
    main()
