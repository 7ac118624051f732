"""The server on a socket: whom it waits for, how long, and whom it closes when too many wait."""

import asyncio
import contextlib
import socket
import ssl
import threading

import pytest
from anyio import to_thread
from starlette.concurrency import run_in_threadpool
from starlette.responses import PlainTextResponse

from mercator_design.serve.accounts.endpoint import tls_of
from mercator_design.serve.http import connections
from mercator_design.serve.http.connections import WaitingConnections
from mercator_design.serve.http.server import Server, listening
from tests.processes import LIMIT, wait_until
from tests.tiers import some

HOST = b"Host: localhost\r\n"
ASK = b"GET / HTTP/1.1\r\n" + HOST + b"\r\n"
POST = b"POST / HTTP/1.1\r\n" + HOST
LONG = b"x" * 50_000_000  # more than all buffers between server and client have
SLOW = {
    "nothing": b"",
    "headers": b"GET / HTTP/1.1\r\nX-Slow: ",
    "body": POST + b"Content-Length: 1000\r\n\r\nx",
    "chunks": POST + b"Transfer-Encoding: chunked\r\n\r\n1\r\nx\r\n",
    "expectation": POST + b"Content-Length: 1000\r\nExpect: 100-continue\r\n\r\n",
    "idle": ASK,
    "unread": b"GET /long HTTP/1.1\r\n" + HOST + b"\r\n",
    "unread end": b"GET /long HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n",
}
"""What clients send that are then waited for."""


async def application(scope, receive, send):
    while (message := await receive())["type"] == "http.request" and message["more_body"]:
        pass
    if message["type"] == "http.request":
        await PlainTextResponse(LONG if scope["path"] == "/long" else b"hello")(scope, receive, send)


@pytest.fixture
def patient(monkeypatch):
    """Nothing is late."""
    for name in ("REQUEST_SECONDS", "READ_SECONDS"):
        monkeypatch.setattr(connections, name, LIMIT)


@contextlib.asynccontextmanager
async def running(waiting=None, *, tls=None, app=application):
    """The address of a server, and the connections that wait."""
    waiting = WaitingConnections() if waiting is None else waiting
    with listening("127.0.0.1", 0) as listener:
        found = Server(app, waiting, tls)
        found.capture_signals = contextlib.nullcontext
        found.config.lifespan = "off"
        found.config.timeout_keep_alive = LIMIT
        found.config.log_level = "critical"
        task = asyncio.create_task(found.serve([listener]))
        yield listener.getsockname(), waiting
        found.should_exit = found.force_exit = True
        await task


async def answer(address, data=ASK, *, source="127.0.0.1", **given):
    """What the server sends until it ends the connection."""
    reader, writer = await asyncio.open_connection(*address, local_addr=(source, 0), **given)
    writer.write(data)
    received = b""
    with contextlib.suppress(ConnectionError):
        while part := await reader.read(65536):
            received += part
    writer.close()
    return received


CLOSING = ASK.replace(HOST, HOST + b"Connection: close\r\n")


class TestTime:
    """Waits for what does not come are short here, and nothing is asserted on them."""

    @pytest.mark.parametrize("kind", ["nothing", "headers"])
    def test_it_does_not_wait_for_a_request_for_ever(self, monkeypatch, kind):
        monkeypatch.setattr(connections, "REQUEST_SECONDS", 0.05)

        async def run():
            async with running() as (address, _):
                return await answer(address, SLOW[kind])

        assert asyncio.run(run()) == b""

    def test_nor_for_the_second_request(self, monkeypatch):
        monkeypatch.setattr(connections, "REQUEST_SECONDS", LIMIT)

        async def app(scope, receive, send):
            monkeypatch.setattr(connections, "REQUEST_SECONDS", 0.05)
            await PlainTextResponse("hello")(scope, receive, send)

        async def run():
            async with running(app=app) as (address, _):
                return await answer(address)

        found = asyncio.run(run())
        assert found.startswith(b"HTTP/1.1 200 OK")
        assert found.endswith(b"hello")

    @pytest.mark.parametrize("kind", ["unread", "unread end"])
    def test_nor_for_a_client_to_read(self, monkeypatch, kind):
        monkeypatch.setattr(connections, "REQUEST_SECONDS", LIMIT)
        monkeypatch.setattr(connections, "READ_SECONDS", 0.05)

        async def run():
            async with running() as (address, waiting):
                with socket.create_connection(address) as client:
                    client.sendall(SLOW[kind])
                    await asyncio.to_thread(client.recv, 1)
                    await asyncio.to_thread(wait_until, lambda: not waiting)

        asyncio.run(run())

    def test_nor_for_the_rest_of_an_answer_that_ends_the_connection(self, monkeypatch):
        """It is short enough for the buffer of the server, so nothing pauses."""
        monkeypatch.setattr(connections, "REQUEST_SECONDS", 0.05)
        monkeypatch.setattr(connections, "READ_SECONDS", LIMIT)

        async def app(scope, receive, send):
            await PlainTextResponse(b"x" * 60_000)(scope, receive, send)

        async def run():
            waiting = WaitingConnections()
            async with running(waiting, app=app) as (address, _):
                with socket.socket() as client:
                    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
                    client.connect(address)
                    client.sendall(CLOSING)
                    await asyncio.to_thread(client.recv, 1)
                    await asyncio.to_thread(wait_until, lambda: not waiting)

        asyncio.run(run())


