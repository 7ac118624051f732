"""Dependencies of routes: the service, the user, and a job that the user may see."""

from typing import Annotated

from fastapi import Depends, Path, Request

from mercator_design.serve.accounts.users import User
from mercator_design.serve.http.problems import Missing, NotAllowed
from mercator_design.serve.http.schemas import MAX_ID
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.service import Service


def _service(request: Request) -> Service:
    return request.app.state.service  # type: ignore[no-any-return]


def _user(request: Request) -> User:
    """The user, as found by the guard."""
    return request.state.user  # type: ignore[no-any-return]


TheService = Annotated[Service, Depends(_service)]
TheUser = Annotated[User, Depends(_user)]


def may_see(user: User, row: IndexRow) -> bool:
    """Whether a user may see a job: an own or shared one, a run folder of no user, or any as an administrator."""
    return row.job.shared or not row.is_job or user.owns(row.job.owner)


def may_change(user: User, row: IndexRow) -> bool:
    return row.is_job and user.owns(row.job.owner)


def visible_job(
    service: TheService, user: TheUser, identity: Annotated[str, Path(alias="id", max_length=MAX_ID)]
) -> IndexRow:
    """A job that the user may see.

    Raises:
        Missing: There is none.
    """
    row = service.index.get(identity)
    if row is None or not may_see(user, row):
        raise Missing(f"there is no job {identity}")
    return row


VisibleJob = Annotated[IndexRow, Depends(visible_job)]


def _changeable(user: TheUser, row: VisibleJob) -> IndexRow:
    if not may_change(user, row):
        raise NotAllowed(f"{row.id} is not yours: only its owner and administrators may change it")
    return row


OwnJob = Annotated[IndexRow, Depends(_changeable)]
