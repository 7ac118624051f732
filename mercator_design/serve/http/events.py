"""The route that follows a job: the events of its journal as server-sent events."""

import asyncio
import logging
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query
from fastapi.sse import EventSourceResponse, ServerSentEvent

from mercator_design.runs.files import JOURNAL
from mercator_design.serve.http.context import TheService, TheUser, VisibleJob, may_see
from mercator_design.serve.http.problems import RESPONSES
from mercator_design.serve.http.schemas import Job
from mercator_design.serve.jobs.job import ENDED
from mercator_design.serve.jobs.operations import NotPossible
from mercator_design.serve.jobs.races import events_from, events_until, length_of

router = APIRouter(prefix="/api/v1", tags=["jobs"], responses=RESPONSES)  # type: ignore[arg-type]

_log = logging.getLogger(__name__)

_PERIOD = 0.25
"""Seconds between two looks at a journal."""


def _place(
    service: TheService,
    row: VisibleJob,
    last: Annotated[str, Header(alias="Last-Event-ID", max_length=20, pattern=r"^\d*$")] = "",
    after: Annotated[int, Query(ge=0, lt=2**63, description="As Last-Event-ID, for who cannot send headers.")] = 0,
) -> int:
    """The place in the journal after which to begin."""
    place = int(last or after)
    try:
        events_from(service.store.run_folder(row.id) / JOURNAL, place)
    except (ValueError, OverflowError) as error:
        raise NotPossible(f"Last-Event-ID: {error}") from None
    return place


@router.get("/jobs/{id}/events", response_class=EventSourceResponse)
async def follow(
    service: TheService, user: TheUser, row: VisibleJob, place: Annotated[int, Depends(_place)]
) -> AsyncIterator[ServerSentEvent]:
    """Follow a job until it has ended: server-sent events.

    The events are those of its journal, as `mdesign race --json-lines` prints them; the id of each is its place in the
    journal, so a client that comes back with Last-Event-ID misses none. Between them come events of the kind `state`,
    with the job, at the beginning and after each change.
    """
    journal, shown = service.store.run_folder(row.id) / JOURNAL, None
    while True:
        now = service.index.get(row.id)
        if now is None or not may_see(user, now):  # deleted, or no longer shared
            return
        try:
            while (length := length_of(journal)) > place and (found := events_until(journal, place, length)):
                for event in found:
                    yield ServerSentEvent(raw_data=event.data, event=event.kind, id=str(event.place))
                place = found[-1].place
        except ValueError as error:  # damaged; who comes back is told so
            _log.warning("job %s: its journal: %s", row.id, error)
            return
        if (told := (now.state, now.message, now.budget, now.best, now.shared)) != shown:
            shown = told
            yield ServerSentEvent(raw_data=Job.of(now).model_dump_json(), event="state", id=str(place))
        if now.state in ENDED:
            return
        await asyncio.sleep(_PERIOD)
