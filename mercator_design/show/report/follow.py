"""Serves the page of a race that is running, on this computer alone, until the race ends.

There are two addresses: / is the page, or the whole report when the race has ended; /live is the part of the page that
changes, as JSON. A request by another name than that of this computer is refused: a page of another site could reach
the server by a name that it leads here (DNS rebinding).
"""

import json
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from mercator_design.errors import MercatorError, RaceError
from mercator_design.race.session.journal import is_locked
from mercator_design.results.facts import Facts
from mercator_design.results.files import JOURNAL
from mercator_design.show.report.markup import note
from mercator_design.show.report.page import following_page, live_part

HOST = "127.0.0.1"
SECONDS = 3.0
"""Seconds between two requests of the page for its live part; more if making this part takes long."""
_SHARE = 0.1  # of the time that making the live part may take
FAREWELL = 30.0
"""Seconds after the end of the race in which a page can ask for the report."""
POLL = 0.5  # seconds
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}


class FollowServer(ThreadingHTTPServer):
    """A server for the race of a run folder; a context manager that closes it.

    Args:
        folder: The run folder.
        report: Makes the whole report of the race, when it has ended.
        port: 0 chooses a free one.

    Raises:
        RaceError: There is no race, it is not running, or the port cannot be used.
    """

    daemon_threads = True

    def __init__(self, folder: Path, report: Callable[[], str], port: int = 0) -> None:
        self._folder = folder
        self._report = report
        self._lock = threading.Lock()
        facts = Facts.read(folder)
        if not self.is_running:
            raise RaceError(f"{folder}: expected a race that is running, found one that is {facts.state}")
        self._page = following_page(facts)
        self._live, self._again = "", 0.0  # the last live part, and from when on to make the next one
        self._is_sent = False
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise RaceError(f"port {port}: cannot be used: {error.strerror or error}; give another --port") from None
        self.timeout = POLL

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/"

    @property
    def is_running(self) -> bool:
        """Whether a process runs the race."""
        return is_locked(self._folder / JOURNAL)

    def serve(self) -> None:
        """Serve until the race has ended and a page has received the report, or for FAREWELL seconds after the end."""
        end = None
        while not self._is_sent and (end is None or time.monotonic() < end):
            self.handle_request()
            if end is None and not self.is_running:
                end = time.monotonic() + FAREWELL

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - the library's
        """Print the error, unless a page was closed before it received its answer."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)

    def is_own(self, host: str | None) -> bool:
        """Whether a request names this server."""
        return host in {f"{HOST}:{self.server_port}", f"localhost:{self.server_port}"}

    def send_page(self, send: Callable[[str], None]) -> None:
        """Send the page, or the report if the race has ended."""
        if self.is_running:
            send(self._page)
            return
        with self._lock:
            try:
                report = self._report()
            except MercatorError as error:
                report = note(error)
        send(report)
        self._is_sent = True  # not before: the server ends with it

    def live(self) -> str:
        """The live part of the page as JSON."""
        if not self.is_running:
            return json.dumps({"ended": True})
        with self._lock:
            begin = time.monotonic()
            if begin >= self._again:
                try:
                    html = live_part(Facts.read(self._folder))
                except MercatorError as error:
                    html = note(error)
                seconds = max(SECONDS, (time.monotonic() - begin) / _SHARE)
                self._live = json.dumps({"ended": False, "html": html, "seconds": seconds})
                self._again = begin + 0.5 * seconds
            return self._live


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: FollowServer

    def do_GET(self) -> None:
        """Answer a GET; the library refuses all other methods."""
        if not self.server.is_own(self.headers.get("Host")):
            self._answer(HTTPStatus.MISDIRECTED_REQUEST, "text/plain", "This is not the host of this page.\n")
        elif self.path == "/":
            self.server.send_page(partial(self._answer, HTTPStatus.OK, "text/html"))
        elif self.path == "/live":
            self._answer(HTTPStatus.OK, "application/json", self.server.live())
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", "There is only / here.\n")

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - the name that the library uses
        """Requests are not logged."""

    def _answer(self, status: HTTPStatus, kind: str, text: str) -> None:
        data = text.encode()
        self.send_response(status)
        headers = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(data)), **_HEADERS}
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)
