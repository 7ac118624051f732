"""The users of the service."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class User:
    """Who sends a request.

    is_admin: Whether it may see and change what is of others.
    """

    name: str
    is_admin: bool = False


LOCAL = User("local", is_admin=True)
"""Whoever uses a service without users, which only this machine reaches."""
