"""The guard, before an application that answers everything."""

import asyncio
import contextlib
import json
from datetime import timedelta

import pytest
from starlette.responses import PlainTextResponse

from mercator_design.serve import database
from mercator_design.serve.accounts import audit_rate
from mercator_design.serve.accounts import guard as guard_module
from mercator_design.serve.accounts.accounts import Accounts
from mercator_design.serve.accounts.concurrency import ConcurrencyLimit
from mercator_design.serve.accounts.endpoint import Endpoint
from mercator_design.serve.accounts.guard import Guard, RouteInfo
from mercator_design.serve.accounts.refusals import MAX_BODY, MAX_FORM, Refusal
from mercator_design.serve.accounts.users import LOCAL
from mercator_design.serve.settings import UserLimits
from tests.processes import LIMIT
from tests.serve.asgi import ask, request

JSON = {"content-type": "application/json"}
METHODS = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "X"]
CHANGES = ["POST", "PUT", "PATCH", "DELETE", "TRACE", "X"]
OPEN = Endpoint(host="0.0.0.0", has_tls=True, names=("lab.example.org",))  # noqa: S104 - that is what is tested
PROXIED = Endpoint(is_behind_proxy=True, names=("lab.example.org",))


class Application:
    """Answers with the user and the body; at /events, with a stream that `events` makes."""

    def __init__(self):
        self.asked, self.events = [], None

    async def __call__(self, scope, receive, send):
        self.asked.append((scope["method"], scope["path"]))
        if scope["path"] == "/events":
            await self.events(scope, receive, send)
            return
        body = b""
        while (message := await receive()).get("more_body"):
            body += message["body"]
        body += message.get("body", b"")
        user = scope["state"]["user"]
        await PlainTextResponse(f"{user.name if user else None}:{len(body)}")(scope, receive, send)


@pytest.fixture
def application():
    return Application()


