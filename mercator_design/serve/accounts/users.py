"""The users of the service and their tokens: DATA/.service/users.json.

A token is `md_ID_SECRET`. Its secret has 256 random bits, so nobody can guess it, and nobody learns it from the SHA-256
digest of the token, which is all that the file has. `mdesign users` changes the file; a running service reads it again
when it has changed.
"""

import fcntl
import hashlib
import json
import os
import secrets
import string
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from mercator_design.config.json_data import read_json
from mercator_design.config.schema import FieldError, Pattern
from mercator_design.config.writing import plain
from mercator_design.errors import MercatorError, excerpt
from mercator_design.serve.settings import SERVICE, ServiceError
from mercator_design.system.files import write_text

FILE = "users.json"
DAYS = 365
"""Default lifetime of a token [days]."""
MAX_TOKENS = 20
"""Maximum number of a user's tokens that have not expired."""

_LETTERS = string.ascii_letters + string.digits
_NAME = Pattern(r"[a-z0-9][a-z0-9._-]{0,31}", "a name of up to 32 of a-z, 0-9, '.', '_' and '-'")
_SECRET = 43  # letters and digits: 256 bits


@dataclass(frozen=True, slots=True)
class User:
    """Sender of a request.

    is_admin: Whether it may see and change the jobs and designs of others.
    """

    name: str
    is_admin: bool = False

    @property
    def viewer(self) -> str | None:
        """Name for queries of visible jobs and designs; None for an administrator, who sees all."""
        return None if self.is_admin else self.name

    def owns(self, owner: str) -> bool:
        """Whether it may change the jobs and designs of an owner."""
        return self.is_admin or owner == self.name


LOCAL = User("local", is_admin=True)
"""User of a service without users, which only this machine reaches."""


