"""Following a job by its events: each once, over reconnections."""

import asyncio
import json
from contextlib import aclosing

import pytest

from mercator_design.serve.accounts.users import User
from mercator_design.serve.http import events
from tests.serve.still import ANN, BOB

JOBS = "/api/v1/jobs"


def parsed(text):
    """The events of a stream: kind, data, place."""
    found = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if fields:
            found.append((fields["event"], json.loads(fields["data"]), int(fields["id"])))
    return found


def journal_of(quiet, job):
    """The events of a journal as they are to be told."""
    found = []
    for line in (quiet.folder(job) / "journal.jsonl").read_text().splitlines():
        event = json.loads(line)
        del event["crc"]
        event.pop("after", None)
        found.append(event)
    return found


@pytest.fixture
def ended(quiet):
    job = quiet.submit()
    quiet.race(job)
    return job


def test_all_events_of_a_race_that_has_ended(ann, quiet, ended):
    answer = ann.get(f"{JOBS}/{ended}/events")
    assert answer.headers["content-type"].startswith("text/event-stream")
    *raced, last = parsed(answer.text)
    assert [data for _, data, _ in raced] == journal_of(quiet, ended)
    assert all(kind == data["event"] for kind, data, _ in raced)
    assert (last[0], last[1]["state"], last[1]["id"]) == ("state", "finished", ended)
    assert last[2] == (quiet.folder(ended) / "journal.jsonl").stat().st_size


def test_it_goes_on_after_any_event(ann, quiet, ended):
    raced = parsed(ann.get(f"{JOBS}/{ended}/events").text)[:-1]
    whole = [data for _, data, _ in raced]
    for k in (1, 7, len(raced) - 1, len(raced)):
        place = raced[k - 1][2]
        for given in ({"headers": {"Last-Event-ID": str(place)}}, {"params": {"after": place}}):
            rest = parsed(ann.get(f"{JOBS}/{ended}/events", **given).text)
            assert [data for _, data, _ in rest[:-1]] == whole[k:]
            assert rest[-1][0] == "state"


def test_a_run_folder_that_is_raced_anew_gives_its_new_events(ann, quiet, ended):
    ann.get(f"{JOBS}/{ended}/events")
    journal = quiet.folder(ended) / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[3], lines[4] = lines[4], lines[3]
    (new := journal.with_name("new")).write_bytes(b"".join(lines))
    new.rename(journal)  # as long as the one of before
    raced = parsed(ann.get(f"{JOBS}/{ended}/events").text)[:-1]
    assert [data for _, data, _ in raced] == journal_of(quiet, ended)


@pytest.mark.parametrize("place", ["1", "99999999", "18446744073709551615"])
def test_places_that_are_none_are_refused(ann, ended, place):
    answer = ann.get(f"{JOBS}/{ended}/events", headers={"Last-Event-ID": place})
    assert answer.status_code == 409
    assert answer.json()["errors"] == [f"Last-Event-ID: expected the place of an event, found {place}"]


@pytest.mark.parametrize("place", ["x", "-1", "1.5", "1" * 30, "\u0661"])
def test_other_words_are_not_valid(ann, ended, place):
    answer = ann.get(f"{JOBS}/{ended}/events", headers={"Last-Event-ID": place.encode()})
    assert answer.status_code == 422


def test_a_place_in_a_race_that_has_not_begun(ann, quiet):
    job = quiet.submit()
    assert ann.get(f"{JOBS}/{job}/events", headers={"Last-Event-ID": "7"}).status_code == 409


async def some(stream, enough):
    """The events of a stream until there are enough."""
    text = ""
    async for part in stream:
        text += part.decode()
        if enough(parsed(text)):
            return parsed(text)
    return parsed(text)


def stream(quiet, job, place=0, user=ANN):
    return events._stream(quiet.service, user, job, place)


@pytest.fixture
def at_once(monkeypatch):
    """Nobody waits."""
    monkeypatch.setattr(events, "PERIOD", 0.001)


def test_each_event_once_over_reconnections_while_it_runs(quiet, at_once):
    job = quiet.submit()
    quiet.race(job, lines=3)

    async def run():
        found, place = [], 0
        while True:
            async with aclosing(stream(quiet, job, place)) as one:
                told = await some(one, lambda told: any(kind != "state" for kind, _, _ in told))
            new = [(data, at) for kind, data, at in told if kind != "state"]
            found += [data for data, _ in new]
            place = new[-1][1]
            if not quiet.append(job, 7):
                return found

    assert asyncio.run(run()) == journal_of(quiet, job)


def test_a_line_that_is_being_written_is_reported_when_it_is_whole(quiet, at_once):
    job = quiet.submit()
    quiet.race(job, lines=3)
    journal = quiet.folder(job) / "journal.jsonl"
    line = (quiet.raced / "journal.jsonl").read_bytes().splitlines(keepends=True)[3]

    async def run():
        async with aclosing(stream(quiet, job)) as one:
            await some(one, lambda told: told[-1][0] == "state")
            with journal.open("ab", buffering=0) as file:
                file.write(line[:20])
                await asyncio.sleep(0.02)
                file.write(line[20:])
            return await some(one, bool)

    [(kind, data, _)] = asyncio.run(run())
    assert (kind, data) == ("configuration", journal_of(quiet, job)[3])


def test_changes_of_the_job_are_told_between(quiet, at_once):
    job = quiet.submit()

    async def run():
        async with aclosing(stream(quiet, job)) as one:
            states = [(await some(one, bool))[0][1]["state"]]
            quiet.service.jobs.pause(job)
            states.append((await some(one, bool))[0][1]["state"])
            quiet.service.jobs.cancel(job)
            states += [data["state"] for _, data, _ in await some(one, lambda _: False)]
            return states

    assert asyncio.run(run()) == ["queued", "paused", "cancelled"]


def test_each_change_is_reported_but_the_progress(quiet, at_once):
    job = quiet.submit()

    async def run():
        async with aclosing(stream(quiet, job)) as one:
            await some(one, bool)
            quiet.show(job, in_job={"seconds": 3.0}, experiments=5, left=9.0)
            quiet.service.jobs.change(job, priority=7)
            priorities = [(await some(one, bool))[0][1]["priority"]]
            quiet.service.index.change(job, best=0.5, experiments=6)
            return [*priorities, (await some(one, bool))[0][1]["best"]]

    assert asyncio.run(run()) == [7, 0.5]


@pytest.mark.parametrize("what", ["deleted", "not shared", "damaged"])
def test_it_ends_when_the_job_is_gone(quiet, at_once, what):
    job = quiet.submit()
    quiet.race(job, lines=5)
    quiet.service.jobs.change(job, shared=True)

    async def run():
        async with aclosing(stream(quiet, job, user=BOB)) as one:
            await some(one, lambda told: told[-1][0] == "state")
            if what == "deleted":
                quiet.service.jobs.delete(job)
            elif what == "not shared":
                quiet.service.jobs.change(job, shared=False)
            else:
                with (quiet.folder(job) / "journal.jsonl").open("ab") as file:
                    file.write(b"?\n")
            return await some(one, lambda _: False)

    assert asyncio.run(run()) == []


def test_silence_is_broken_now_and_then(quiet, at_once, monkeypatch):
    monkeypatch.setattr(events, "KEEPALIVE", 0.01)
    job = quiet.submit()

    async def run():
        async with aclosing(stream(quiet, job, user=User("ann"))) as one:
            await anext(one)
            return await anext(one)

    assert asyncio.run(run()).startswith(b":")
