"""Health, readiness, figures; and the server itself, on a socket."""

import asyncio
import contextlib
import json
import re
import socket

import pytest
import uvicorn
from starlette.responses import PlainTextResponse
from starlette.testclient import TestClient

from mercator_design.serve.app import guarded
from mercator_design.serve.http import server
from mercator_design.serve.http.server import PatientProtocol, listening
from mercator_design.serve.service import Service
from tests.processes import LIMIT, wait_until


def test_health_and_readiness(client):
    assert client.get("/healthz").text == "ok\n"
    assert client.get("/readyz").text == "ready\n"


def test_it_is_not_ready_when_jobs_are_not_looked_after(client, service, monkeypatch):
    monkeypatch.setattr(type(service.supervisor), "is_at_work", False)
    answer = client.get("/readyz")
    assert (answer.status_code, answer.text) == (503, "not ready\n")
    assert client.get("/healthz").status_code == 200


def test_it_is_not_ready_with_a_damaged_file_of_users(client, service):
    service.accounts.users.file.write_text("{")
    try:
        assert client.get("/readyz").status_code == 503
    finally:
        service.accounts.users.file.unlink()


def test_figures_are_in_the_format_of_prometheus(client, service):
    client.get("/nothing")
    answer = client.get("/metrics")
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    values, kinds = {}, {}
    for line in answer.text.splitlines():
        if line.startswith("# TYPE"):
            _, _, name, kind = line.split()
            kinds[name] = kind
        elif not line.startswith("# HELP"):
            name, value = re.fullmatch(r'([a-z_]+(?:\{[a-z]+="[^"\\]*"\})?) (\S+)', line).groups()
            values[name] = float(value)
    assert {name.partition("{")[0] for name in values} == kinds.keys()
    assert values['mercator_jobs{state="running"}'] == 0
    assert values['mercator_http_answers_total{status="404"}'] >= 1
    assert values["mercator_ready"] == 1
    assert values["mercator_free_disk_bytes"] > 0


def test_figures_need_a_login_when_there_are_users(tmp_path, idle_races):
    with Service(tmp_path) as service, TestClient(guarded(service), base_url="http://localhost") as client:
        token = service.accounts.users.add("prometheus")
        assert client.get("/metrics").status_code == 401
        assert client.get("/metrics", headers={"authorization": f"Bearer {token}"}).status_code == 200


def test_a_submission_is_audited_with_its_job(client, service):
    body = {"mission": "aggregation", "budget": 100, "set": ["robots=2", "duration=5"]}
    answer = client.post("/api/v1/jobs", json=body)
    assert answer.status_code == 201
    identity = answer.json()["job"]["id"]
    assert answer.headers["location"] == f"/api/v1/jobs/{identity}"
    client.post(f"/api/v1/jobs/{identity}/cancel")
    *_, submitted, cancelled = (service.data / ".service" / "audit.log").read_text().splitlines()
    assert json.loads(submitted)["job"] == json.loads(cancelled)["job"] == identity
    assert json.loads(submitted)["answer"] == 201


def test_the_document_of_the_api_says_how_to_log_in(client):
    document = client.get("/api/v1/openapi.json").json()
    assert document["components"]["securitySchemes"]["HTTPBearer"]["scheme"] == "bearer"
    assert document["paths"]["/api/v1/jobs"]["get"]["security"] == [{"HTTPBearer": []}]


@contextlib.asynccontextmanager
async def running(app, **options):
    """A server of an application, and its address."""
    with listening("127.0.0.1", 0) as listener:
        config = uvicorn.Config(
            app, http=PatientProtocol, ws="none", log_level="critical", lifespan="off", timeout_keep_alive=60, **options
        )
        found = uvicorn.Server(config)
        found.capture_signals = contextlib.nullcontext
        task = asyncio.create_task(found.serve([listener]))
        yield found, listener.getsockname()
        found.should_exit = True
        await task


class TestServer:
    """The server on a socket; its waits for what does not come are short, and nothing is asserted on them."""

    @pytest.fixture
    def talk(self, monkeypatch):
        async def talking(*parts):
            monkeypatch.setattr(server, "HEADER_SECONDS", 0.05 if len(parts) == 1 else LIMIT)

            async def app(scope, receive, send):
                monkeypatch.setattr(server, "HEADER_SECONDS", 0.05)  # for the next request
                await PlainTextResponse("hello")(scope, receive, send)

            async with running(app) as (_, address):
                reader, writer = await asyncio.open_connection(*address)
                for part in parts:
                    writer.write(part)
                    await writer.drain()
                received = await reader.read()
                writer.close()
                return received

        return lambda *parts: asyncio.run(talking(*parts))

    @pytest.mark.parametrize("part", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: "])
    def test_it_does_not_wait_for_headers_for_ever(self, talk, part):
        assert talk(part) == b""

    def test_nor_for_those_of_a_second_request(self, talk):
        found = talk(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET / HTTP/1.1\r\n")
        assert found.count(b"HTTP/1.1 200 OK") == 1
        assert found.endswith(b"hello")

    def test_who_only_connects_keeps_nobody_out(self, monkeypatch):
        monkeypatch.setattr(server, "HEADER_SECONDS", LIMIT)

        async def app(scope, receive, send):
            await PlainTextResponse("hello")(scope, receive, send)

        async def crowd():
            async with running(app, limit_concurrency=3) as (_, address):
                opened, answers = [], []
                for _ in range(5):
                    reader, writer = await asyncio.open_connection(*address)
                    opened.append(writer)
                    writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                    answers.append((await reader.readuntil(b"hello")).split(b"\r\n")[0])
                for writer in opened:
                    writer.close()
                return answers

        assert asyncio.run(crowd()) == 5 * [b"HTTP/1.1 200 OK"]

    @staticmethod
    @contextlib.asynccontextmanager
    async def ignored(n, asked=None):
        """A server with a limit of 4 connections, of which clients have n, and do not read the answers."""
        answer = b"x" * 50_000_000  # more than all buffers between server and client have

        async def app(scope, receive, send):
            if asked is not None:
                asked.set()
            await PlainTextResponse(answer if scope["path"] == "/long" else b"hello")(scope, receive, send)

        async with running(app, limit_concurrency=4) as (found, address):
            with contextlib.ExitStack() as opened:
                for _ in range(n):
                    one = opened.enter_context(socket.create_connection(address))
                    one.sendall(b"GET /long HTTP/1.1\r\nHost: localhost\r\n\r\n")
                yield found.server_state.connections, address

    def test_who_does_not_read_keeps_nobody_out(self, monkeypatch):
        for wait in ("HEADER_SECONDS", "READ_SECONDS"):
            monkeypatch.setattr(server, wait, LIMIT)

        async def crowd():
            async with self.ignored(3) as (connections, address):
                await asyncio.to_thread(wait_until, lambda: sum(one.flow.write_paused for one in [*connections]) == 3)
                reader, writer = await asyncio.open_connection(*address)
                writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
                received = await reader.read()
                writer.close()
                return received

        assert asyncio.run(crowd()).startswith(b"HTTP/1.1 200 OK")

    def test_nor_for_long(self, monkeypatch):
        monkeypatch.setattr(server, "HEADER_SECONDS", LIMIT)
        monkeypatch.setattr(server, "READ_SECONDS", 0.05)

        async def crowd():
            asked = asyncio.Event()
            async with self.ignored(1, asked) as (connections, _):
                await asked.wait()
                await asyncio.to_thread(wait_until, lambda: not connections)

        asyncio.run(crowd())