@pytest.fixture(scope="module", autouse=True)
def small_databases():
    """The space that sessions reserve on the disk takes long to write, and does nothing here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(database, "RESERVED_BYTES", 1)
        yield


@pytest.fixture
def accounts(tmp_path, clock):
    (tmp_path / ".service").mkdir()
    found = Accounts(tmp_path, UserLimits(requests=3, streams=2), clock.now, clock)
    yield found
    found.close()


@pytest.fixture
def guard(application, accounts, clock):
    """Makes a guard for an endpoint."""

    def make(endpoint=Endpoint(), **given):  # noqa: B008 - frozen
        route_info = RouteInfo(
            login_page=lambda target: PlainTextResponse(f"login for {target}"),
            assets=frozenset({"/assets/a.css"}),
            is_stream=lambda path: path == "/events",
        )
        return Guard(application, accounts, endpoint, route_info, **{"clock": clock} | given)

    return make


@pytest.fixture
def ana(accounts):
    return {"authorization": f"Bearer {accounts.users.add('ana')}"}


@pytest.fixture
def session(accounts):
    """A browser of bob, who has logged in."""
    holder = accounts.users.verify(accounts.users.add("bob"))
    return {"cookie": f"session={accounts.sessions.begin(holder.token, holder.expires)}"}


def lines(accounts):
    return [json.loads(line) for line in (accounts.users.file.parent / "audit.log").read_text().splitlines()]


class TestWho:
    def test_this_machine_needs_no_login_while_there_are_no_users(self, guard, accounts):
        assert ask(guard(), "GET", "/").text == f"{LOCAL.name}:0"
        accounts.users.add("ana")
        assert ask(guard(), "GET", "/").status == 401
        accounts.users.revoke("ana")
        assert ask(guard(), "GET", "/").status == 401

    @pytest.mark.parametrize("endpoint", [OPEN, PROXIED])
    def test_others_need_a_login_even_without_users(self, guard, endpoint):
        answer = ask(guard(endpoint), "GET", "/", scheme="https", host="lab.example.org")
        assert answer.status == 401

    def test_by_token(self, guard, ana):
        assert ask(guard(), "GET", "/api/v1/jobs", ana).text == "ana:0"
        assert (
            ask(guard(), "GET", "/", {"authorization": ana["authorization"].replace("Bearer", "bEARER")}).status == 200
        )

    def test_by_session(self, guard, session):
        assert ask(guard(), "GET", "/", session).text == "bob:0"

    def test_a_wrong_token_is_not_made_good_by_a_session_or_this_machine(self, guard, session):
        assert ask(guard(), "GET", "/", session | {"authorization": "Bearer x"}).status == 401

    def test_this_machine_with_a_token_that_nobody_has(self, guard):
        assert ask(guard(), "GET", "/", {"authorization": "Bearer x"}).status == 401

    @pytest.mark.parametrize("given", ["", "Bearer", "Bearer ", "Basic YTph", "md_x", "Bearer md_aaaaaaaa_" + "b" * 43])
    def test_what_is_no_token(self, guard, ana, given):
        answer = ask(guard(), "GET", "/api/v1/jobs", {"authorization": given})
        assert answer.status == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert answer.headers["content-type"] == "application/problem+json"
        assert json.loads(answer.text)["status"] == 401

    def test_two_tokens(self, guard, ana, accounts):
        app = guard()

        async def twice(scope, receive, send):
            scope["headers"] *= 2
            scope["headers"] = [one for one in scope["headers"] if one[0] != b"host"] + scope["headers"][:1]
            await app(scope, receive, send)

        assert ask(twice, "GET", "/", ana).status == 401

    def test_an_unknown_session(self, guard, session):
        assert ask(guard(), "GET", "/", {"cookie": "session=x"}).status == 401
        assert ask(guard(), "GET", "/", {"cookie": f"a=b; {session['cookie']}"}).status == 200

    def test_a_session_ends_with_its_token(self, guard, session, accounts):
        accounts.users.revoke("bob")
        assert ask(guard(), "GET", "/", session).status == 401
        accounts.users.add_token("bob")
        assert ask(guard(), "GET", "/", session).status == 401

    def test_sessions_expire(self, guard, session, clock):
        clock.seconds = timedelta(days=7).total_seconds() - 1
        assert ask(guard(), "GET", "/", session).status == 200
        clock.seconds += 1
        assert ask(guard(), "GET", "/", session).status == 401

    def test_the_cookie_over_tls_has_another_name(self, guard, session):
        given = {"scheme": "https", "host": "lab.example.org"}
        assert ask(guard(OPEN), "GET", "/", session, **given).status == 401
        secure = {"cookie": f"__Host-{session['cookie']}"}
        assert ask(guard(OPEN), "GET", "/", secure, **given).status == 200

    def test_a_page_is_answered_with_the_login(self, guard, ana):
        answer = ask(guard(), "GET", "/jobs/a?b=c", {"accept": "text/html"})
        assert (answer.status, answer.text) == (401, "login for /jobs/a?b=c")

    def test_a_part_of_a_page_leads_to_the_login(self, guard, ana):
        answer = ask(guard(), "GET", "/jobs/a", {"accept": "text/html", "hx-request": "true"})
        assert (answer.status, answer.headers["hx-redirect"]) == (401, "/login")

    def test_a_damaged_file_of_users_lets_nobody_in(self, guard, ana, session, accounts, application):
        accounts.users.file.write_text("{")
        for headers in ({}, ana, session):
            assert ask(guard(), "GET", "/", headers).status == 503
        assert ask(guard(), "GET", "/healthz").status == 200
        assert application.asked == [("GET", "/healthz")]

    def test_a_websocket_is_closed(self, guard, application):
        sent = []

        async def send(message):
            sent.append(message)

        asyncio.run(guard()({"type": "websocket", "path": "/"}, None, send))
        assert sent == [{"type": "websocket.close", "code": 1008}]
        assert not application.asked


class TestOpenings:
    @pytest.mark.parametrize(
        ("method", "path"),
        [
            ("GET", "/healthz"),
            ("GET", "/readyz"),
            ("GET", "/login"),
            ("GET", "/assets/a.css"),
            ("GET", "/assets/a.css?v=1"),
        ],
    )
    def test_they_need_no_login(self, guard, ana, method, path):
        assert ask(guard(), method, path).text == "None:0"

    CLOSED = [  # noqa: RUF012
        "/healthz/", "/healthz/..", "//healthz", "/./healthz", "/Healthz", "/healthz%2f..", "/login/", "/login/x",
        "/assets/", "/assets/a.css/", "/assets/b.css", "/assets/../api", "/api/v1/jobs", "/metrics", "/login\x00",
        "/login;x", "http://localhost/login", "", "*", "/api/v1/openapi.json",
    ]  # fmt: skip

    @pytest.mark.parametrize("method", METHODS)
    def test_all_else_does(self, guard, ana, clock, application, method):
        app = guard()
        for path in self.CLOSED:
            clock.seconds += 100
            assert ask(app, method, path, JSON).status == 401, path
        assert not application.asked

    def test_only_their_methods_are_open(self, guard, ana, clock):
        app = guard()
        for path in ("/healthz", "/readyz", "/assets/a.css"):
            for method in set(METHODS) - {"GET"}:
                clock.seconds += 100
                assert ask(app, method, path).status == 401, (method, path)


class TestFailures:
    WRONG = {"authorization": "Bearer md_aaaaaaaa_" + "b" * 43}  # noqa: RUF012

    def test_they_keep_nobody_out(self, guard, ana, session, application):
        app = guard()
        for _ in range(50):
            assert ask(app, "GET", "/", self.WRONG).status == 401
            assert ask(app, "POST", "/api/v1/jobs", JSON).status == 401
        assert ask(app, "GET", "/", ana).status == ask(app, "GET", "/", session).status == 200
        assert application.asked == [("GET", "/")] * 2


class TestHost:
    @pytest.mark.parametrize(
        "host", ["localhost", "localhost:8000", "127.0.0.1:1", "[::1]:8000", "LOCALHOST", "localhost."]
    )
    def test_names_of_this_machine(self, guard, host):
        assert ask(guard(), "GET", "/", host=host).status == 200

    @pytest.mark.parametrize(
        "host",
        [
            "evil.example", "localhost.evil.example", "evil.example:8000", "127.0.0.1.evil.example", "", "localhost:x",
            "a@localhost", "localhost/", "192.0.2.7", "[::1", "localhost:8000:1", "localhost\t", "lab.example.org",
        ],
    )  # fmt: skip
    def test_others_are_refused(self, guard, host, application):
        assert ask(guard(), "GET", "/", host=host).status == 421
        assert ask(guard(), "GET", "/login", host=host).status == 421
        assert not application.asked

    @pytest.mark.parametrize("host", ["lab.example.org", "LAB.example.org:443", "192.0.2.7:8000", "[2001:db8::1]:8000"])
    def test_names_and_addresses_of_an_open_service(self, guard, ana, host):
        assert ask(guard(OPEN), "GET", "/", ana, host=host, scheme="https").status == 200

    @pytest.mark.parametrize("host", ["evil.example", "192.0.2.7"])
    def test_a_proxy_has_its_names_alone(self, guard, ana, host):
        assert ask(guard(PROXIED), "GET", "/", ana, host=host, scheme="https").status == 421

    @pytest.mark.parametrize("number", [0, 2])
    def test_none_or_two(self, guard, number):
        app = guard()

        async def changed(scope, receive, send):
            scope["headers"] = scope["headers"] * number
            await app(scope, receive, send)

        assert ask(changed, "GET", "/").status == 421

    def test_health_is_reported_under_any_name(self, guard):
        assert ask(guard(), "GET", "/healthz", host="10.0.0.7").status == 200


class TestProxies:
    @pytest.mark.parametrize("name", ["X-Forwarded-For", "Forwarded", "Via", "X-Real-IP"])
    def test_a_service_without_users_is_not_for_a_proxy(self, guard, name, accounts):
        assert ask(guard(), "GET", "/", {name: "x"}).status == 403
        token = {"authorization": f"Bearer {accounts.users.add('ana')}"}
        assert ask(guard(), "GET", "/", token | {name: "x"}).status == 200

    def test_only_tls_comes_through_a_proxy(self, guard, ana):
        assert ask(guard(PROXIED), "GET", "/", ana, host="lab.example.org", scheme="http").status == 403
        assert ask(guard(PROXIED), "GET", "/", ana, host="lab.example.org", scheme="https").status == 200


SAME = {"origin": "http://localhost"}
BROWSER = {"user-agent": "Mozilla/5.0"}


class TestOrigin:
    GOOD = [SAME, {"sec-fetch-site": "same-origin"}, {"sec-fetch-site": "same-origin", "origin": "null"}]  # noqa: RUF012
    BAD = [  # noqa: RUF012
        {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "https://localhost"}, {"origin": ""},
        {"origin": "http://localhost:81"}, {"origin": "http://localhost.evil.example"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"}, {"sec-fetch-site": "none"}, {"sec-fetch-site": ""}, BROWSER,
        {"sec-fetch-site": "cross-site", "origin": "http://localhost"},
    ]  # fmt: skip

    @pytest.mark.parametrize("method", CHANGES)
    def test_pages_of_the_service_may_change_things(self, guard, session, method):
        app = guard()
        for headers in self.GOOD:
            assert ask(app, method, "/api/v1/jobs", session | JSON | headers).status == 200, headers

    @pytest.mark.parametrize("method", CHANGES)
    def test_pages_of_others_may_not_in_the_name_of_a_session(self, guard, session, method, application):
        app = guard()
        for headers in [*self.BAD, {}]:
            assert ask(app, method, "/api/v1/jobs", session | JSON | headers).status == 403, headers
        assert not application.asked

    def test_nor_on_this_machine_nor_log_in(self, guard, accounts):
        app = guard()
        for headers in self.BAD:
            assert ask(app, "POST", "/api/v1/jobs", JSON | headers).status == 403, headers
        accounts.users.add("ana")
        for headers in self.BAD:
            assert ask(app, "POST", "/login", headers).status == 403, headers

    def test_programs_on_this_machine_may(self, guard):
        app = guard()
        for headers in [*self.GOOD, {}, {"user-agent": "curl/8"}]:
            assert ask(app, "POST", "/api/v1/jobs", JSON | headers).status == 200, headers

    def test_a_token_is_enough(self, guard, ana):
        assert ask(guard(), "POST", "/api/v1/jobs", ana | JSON | {"origin": "http://elsewhere"}).status == 200

    def test_pages_of_others_may_only_link_here(self, guard):
        link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
        assert ask(guard(), "GET", "/", link).status == 200
        for change in ({"sec-fetch-mode": "no-cors"}, {"sec-fetch-dest": "iframe"}, {"sec-fetch-dest": "image"}):
            assert ask(guard(), "GET", "/", link | change).status == 403


class TestBodies:
    @pytest.mark.parametrize(
        "kind", ["application/json", "application/json; charset=utf-8", "application/merge-patch+json"]
    )
    def test_json(self, guard, kind):
        headers = {"content-type": kind, "content-length": "2"}
        assert ask(guard(), "POST", "/api/v1/jobs", headers, parts=[b"{", b"}"]).text == "local:2"

    @pytest.mark.parametrize(
        "kind",
        [
            "",
            "text/plain",
            "application/x-www-form-urlencoded",
            "multipart/form-data",
            "text/json",
            "application/jsonx",
        ],
    )
    @pytest.mark.parametrize("length", [{"content-length": "2"}, {"transfer-encoding": "chunked"}])
    def test_what_forms_could_send(self, guard, kind, length, application):
        answer = ask(guard(), "POST", "/api/v1/jobs", {"content-type": kind} | length, parts=[b"{}"])
        assert answer.status == 415
        assert answer.headers["connection"] == "close"
        assert not application.asked

    def test_the_login_is_a_form(self, guard):
        form = {"content-type": "application/x-www-form-urlencoded", "content-length": "7"}
        assert ask(guard(), "POST", "/login", form, parts=[b"token=x"]).status == 200
        assert ask(guard(), "POST", "/login", form | JSON, parts=[b"token=x"]).status == 415

    @pytest.mark.parametrize(("path", "most"), [("/api/v1/jobs", MAX_BODY), ("/login", MAX_FORM)])
    @pytest.mark.parametrize("announced", [True, False])
    def test_large_ones_are_refused(self, guard, application, path, most, announced):
        kind = {"content-type": "application/x-www-form-urlencoded" if path == "/login" else "application/json"}

        def sent(size):
            length = {"content-length": str(size)} if announced else {"transfer-encoding": "chunked"}
            parts = [b"x" * (size // 2), b"x" * (size - size // 2)]
            return ask(guard(), "POST", path, kind | length, parts=parts)

        assert sent(most).text == f"local:{most}"
        assert sent(most + 1).status == 413
        assert len(application.asked) == 1

    @pytest.mark.parametrize("length", ["-1", "x", "9" * 30, "1e3", "٣"])
    def test_lengths_that_are_none(self, guard, length):
        scope = JSON | {"content-length": "1"}
        app = guard()

        async def changed(scope, receive, send):
            scope["headers"] = [(k, length.encode() if k == b"content-length" else v) for k, v in scope["headers"]]
            await app(scope, receive, send)

        assert ask(changed, "POST", "/api/v1/jobs", scope).status == 413

    def test_a_slow_one_is_refused(self, guard, clock, application):
        """A byte each ten seconds."""

        def parts():
            while True:
                clock.seconds += 10
                yield b"x"

        class Slow(list):
            def pop(self, _):
                return next(source)

        source, app = parts(), guard(body_seconds=35.0)

        async def slow():
            waiting = Slow([1])

            async def receive():
                return {"type": "http.request", "body": waiting.pop(0), "more_body": True}

            async def replaced(scope, _, send):
                await app(scope, receive, send)

            return await request(replaced, "POST", "/api/v1/jobs", JSON | {"transfer-encoding": "chunked"})

        answer = asyncio.run(slow())
        assert (answer.status, clock.seconds) == (408, 40)
        assert answer.headers["connection"] == "close"
        assert not application.asked

    def test_one_that_does_not_come_is_refused(self, guard, application):
        async def never():
            await asyncio.Event().wait()

        app = guard(body_seconds=0.01)
        headers = JSON | {"content-length": "5"}
        assert ask(app, "POST", "/api/v1/jobs", headers, parts=(), received=never).status == 408
        assert not application.asked

    @pytest.mark.parametrize("method", ["GET", "HEAD", "OPTIONS"])
    @pytest.mark.parametrize("path", ["/healthz", "/login", "/api/v1/jobs"])
    @pytest.mark.parametrize("length", [{"content-length": "1000"}, {"transfer-encoding": "chunked"}])
    def test_one_that_has_no_use_is_refused_at_once(self, guard, ana, method, path, length, application):
        async def never():
            raise AssertionError

        for known in ({}, ana):
            answer = ask(guard(), method, path, known | length, parts=(), received=never)
            assert (answer.status, answer.headers["connection"]) == (413, "close")
        assert not application.asked

    def test_slow_ones_of_a_user_are_limited(self, guard, ana, session, accounts):
        async def run():
            app, waiting = guard(body_seconds=LIMIT), asyncio.Event()

            def slow(headers):
                return request(app, "POST", "/api/v1/jobs", headers | JSON | SAME, parts=(), received=waiting.wait)

            held = [asyncio.create_task(slow(ana | {"content-length": "5"})) for _ in range(3)]
            while accounts.requests.counts["ana"] < 3:  # noqa: ASYNC110 - no event
                await asyncio.sleep(0)
            refused = await slow(ana | {"content-length": "5"})
            assert (refused.status, refused.headers["connection"], refused.headers["retry-after"]) == (
                429,
                "close",
                "5",
            )
            assert "expected at most 3 requests of a user at a time" in refused.text
            assert (await request(app, "GET", "/", session)).status == 200
            assert (await request(app, "GET", "/login")).status == 200
            for one in held:
                one.cancel()
            await asyncio.gather(*held, return_exceptions=True)
            assert (await request(app, "GET", "/", ana)).status == 200

        asyncio.run(run())
        assert not accounts.requests.counts

    def test_those_of_all_users_leave_the_login_free(self, guard, ana, accounts, monkeypatch):
        monkeypatch.setattr(accounts.requests, "_of_all", 0)
        answer = ask(guard(), "GET", "/", ana)
        assert (answer.status, answer.headers["retry-after"]) == (503, "5")
        for path in ("/healthz", "/login"):
            assert ask(guard(), "GET", path).status == 200

    def test_a_few_users_do_not_take_all(self):
        limit, taken = ConcurrencyLimit("requests", 4, 8), contextlib.ExitStack()
        with taken:
            for name in ("ann", "bob") * 4:
                with contextlib.suppress(Refusal):
                    taken.enter_context(limit.count(name))
            assert limit.counts == {"ann": 3, "bob": 3}
            with pytest.raises(Refusal, match="of all users, at most 8") as found, limit.count("ann"):
                pass
            assert (found.value.status, found.value.headers) == (503, {"Retry-After": "5"})
            with limit.count("carl"):
                pass
        assert not limit.counts

    def test_a_client_that_goes_gets_no_answer(self, guard, application):
        answer = ask(guard(), "POST", "/api/v1/jobs", JSON | {"content-length": "5"}, parts=())
        assert (answer.status, application.asked) == (0, [])

    def test_nobody_reads_the_body_of_a_stranger(self, guard, ana):
        async def never():
            raise AssertionError

        headers = JSON | {"content-length": "5"}
        answer = ask(guard(), "POST", "/api/v1/jobs", headers, parts=(), received=never)
        assert (answer.status, answer.headers["connection"]) == (401, "close")

    def test_headers_and_addresses_are_limited(self, guard, application):
        assert ask(guard(), "GET", "/", {f"a{number}": "b" for number in range(100)}).status == 431
        assert ask(guard(), "GET", "/", {"a": "b" * 17_000}).status == 431
        assert ask(guard(), "GET", "/" + "a" * 5000).status == 414
        assert ask(guard(), "GET", "/?" + "a" * 5000).status == 414
        assert not application.asked


class TestHeaders:
    def test_every_answer_has_them(self, guard, ana):
        for path, headers in (("/", ana), ("/", {}), ("/healthz", {}), ("/login", {}), ("/" + "a" * 5000, {})):
            found = ask(guard(), "GET", path, headers).headers
            assert found["x-content-type-options"] == "nosniff"
            assert found["referrer-policy"] == "same-origin"
            assert found["x-frame-options"] == "SAMEORIGIN"
            assert found["content-security-policy"].startswith("default-src 'none'; frame-ancestors 'none'")
            assert found["cross-origin-opener-policy"] == "same-origin"
            assert found["cross-origin-resource-policy"] == "same-origin"
            assert found["cache-control"] == "no-store"
            assert "strict-transport-security" not in found

    def test_tls_is_remembered(self, guard, ana):
        found = ask(guard(OPEN), "GET", "/", ana, scheme="https", host="lab.example.org").headers
        assert found["strict-transport-security"] == "max-age=31536000"

    def test_those_of_the_application_stay(self, guard, application):
        async def page(scope, receive, send):
            headers = {"Content-Security-Policy": "sandbox", "Cache-Control": "public"}
            await PlainTextResponse("", headers=headers)(scope, receive, send)

        application.events = page
        found = ask(guard(), "GET", "/events").headers
        assert found["content-security-policy"] == "sandbox"
        assert found["cache-control"] == "public"
        assert "cross-origin-opener-policy" not in found  # browsers would show no page with both


def stream(parts):
    """An application that sends parts of a stream, and before each waits for `parts` to give it."""

    async def answer(scope, receive, send):
        headers = [(b"content-type", b"text/event-stream")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        gone = asyncio.ensure_future(receive())
        while not gone.done():
            part = asyncio.ensure_future(parts.get())
            await asyncio.wait((part, gone), return_when=asyncio.FIRST_COMPLETED)
            if not part.done() or not part.result():
                break
            await send({"type": "http.response.body", "body": part.result(), "more_body": True})
        part.cancel()
        gone.cancel()

    return answer


class TestStreams:
    def watching(self, guard, application, headers, steps):
        """Follow a stream while `steps(answer, parts)` runs."""

        async def watch():
            parts, got = asyncio.Queue(), []
            application.events = stream(parts)
            app = guard()

            async def send(message):
                got.append(message)

            async def receive():
                await asyncio.Event().wait()

            async def follow(headers):
                from tests.serve.asgi import scope_of

                await app(scope_of("GET", "/events", headers), receive, send)

            task = asyncio.create_task(follow(headers))
            try:
                await asyncio.wait_for(steps(app, parts, got), LIMIT)
                await parts.put(b"")
                await asyncio.wait_for(task, LIMIT)
            finally:
                task.cancel()
            return got

        return asyncio.run(watch())

    @staticmethod
    async def until(condition):
        while not condition():  # noqa: ASYNC110 - what it looks at is no event
            await asyncio.sleep(0)

    def test_each_part_passes_at_once(self, guard, application, ana):
        async def steps(app, parts, got):
            for number in range(3):
                await parts.put(b"%d" % number)
                await self.until(lambda number=number: got and got[-1].get("body") == b"%d" % number)

        self.watching(guard, application, ana, steps)

    def test_a_user_has_a_limited_number(self, guard, application, ana, session, accounts):
        async def steps(app, parts, got):
            await self.until(lambda: got)
            second = asyncio.create_task(request(app, "GET", "/events", ana, received=asyncio.Event().wait))
            await self.until(lambda: accounts.streams.counts["ana"] == 2)
            refused = await request(app, "GET", "/events", ana)
            assert (refused.status, refused.headers["retry-after"]) == (429, "5")
            assert "expected at most 2 event streams of a user at a time" in refused.text
            assert (await request(app, "GET", "/", ana)).status == 200
            third = asyncio.create_task(request(app, "GET", "/events", session, received=asyncio.Event().wait))
            await self.until(lambda: accounts.streams.counts["bob"] == 1)
            for task in (second, third):
                task.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await task

        self.watching(guard, application, ana, steps)
        assert not accounts.streams.counts

    @pytest.mark.parametrize("is_silent", [True, False])
    @pytest.mark.parametrize("way", ["token", "session", "logout", "local", "service"])
    def test_it_ends_with_the_login(self, guard, application, request, accounts, way, is_silent, monkeypatch):
        monkeypatch.setattr(guard_module, "CHECK_SECONDS", 0.001 if is_silent else LIMIT)
        if way in ("local", "service"):
            headers = {}
        else:
            headers = request.getfixturevalue("ana" if way == "token" else "session")
            secret = headers.get("cookie", "=").split("=")[1]

        async def steps(app, parts, got):
            await parts.put(b"first")
            await self.until(lambda: got and got[-1].get("body") == b"first")
            if way == "service":
                accounts.end_streams()
                await self.until(lambda: len(got) == 3)
            elif way == "local":
                accounts.users.add("ana")
            elif way == "logout":
                accounts.sessions.end(secret)
            else:
                accounts.users.revoke("ana" if way == "token" else "bob")
            if not is_silent:
                await parts.put(b"second")
            await self.until(lambda: len(got) == 3)

        *_, last = self.watching(guard, application, headers, steps)
        assert last == {"type": "http.response.body", "body": b""}
        assert not accounts.streams.counts


class TestAudit:
    def test_changes_and_failures_are_noted(self, guard, ana, accounts):
        app = guard()
        ask(app, "GET", "/", ana)
        ask(app, "POST", "/api/v1/jobs/a-b/pause", ana | JSON)
        ask(app, "GET", "/", {"authorization": "Bearer md_x"}, client="2001:db8::1")
        ask(app, "DELETE", "/jobs/x")
        assert [
            {key: line[key] for key in ("user", "address", "what", "job", "answer")} for line in lines(accounts)
        ] == [
            {"user": "ana", "address": "192.0.2.1", "what": "POST /api/v1/jobs/a-b/pause", "job": "a-b", "answer": 200},
            {"user": "", "address": "2001:db8::1", "what": "GET /", "job": "", "answer": 401},
            {"user": "", "address": "192.0.2.1", "what": "DELETE /jobs/x", "job": "x", "answer": 401},
        ]
        assert lines(accounts)[0]["time"] == "2030-01-01T00:00:00.000+00:00"

    @pytest.mark.parametrize(
        "sent",
        [
            ("POST", "/x", {}, {"host": "evil.example"}),
            ("POST", "/x", {"sec-fetch-site": "cross-site"}, {}),
            ("POST", "/x", JSON, {}),
            ("GET", "/", {"authorization": "Bearer md_x"}, {}),
            ("POST", "/login", {"content-type": "application/x-www-form-urlencoded"}, {}),
            ("POST", "/login", {"content-type": "application/x-www-form-urlencoded"}, {"parts": ()}),
        ],
        ids=["host", "site", "unknown", "token", "login", "gone"],
    )
    def test_strangers_do_not_fill_it(self, guard, accounts, ana, session, clock, sent):
        app, (method, path, headers, given) = guard(), sent
        for _ in range(3 * audit_rate.MAX_LINES):
            ask(app, method, path, headers, **given)
        assert len(lines(accounts)) == audit_rate.MAX_LINES
        ask(app, method, path, headers, **given, client="192.0.2.2")
        clock.seconds += audit_rate.PERIOD
        ask(app, method, path, headers, **given)
        assert len(lines(accounts)) == audit_rate.MAX_LINES + 2
        for _ in range(2 * audit_rate.MAX_LINES):
            ask(app, "POST", "/x", session)  # known, although refused
        assert [line["user"] for line in lines(accounts)[audit_rate.MAX_LINES + 2 :]] == [
            "bob"
        ] * 2 * audit_rate.MAX_LINES

    def test_addresses_are_forgotten(self, accounts, monkeypatch):
        monkeypatch.setattr(audit_rate, "MAX_ADDRESSES", 3)
        for number in range(10):
            accounts.audit_rate.is_exceeded(f"192.0.2.{number}")
        assert len(accounts.audit_rate._found) == 3

    def test_no_secret_is_in_any_file_or_message(self, guard, accounts, caplog, capfd):
        token = accounts.users.add("ana")
        app, headers = guard(), {"authorization": f"Bearer {token}", "cookie": f"session={token}"}
        ask(app, "POST", f"/api/v1/jobs?token={token}", headers | JSON)
        ask(app, "POST", f"/api/v1/jobs?token={token}", {"authorization": f"Bearer {token}x"} | JSON)
        holder = accounts.users.verify(token)
        secret = accounts.sessions.begin(holder.token, holder.expires)
        texts = [path.read_bytes().decode("latin-1") for path in accounts.users.file.parent.iterdir()]
        for text in [*texts, caplog.text, *capfd.readouterr()]:
            assert token[12:] not in text
            assert secret not in text
        assert lines(accounts)
