"""Messages to systemd about a run that it has started (sd_notify(3)); none without systemd."""

import contextlib
import os
import socket


def notify(**states: str | int) -> None:
    """Send states to systemd, without waiting: READY=1, WATCHDOG=1, STATUS="...", STOPPING=1."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    message = "\n".join(f"{name}={value}" for name, value in states.items())
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as speaking:
        speaking.setblocking(False)
        speaking.sendto(message.encode(), address.replace("@", "\0", 1) if address[0] == "@" else address)