@dataclass(frozen=True, slots=True)
class Holder:
    """User of a valid token, or of a session that was begun with one."""

    user: User
    token: str  # its id
    expires: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class Token:
    """A token in the file of users."""

    id: Annotated[str, Pattern(r"[A-Za-z0-9]{8}", "8 letters and digits")]
    digest: Annotated[str, Pattern(r"[0-9a-f]{64}", "64 hexadecimal digits")]
    created: str  # time
    expires: Annotated[str, Pattern(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", "a time in UTC")]

    def __post_init__(self) -> None:
        try:
            datetime.fromisoformat(self.expires)
        except ValueError:
            raise FieldError("expires", "expected a time in UTC") from None

    def is_expired(self, now: datetime) -> bool:
        return datetime.fromisoformat(self.expires) <= now


@dataclass(frozen=True, slots=True, kw_only=True)
class Account:
    """A user in the file. It stays there without tokens, so that nobody else gets its name and jobs."""

    name: Annotated[str, _NAME]
    is_admin: bool = False
    created: str  # time
    tokens: tuple[Token, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Contents:
    """The contents of the file."""

    format: Literal[1] = 1
    users: tuple[Account, ...] = ()


@dataclass(frozen=True, slots=True)
class _Reading:
    """The file as it was read."""

    stamp: tuple[int, ...] | None = None  # of the file; None: it is missing
    contents: _Contents = field(default_factory=_Contents)
    tokens: dict[str, tuple[Account, Token]] = field(default_factory=dict)  # by id
    ids: dict[str, str] = field(default_factory=dict)  # of tokens, by digest


class UserError(MercatorError):
    """A user cannot be added or changed as asked for."""


class Users:
    """The users in the file of a data folder; safe for several threads.

    Raises (in all methods):
        ServiceError: The file is not valid, or cannot be read.
    """

    def __init__(self, data: Path, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        self.file, self._now = data / SERVICE / FILE, now
        self._reading = _Reading()

    def accounts(self) -> tuple[Account, ...]:
        """All users; none if there is no file."""
        return self._read().contents.users

    def has_token(self) -> bool:
        """Whether there is a valid token."""
        now = self._now()
        return any(not token.is_expired(now) for account in self.accounts() for token in account.tokens)

    def holder(self, identity: str) -> Holder | None:
        """Holder of the token with this id; None if it was revoked or has expired."""
        account, token = self._read().tokens.get(identity, (None, None))
        if account is None or token is None or token.is_expired(self._now()):
            return None
        return Holder(User(account.name, account.is_admin), token.id, datetime.fromisoformat(token.expires))

    def verify(self, text: str) -> Holder | None:
        """Holder of a token; None if it is unknown, was revoked or has expired."""
        return self.holder(self._read().ids.get(digest(text), ""))

    def add(self, name: str, *, is_admin: bool = False, days: float = DAYS) -> str:
        """Add a user; return a token.

        Raises:
            UserError: The name is not valid, or taken.
            ServiceError: As `accounts`.
            OSError: The file cannot be written.
        """
        if not _NAME.allows(name):
            raise UserError(f"expected {_NAME.meaning}, found {excerpt(name)}")
        if name == LOCAL.name:
            raise UserError(f"{name}: expected another name: it is that of who uses a service without users")
        with self._editing() as users:
            if name in users:
                raise UserError(f"{name}: there is such a user; a further token: mdesign users token {name}")
            text, token = self._new_token(days)
            users[name] = Account(name=name, is_admin=is_admin, created=_time_text(self._now()), tokens=(token,))
        return text

    def add_token(self, name: str, *, days: float = DAYS) -> str:
        """Give a user a further token; return it.

        Raises:
            UserError: There is no such user, or it has too many.
            ServiceError: As `accounts`.
            OSError: The file cannot be written.
        """
        with self._editing() as users:
            if name not in users:
                raise UserError(f"expected the name of a user, found {excerpt(name)}; mdesign users list lists them")
            kept = tuple(token for token in users[name].tokens if not token.is_expired(self._now()))
            if len(kept) >= MAX_TOKENS:
                raise UserError(f"{name}: expected less than {MAX_TOKENS} tokens; revoke some first")
            text, token = self._new_token(days)
            users[name] = replace(users[name], tokens=(*kept, token))
        return text

    def revoke(self, what: str) -> tuple[str, tuple[str, ...]]:
        """Revoke all tokens of a user, or one by its id; return the user's name and the ids.

        Raises:
            UserError: There is no such user or token.
            ServiceError: As `accounts`.
            OSError: The file cannot be written.
        """
        with self._editing() as users:
            for name, account in users.items():
                gone = tuple(one.id for one in account.tokens if what in (name, one.id))
                if gone or what == name:
                    kept = tuple(one for one in account.tokens if one.id not in gone)
                    users[name] = replace(account, tokens=kept)
                    return name, gone
        raise UserError(f"expected the name of a user or the id of a token, found {excerpt(what)}")

    @contextmanager
    def _editing(self) -> Iterator[dict[str, Account]]:
        """Users by name, to be changed; written at the end, under a lock."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.file.parent.chmod(0o700)
        lock = os.open(self.file.with_suffix(".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            users = {account.name: account for account in self.accounts()}
            yield users
            text = json.dumps(plain(_Contents(users=tuple(users.values()))), indent=1) + "\n"
            if self.file.exists():  # the new file gets its permissions
                self.file.chmod(0o600)
            before = os.umask(0o077)
            try:
                write_text(self.file, text)
            finally:
                os.umask(before)
        finally:
            os.close(lock)

    def _new_token(self, days: float) -> tuple[str, Token]:
        identity, now = _random(8), self._now()
        text = f"md_{identity}_{_random(_SECRET)}"
        expires = _time_text(now + timedelta(days=days))
        return text, Token(id=identity, digest=digest(text), created=_time_text(now), expires=expires)

    def _read(self) -> _Reading:
        """The present contents of the file. A mistake in it is raised at each call."""
        try:
            found = self.file.stat()
            stamp = (found.st_mtime_ns, found.st_ino, found.st_size)
        except FileNotFoundError:
            if self._reading.stamp is not None:  # a service that has had users does not open to everybody
                raise ServiceError(f"{self.file}: is gone") from None
            stamp = None
        except OSError as error:
            raise ServiceError(f"{self.file}: cannot be read: {error.strerror}") from None
        if stamp != self._reading.stamp:
            contents = _Contents() if stamp is None else read_json(self.file, _Contents, error=ServiceError)
            tokens = {token.id: (account, token) for account in contents.users for token in account.tokens}
            ids = {token.digest: token.id for _, token in tokens.values()}
            self._reading = _Reading(stamp, contents, tokens, ids)
        return self._reading


def id_of(token: str) -> str:
    """Public id of a token."""
    return token.split("_")[1]


def digest(secret: str) -> str:
    """SHA-256 digest of a random secret."""
    return hashlib.sha256(secret.encode(errors="surrogatepass")).hexdigest()


def _random(length: int) -> str:
    return "".join(secrets.choice(_LETTERS) for _ in range(length))


def _time_text(time: datetime) -> str:
    return time.isoformat(timespec="seconds")
