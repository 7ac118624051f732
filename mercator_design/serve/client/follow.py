"""Follows a job by its events, and continues after a lost connection."""

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple
from urllib.parse import quote

import httpx
from httpx_sse import EventSource, SSEError

from mercator_design.errors import RaceError, excerpt
from mercator_design.race.elimination.summary import Progress
from mercator_design.race.session.events import event_of
from mercator_design.race.session.view import RaceView
from mercator_design.serve.client.connection import ClientError, Connection, ConnectionLost
from mercator_design.serve.jobs.job import ENDED
from mercator_design.show.text.progress import Display, Mode, RaceDisplay

STATE = "state"
"""Kind of the events that hold the job itself."""
_SILENCE = 60.0
"""Seconds of silence after which the connection counts as lost; the service sends something every 15 s."""
_WAITS = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Seconds before each retry."""

_TOO_MANY = 429
"""Status of the refusal of one event stream too many; worth a retry, because another one will end."""

Sleep = Callable[[float], None]


class JobEvent(NamedTuple):
    """An event of a job.

    kind: "state", or that of the journal, such as "experiment".
    data: Its data.
    """

    kind: str
    data: dict[str, Any]


class _RemoteRace(NamedTuple):
    """A race of the service, as the display of progress needs it."""

    name: str
    maximise: bool

    def cost(self, score: float) -> float:
        return -score if self.maximise else score

    def score(self, cost: float) -> float:
        return 0.0 - cost if self.maximise else cost


def events_of(
    connection: Connection, job: str, *, announce: Callable[[str], None], sleep: Sleep = time.sleep
) -> Iterator[JobEvent]:
    """Events of a job until it has ended: each event of its journal once, also after lost connections.

    Raises:
        ClientError: There is no such job, or the service refuses to follow it.
    """
    place, tries, is_announced = "", 0, False
    while True:
        try:
            for identity, received in _stream(connection, job, place):
                place, tries, is_announced = identity or place, 0, False
                yield received
                if received.kind == STATE and received.data.get("state") in ENDED:
                    return
        except ClientError as lost:
            if not isinstance(lost, ConnectionLost) and lost.status != _TOO_MANY:
                raise
            if not is_announced:
                announce(f"{lost.messages[0]}; trying again")
                is_announced = True
        sleep(_WAITS[min(tries, len(_WAITS) - 1)])
        tries += 1


def _stream(connection: Connection, job: str, place: str) -> Iterator[tuple[str, JobEvent]]:
    """The events of one connection, with their places."""
    headers = {"Accept": "text/event-stream", "Cache-Control": "no-store"} | ({"Last-Event-ID": place} if place else {})
    timeout = httpx.Timeout(_SILENCE, connect=10.0)
    path = f"/jobs/{quote(job, safe='')}/events"
    with connection.stream("GET", path, headers=headers, timeout=timeout) as answer:
        try:
            for event in EventSource(answer).iter_sse():
                if not event.data:  # httpx_sse makes an event of a comment, which the service sends against silence
                    continue
                data = json.loads(event.data)
                if not isinstance(data, dict):
                    raise ClientError(f"{connection.server}: expected an event, found {excerpt(event.data)}")
                yield event.id, JobEvent(event.event, data)
        except (SSEError, ValueError) as error:
            raise ClientError(f"{connection.server}: expected the events of a job: {error}") from None


def follow(
    connection: Connection,
    job: str,
    mode: Mode,
    *,
    announce: Callable[[str], None],
    each: Callable[[JobEvent], None] = lambda received: None,  # noqa: ARG005 - a name for the reader
    sleep: Sleep = time.sleep,
) -> dict[str, Any]:
    """Show the progress of a job until it has ended, and call `each` with its events; returns the job at its end.

    Raises:
        ClientError: As `events_of`.
    """
    now: dict[str, Any] = connection.call("GET", f"/jobs/{quote(job, safe='')}")
    try:
        raced = _RemoteRace(str(now["name"]), now["direction"] == "maximise")
        budget, known = int(now["budget"]), int(now["experiments"])
    except (KeyError, TypeError, ValueError):
        raise ClientError(f"{connection.server}: expected a job, found something else") from None
    if now.get("kind") == "study":
        return _follow_study(connection, now, mode, announce=announce, each=each, sleep=sleep)
    plan = Progress(iteration=1, iterations=0, alive=0, used=0, budget=budget, best=None)
    view, said = RaceView(budget), ""
    with RaceDisplay(raced, view, None, mode, plan=plan) as display:
        display.known = known
        for received in events_of(connection, job, announce=announce, sleep=sleep):
            each(received)
            if received.kind == STATE:
                now = received.data
                if (words := _state_text(now)) != said and now.get("state") not in ENDED:
                    announce(f"{job}: {words}")
                said = words
            elif received.kind != "start":
                try:
                    event = event_of(dict(received.data))
                except RaceError as error:
                    raise ClientError(f"{connection.server}: {error.messages[0]}") from None
                view.note(event)
                display.note(event)
    return now


def _follow_study(
    connection: Connection,
    now: dict[str, Any],
    mode: Mode,
    *,
    announce: Callable[[str], None],
    each: Callable[[JobEvent], None],
    sleep: Sleep,
) -> dict[str, Any]:
    """As `follow`, of a study: its events are its states, with the experiments of the whole."""
    job, said = str(now["id"]), ""
    with Display(str(now["name"]), int(now["budget"]), mode) as display:
        display.known = int(now["experiments"])
        for received in events_of(connection, job, announce=announce, sleep=sleep):
            each(received)
            now = received.data
            display.show(int(now.get("experiments", 0)))
            if (words := _state_text(now)) != said and now.get("state") not in ENDED:
                announce(f"{job}: {words}")
            said = words
    return now


def _state_text(job: dict[str, Any]) -> str:
    """The state of a job, with its message."""
    return ": ".join(str(job[key]) for key in ("state", "message") if job.get(key))


def result(job: dict[str, Any]) -> str:
    """Result of a job that has ended, as text."""
    best, score = job.get("best"), ""
    if isinstance(best, float | int) and math.isfinite(best):
        score = f", score {best:.4g} {job.get('measured') or ''}".rstrip()
    return f"{job.get('id')}: {_state_text(job)}, {job.get('experiments')} of {job.get('budget')} experiments{score}"
