"""The route that follows a job: the events of its journal as server-sent events."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query
from fastapi.responses import StreamingResponse
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse

from mercator_design.results.files import JOURNAL
from mercator_design.serve.accounts.users import User
from mercator_design.serve.http.context import TheService, TheUser, VisibleJob, may_see
from mercator_design.serve.http.problems import RESPONSES
from mercator_design.serve.http.schemas import JobAnswer
from mercator_design.serve.jobs.job import ENDED
from mercator_design.serve.jobs.operations import NotPossible
from mercator_design.serve.jobs.races import JournalEvent, check_place, events_in, length_of, lines_from
from mercator_design.serve.service import Service

router = APIRouter(prefix="/api/v1", tags=["jobs"], responses=RESPONSES)

_log = logging.getLogger(__name__)

PERIOD = 0.5
"""Seconds between two reads of a journal."""
_PAUSE = 0.01
"""Pause between two pieces of a journal, in which other requests are answered [s]."""
KEEPALIVE = 15.0
"""Seconds of silence after which a comment is sent, so that no proxy closes the connection."""
_HEADERS = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}


def _checked_place(
    service: TheService,
    row: VisibleJob,
    last: Annotated[str, Header(alias="Last-Event-ID", max_length=20, pattern=r"^\d*$")] = "",
    after: Annotated[
        int, Query(ge=0, lt=2**63, description="As Last-Event-ID, for clients that cannot send headers.")
    ] = 0,
) -> int:
    """Byte offset in the journal from which to send events."""
    place = int(last or after)
    try:
        check_place(service.store.run_folder(row.id) / JOURNAL, place)
    except ValueError as error:
        raise NotPossible(f"Last-Event-ID: {error}") from None
    return place


@router.get(
    "/jobs/{id}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}, "description": "Events until the job has ended."}},
)
async def follow(
    service: TheService, user: TheUser, row: VisibleJob, place: Annotated[int, Depends(_checked_place)]
) -> EventSourceResponse:
    """Follow a job until it has ended: server-sent events.

    The events are those of its journal, as `mdesign race --json-lines` prints them; the id of each is its place in the
    journal, so a client that comes back with Last-Event-ID misses none. Between them come events of the kind `state`,
    with the job, at the beginning and after each change but that of its experiments and of its time. A study
    has no journal: all its events are of the kind `state`, also when experiments have run.
    """
    return EventSourceResponse(_stream(service, user, row.id, place), headers=_HEADERS)


async def _stream(service: Service, user: User, identity: str, place: int) -> AsyncIterator[bytes]:
    """The text of the events; many in one piece, because races may be fast."""
    journal, shown, silent = service.store.run_folder(identity) / JOURNAL, None, 0.0
    while True:
        now = service.index.get(identity)
        if now is None or not may_see(user, now):  # deleted, or no longer shared
            return
        try:
            while length_of(journal) > place and (lines := lines_from(journal, place)):
                yield _events_text(lines, place)
                place += len(lines)
                await asyncio.sleep(_PAUSE)
        except ValueError as error:  # damaged; a client that comes back gets the problem
            _log.warning("job %s: its journal: %s", identity, error)
            return
        experiments = now.experiments if now.is_study else 0
        if (current := replace(now, job=replace(now.job, seconds=0.0), experiments=experiments, left=None)) != shown:
            shown = current
            state = JournalEvent(place, b"state", JobAnswer.of(now).model_dump_json().encode())
            yield _text([state])
            silent = 0.0
        if now.state in ENDED:
            return
        if (silent := silent + PERIOD) >= KEEPALIVE:
            silent = 0.0
            yield KEEPALIVE_COMMENT
        await asyncio.sleep(PERIOD - time.monotonic() % PERIOD)  # all together, so that a piece is made once


@lru_cache(maxsize=128)  # hundreds may follow the same race
def _events_text(lines: bytes, place: int) -> bytes:
    """The text of the events in lines of a journal that begin at a place."""
    return _text(events_in(lines, place))


def _text(events: Iterable[JournalEvent]) -> bytes:
    return b"".join(b"event: %b\ndata: %b\nid: %d\n\n" % (one.kind, one.data, one.place) for one in events)
