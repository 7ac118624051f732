"""mdesign users: adds, lists and revokes users of the design service."""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import click

from mercator_design.cli.options import FOLDER
from mercator_design.command import print_message, print_result
from mercator_design.serve.accounts import audit
from mercator_design.serve.accounts.users import DAYS, Account, Users, id_of
from mercator_design.serve.settings import SERVICE, ServiceError
from mercator_design.show.text.columns import aligned
from mercator_design.system.files import writing


def data_of(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --data, with a help text."""
    return click.option("--data", type=FOLDER, default=Path("runs"), show_default=True, help=text)


_DATA = data_of("Data folder of the service, as of mdesign serve.")
_DAYS = click.option(
    "--days", type=click.IntRange(1, 3650), default=DAYS, show_default=True, help="Days until the token expires."
)


@click.group()
def users() -> None:
    """Add, list and revoke users of the design service, and their tokens.

    A token is shown once, on stdout. Changes count at once, also for a service that runs.
    """


@users.command("add")
@click.argument("name")
@click.option("--admin", is_flag=True, help="Let the user see and change the jobs of all.")
@_DAYS
@_DATA
def add_user(name: str, *, admin: bool, days: int, data: Path) -> None:
    """Add a user, and print a token."""
    found = Users(data)
    with writing(found.file, ServiceError):
        token = found.add(name, is_admin=admin, days=days)
        _note(data, f"add {name}{' --admin' if admin else ''}", id_of(token))
    _show(name, token, days)


@users.command("token")
@click.argument("name")
@_DAYS
@_DATA
def add_token(name: str, days: int, data: Path) -> None:
    """Print a further token for a user; others stay valid."""
    found = Users(data)
    with writing(found.file, ServiceError):
        token = found.add_token(name, days=days)
        _note(data, f"token {name}", id_of(token))
    _show(name, token, days)


@users.command("list")
@_DATA
def list_users(data: Path) -> None:
    """List users, and the ids of their tokens."""
    accounts = Users(data).accounts()
    if not accounts:
        print_message(f"{data}: there are no users: mdesign users add NAME adds one")
        return
    rows = [("user", "admin", "token", "expires"), *(row for account in accounts for row in _rows(account))]
    print_result("\n".join(aligned(rows)))


@users.command("revoke")
@click.argument("what", metavar="NAME|TOKEN-ID")
@_DATA
def revoke_tokens(what: str, data: Path) -> None:
    """Revoke all tokens of a user, or one by its id; their sessions end, too.

    The user stays in the list, so nobody else gets the name with its jobs.
    """
    found = Users(data)
    with writing(found.file, ServiceError):
        name, tokens = found.revoke(what)
        _note(data, f"revoke {name}", *tokens)
    print_message(f"{name}: revoked: {', '.join(tokens) or 'nothing: there was no token'}")


def _note(data: Path, what: str, *tokens: str) -> None:
    """Write a change, with the ids of its tokens, to the audit log of the service, which begins new files alone."""
    log = audit.AuditLog(data / SERVICE / audit.FILE, lambda: datetime.now(UTC), size=0)
    account = f"account {os.getuid()}"
    log.write(user="", address=account, what=f"mdesign users {what}: {', '.join(tokens)}", job="", answer=0)
    log.close()


def _show(name: str, token: str, days: int) -> None:
    print_message(f"{name}: this token is shown once; it expires in {days} days")
    print_result(token)


def _rows(account: Account) -> list[tuple[str, ...]]:
    now, admin = datetime.now(UTC), "yes" if account.is_admin else ""
    return [
        (account.name, admin, token.id, "expired" if token.is_expired(now) else token.expires[:10])
        for token in account.tokens
    ] or [(account.name, admin, "", "revoked")]