class TestNumber:
    @pytest.mark.swept
    @pytest.mark.parametrize("kind", some(SLOW, 2))
    def test_slow_clients_keep_nobody_out(self, patient, kind):
        """Neither others at their address, nor at another one."""

        async def run():
            async with running(WaitingConnections(6, 4)) as (address, waiting):
                with contextlib.ExitStack() as opened:
                    for n in range(8):
                        client = opened.enter_context(
                            socket.create_connection(address, source_address=("127.0.0.2", 0))
                        )
                        client.sendall(SLOW[kind])
                        await asyncio.to_thread(wait_until, lambda n=n: len(waiting) == min(n + 1, 4))
                    found = [await answer(address, CLOSING, source=one) for one in ("127.0.0.2", "127.0.0.3")]
                    assert len(waiting) <= 4
                    return found

        for found in asyncio.run(run()):
            assert found.startswith(b"HTTP/1.1 200 OK")

    def test_the_one_that_has_waited_longest_is_closed(self, patient):
        async def run():
            async with running(WaitingConnections(100, 3)) as (address, waiting):
                first, second = [await asyncio.open_connection(*address) for _ in range(2)]
                await self.until(lambda: len(waiting) == 2)
                first[1].write(ASK)  # now the second has waited longer
                await first[0].readuntil(b"hello")
                others = [await asyncio.open_connection(*address) for _ in range(2)]
                assert await second[0].read() == b""
                first[1].write(CLOSING)
                assert (await first[0].read()).endswith(b"hello")
                for _, writer in (first, second, *others):
                    writer.close()

        asyncio.run(run())

    def test_bytes_of_a_body_do_not_make_a_wait_shorter(self, patient):
        async def run():
            async with running(WaitingConnections(100, 2)) as (address, waiting):
                slow, other = [await asyncio.open_connection(*address) for _ in range(2)]
                slow[1].write(SLOW["body"])
                await self.until(lambda: sorted(self.awaited(waiting)) == ["body", "request"])
                other[1].write(SLOW["body"])
                await self.until(lambda: self.awaited(waiting) == ["body", "body"])
                slow[1].write(b"x")
                third = await asyncio.open_connection(*address)
                assert await slow[0].read() == b""
                for _, writer in (slow, other, third):
                    writer.close()

        asyncio.run(run())

    def test_the_address_with_the_most_loses_one(self, patient):
        async def run():
            async with running(WaitingConnections(4, 4)) as (address, waiting):
                few = await asyncio.open_connection(*address, local_addr=("127.0.0.2", 0))
                await self.until(lambda: len(waiting) == 1)
                many = []
                for n in range(5):
                    many.append(await asyncio.open_connection(*address, local_addr=("127.0.0.3", 0)))
                    await self.until(lambda n=n: len(waiting) == min(4, n + 2))
                assert [await reader.read() for reader, _ in many[:2]] == [b"", b""]
                few[1].write(CLOSING)
                assert (await few[0].read()).endswith(b"hello")
                for _, writer in (few, *many):
                    writer.close()

        asyncio.run(run())

    def test_a_proxy_has_the_connections_of_many(self, patient):
        async def run():
            waiting = WaitingConnections(6, 2, lambda address: address == "127.0.0.1")
            async with running(waiting) as (address, _):
                opened = [await asyncio.open_connection(*address) for _ in range(5)]
                await self.until(lambda: len(waiting) == 5)
                for _, writer in opened:
                    writer.close()

        asyncio.run(run())

    def test_addresses_of_a_network_count_together(self):
        waiting = WaitingConnections()
        assert (
            waiting.group_of("2001:db8::1") == waiting.group_of("2001:db8::ffff") != waiting.group_of("2001:db8:1::1")
        )
        assert waiting.group_of("::ffff:192.0.2.1") == waiting.group_of("192.0.2.1") != waiting.group_of("192.0.2.2")

    def test_who_is_answered_does_not_wait(self, patient):
        """A long answer, such as an event stream, is not closed for others."""
        started, ended = asyncio.Event(), asyncio.Event()

        async def app(scope, receive, send):
            if scope["path"] != "/long":
                await application(scope, receive, send)
                return
            started.set()
            await ended.wait()
            await PlainTextResponse("end")(scope, receive, send)

        async def run():
            async with running(WaitingConnections(2, 2), app=app) as (address, waiting):
                reader, writer = await asyncio.open_connection(*address)
                writer.write(SLOW["unread end"])
                await started.wait()
                assert not waiting
                others = [await asyncio.open_connection(*address) for _ in range(4)]
                await self.until(lambda: len(waiting) == 2)
                ended.set()
                assert (await reader.read()).endswith(b"end")
                for one in (writer, *(writer for _, writer in others)):
                    one.close()

        asyncio.run(run())

    def test_who_pipelines_gets_one_answer(self, patient):
        async def run():
            async with running() as (address, _):
                return await answer(address, ASK * 50)

        assert asyncio.run(run()).count(b"HTTP/1.1 200 OK") <= 1

    @staticmethod
    async def until(condition):
        await asyncio.to_thread(wait_until, condition)

    @staticmethod
    def awaited(waiting):
        return [one._awaited for group in [*waiting._groups.values()] for one in [*group]]


