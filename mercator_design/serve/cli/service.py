"""Shared parts of the verbs that use a service: options and connection."""

import click

from mercator_design.command import warn
from mercator_design.serve.client.connection import (
    SERVER,
    SERVER_VARIABLE,
    TOKEN_VARIABLE,
    Connection,
    checked_address,
    token_for,
)

SERVICE = click.option(
    "--server",
    envvar=SERVER_VARIABLE,
    default=SERVER,
    show_default=True,
    metavar="URL",
    help=f"Address of the service, also from {SERVER_VARIABLE}.",
)
JOB = click.argument("job")
EPILOG = (
    f"If the service has users, your token comes from {TOKEN_VARIABLE}, or from the file `tokens` in the folder "
    "mercator_design of your configuration (on Linux ~/.config): a line for each service, with its address and the "
    "token; only you may read it (chmod 600)."
)
"""End of the help of each verb: the source of the token."""


def connected(server: str) -> Connection:
    """The connection to a service, with the user's token.

    Raises:
        ClientError: The address or the file of tokens is not valid.
    """
    server = checked_address(server)
    connection = Connection(server, token_for(server))
    if connection.sends_token_unencrypted:
        warn(f"{server}: your token is not protected on the way there; use an https address")
    return connection
