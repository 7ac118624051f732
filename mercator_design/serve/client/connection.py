"""The connection to a service: its address, the user's token, requests, and the errors of its answers."""

import contextlib
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self
from urllib.parse import quote, urlsplit

import httpx

from mercator_design import __version__
from mercator_design.errors import MercatorError, MissionError, excerpt, printable
from mercator_design.system.files import Unreadable, read_small
from mercator_design.system.user_folders import user_folder

SERVER = "http://127.0.0.1:8000"
"""Default address of a service."""
SERVER_VARIABLE = "MERCATOR_DESIGN_SERVER"
TOKEN_VARIABLE = "MERCATOR_DESIGN_TOKEN"  # noqa: S105 - a name
_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_MAX_SIZE = 64 * 1024  # bytes of the file of tokens
_MAX_ERROR = 64 * 1024  # bytes of an answer that is an error
_TIMEOUT = httpx.Timeout(60.0, connect=10.0, read=260.0)
"""Time limits of requests [s]; that of reading is above the waiting and working time of a worker of the service."""


class ClientError(MercatorError):
    """A service cannot be reached, or refuses a request.

    Attributes:
        status: Status of the answer; 0 without an answer.
    """

    status = 0


class ConnectionLost(ClientError):  # noqa: N818 - says what has happened
    """The connection was lost, or the service cannot answer now: a later try may succeed."""


def token_file() -> Path | None:
    """File with the user's tokens, a line for each service: address and token. None without a home folder."""
    folder = user_folder("config")
    return folder / "tokens" if folder else None


def token_for(server: str, environment: Mapping[str, str] = os.environ) -> str:
    """The user's token for a service: of the environment, or of the file of tokens; empty if there is none.

    Raises:
        ClientError: The file of tokens is damaged, or others may read it.
    """
    if token := environment.get(TOKEN_VARIABLE, "").strip():
        return _checked(token, TOKEN_VARIABLE)
    file = token_file()
    try:
        if file is None or not file.exists():
            return ""
        if stat.S_IMODE(file.stat().st_mode) & 0o077:
            raise ClientError(f"{file}: other users of this machine may read it; run: chmod 600 {file}")
        lines = read_small(file, _MAX_SIZE).decode().splitlines()
    except (Unreadable, UnicodeDecodeError, OSError) as error:
        raise ClientError(f"{file}: cannot be read: {error}") from None
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or line.startswith("#"):
            continue
        if len(words) != 2:
            raise ClientError(f"{file}, line {number}: expected the address of a service and a token")
        if words[0].rstrip("/") == server:
            return _checked(words[1], f"{file}, line {number}")
    return ""


def _checked(token: str, place: str) -> str:
    if not (token.isascii() and token.isprintable()):
        raise ClientError(f"{place}: expected a token of printable ASCII characters")
    return token


class Connection:
    """A connection to a service, with the token of a user if it has users; a context manager that closes it.

    Raises:
        ClientError: The address is not valid.
    """

    def __init__(self, server: str, token: str = "", *, transport: httpx.BaseTransport | None = None) -> None:
        self.server = checked_address(server)
        headers = {"User-Agent": f"mdesign/{__version__}", "Accept": "application/json"}
        if token:
            headers["Authorization"] = f"Bearer {token}"
        self.http = httpx.Client(
            base_url=f"{self.server}/api/v1", headers=headers, timeout=_TIMEOUT, transport=transport
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.http.close()

    @property
    def sends_token_unencrypted(self) -> bool:
        """Whether the token is sent without encryption."""
        parts = urlsplit(self.server)
        return "Authorization" in self.http.headers and parts.scheme == "http" and parts.hostname not in _LOOPBACK

    def page(self, job: str) -> str:
        """The address of the page of a job."""
        return f"{self.server}/jobs/{quote(job, safe='')}"

    def call(self, method: str, path: str, **given: Any) -> Any:  # noqa: ANN401 - JSON
        """The answer to a request to a path below /api/v1, as data; what is given is as for httpx.

        Raises:
            ClientError: The service refuses it, or cannot be reached.
        """
        with self.stream(method, path, **given) as answer:
            answer.read()
        if answer.status_code == 204:
            return None
        try:
            return answer.json()
        except ValueError:
            raise ClientError(f"{self.server}: expected an answer in JSON, found something else") from None

    @contextlib.contextmanager
    def stream(self, method: str, path: str, **given: Any) -> Iterator[httpx.Response]:  # noqa: ANN401 - as for httpx
        """The answer to a request, as `call`, while it comes.

        Raises:
            ClientError: The service refuses the request.
            ConnectionLost: The service cannot be reached, or cannot answer now.
        """
        try:
            with self.http.stream(method, path, **given) as answer:
                if not answer.is_success:
                    raise self._refusal(answer)
                yield answer
        except httpx.HTTPError as error:
            what = str(error) or type(error).__name__
            raise ConnectionLost(
                f"{self.server}: cannot be reached: {what}; a service is started by: mdesign serve"
            ) from None
        except httpx.InvalidURL as error:
            raise ClientError(f"{self.server}: expected an address such as {SERVER}, found: {error}") from None

    def _refusal(self, answer: httpx.Response) -> ClientError:
        """An answer that is an error, with the messages of the service."""
        status, messages = answer.status_code, _messages(answer)
        if status == 401:
            or_file = f", or in a line of {file}" if (file := token_file()) else ""
            messages.append(f"give your token for {self.server} in {TOKEN_VARIABLE}{or_file}")
        kind = ConnectionLost if status in (502, 503, 504) else ClientError
        refusal = kind(*messages)
        refusal.status = status
        if status == 422:  # what is not valid
            refusal.exit_code = MissionError.exit_code
        return refusal


def checked_address(server: str) -> str:
    """The address of a service, without a slash at its end.

    Raises:
        ClientError: It is not one.
    """
    try:
        parts = urlsplit(server)
        is_valid = parts.scheme in ("http", "https") and parts.hostname and not (parts.query or parts.fragment)
        is_valid = is_valid and parts.username is None and parts.port != 0
    except ValueError:
        is_valid = False
    if not is_valid:
        raise ClientError(f"expected the address of a service, such as {SERVER}, found {excerpt(server)}")
    return server.rstrip("/")


def _messages(answer: httpx.Response) -> list[str]:
    """Messages of an error of the service."""
    data: object = None
    with contextlib.suppress(ValueError, RecursionError, httpx.HTTPError):
        if len(answer.read()) <= _MAX_ERROR:
            data = answer.json()
    found = data.get("errors") if isinstance(data, dict) else None
    if isinstance(found, list) and found and all(isinstance(one, str) for one in found):
        return [printable(one) for one in found]
    return [f"the service answers {answer.status_code} {printable(answer.reason_phrase)}".strip()]