class TestTls:
    @pytest.fixture
    def trusting(self, certificate):
        found = ssl.create_default_context(cafile=certificate[0])
        return {"ssl": found, "server_hostname": "localhost"}

    def test_handshakes_that_do_not_come_keep_nobody_out(self, patient, certificate, trusting):
        async def run():
            async with running(WaitingConnections(3, 3), tls=tls_of(*certificate)) as (address, waiting):
                with contextlib.ExitStack() as opened:
                    for n in range(6):
                        opened.enter_context(socket.create_connection(address))
                        await asyncio.to_thread(wait_until, lambda n=n: len(waiting) == min(n + 1, 3))
                    found = await answer(address, CLOSING, **trusting)
                    assert len(waiting) <= 3
                return found

        assert asyncio.run(run()).endswith(b"hello")

    def test_they_are_not_waited_for_for_ever(self, monkeypatch, certificate):
        monkeypatch.setattr(connections, "REQUEST_SECONDS", 0.05)

        async def run():
            async with running(tls=tls_of(*certificate)) as (address, waiting):
                assert await answer(address, b"") == b""
                assert not waiting

        asyncio.run(run())

    @pytest.mark.parametrize("data", [b"\x16\x03\x01", ASK, b"\x00" * 50], ids=["begun", "http", "zeros"])
    def test_what_is_no_handshake_leaves_nothing(self, patient, certificate, data):
        async def run():
            async with running(tls=tls_of(*certificate)) as (address, waiting):
                reader, writer = await asyncio.open_connection(*address)
                writer.write(data)
                writer.write_eof()
                with contextlib.suppress(ConnectionError):
                    await reader.read()
                writer.close()
                await asyncio.to_thread(wait_until, lambda: not waiting)

        asyncio.run(run())

    def test_many_requests_over_one_connection(self, patient, certificate, trusting):
        async def run():
            async with running(tls=tls_of(*certificate)) as (address, _):
                reader, writer = await asyncio.open_connection(*address, **trusting)
                for _ in range(5):
                    writer.write(ASK)
                    assert (await reader.readuntil(b"hello")).startswith(b"HTTP/1.1 200 OK")
                writer.write(b"GET /long HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n")
                assert (await reader.read()).endswith(LONG[:1000])
                writer.close()

        asyncio.run(run())


def test_requests_that_wait_for_a_worker_leave_threads_to_others():
    go = threading.Event()

    async def app(scope, receive, send):
        text = "hello" if scope["path"] == "/" else await run_in_threadpool(lambda: go.wait(LIMIT) and "waited")
        await run_in_threadpool(int)
        await PlainTextResponse(text)(scope, receive, send)

    async def run():
        async with running(app=app) as (address, _):
            waiting = [asyncio.create_task(answer(address, CLOSING.replace(b"/", b"/wait", 1))) for _ in range(60)]
            async with asyncio.timeout(LIMIT):
                while to_thread.current_default_thread_limiter().borrowed_tokens < 60:  # noqa: ASYNC110 - no event
                    await asyncio.sleep(0.001)
            assert (await answer(address, CLOSING)).endswith(b"hello")
            go.set()
            return await asyncio.gather(*waiting)

    try:
        assert all(one.endswith(b"waited") for one in asyncio.run(run()))
    finally:
        go.set()
