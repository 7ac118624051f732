"""Sessions of browsers, from the login page to the logout."""

import sqlite3
import stat
from datetime import timedelta
from types import SimpleNamespace

import pytest
from starlette.testclient import TestClient

from mercator_design.serve.accounts import sessions
from mercator_design.serve.accounts.endpoint import Endpoint
from mercator_design.serve.accounts.sessions import Sessions
from mercator_design.serve.app import guarded
from mercator_design.serve.service import Service

pytestmark = pytest.mark.together

FORM = {"origin": "http://localhost", "user-agent": "Mozilla/5.0", "accept": "text/html"}


@pytest.fixture(scope="module")
def lab(tmp_path_factory, idle_races):
    with Service(tmp_path_factory.mktemp("lab") / "runs") as service:
        yield SimpleNamespace(service=service, app=guarded(service), ana=service.accounts.users.add("ana"))


@pytest.fixture
def browser(lab):
    """A browser with cookies of its own."""
    with TestClient(lab.app, base_url="http://localhost", follow_redirects=False, headers=FORM) as client:
        yield client


def test_from_the_login_to_the_logout(lab, browser):
    first = browser.get("/jobs?state=queued")
    assert first.status_code == 401
    assert 'name="to" value="/jobs?state=queued"' in first.text
    assert '<label for="token">' in first.text
    answer = browser.post("/login", data={"token": f" {lab.ana} ", "to": "/jobs?state=queued"})
    assert (answer.status_code, answer.headers["location"]) == (303, "/jobs?state=queued")
    page = browser.get("/")
    assert page.status_code == 200
    assert ">ana</span>" in page.text
    assert '<form method="post" action="/logout">' in page.text
    assert browser.get("/login").headers["location"] == "/"
    cookie = dict(browser.cookies)
    out = browser.post("/logout")
    assert (out.status_code, out.headers["location"]) == (303, "/login")
    assert not browser.cookies
    assert browser.get("/").status_code == 401
    browser.cookies.update(cookie)
    assert browser.get("/").status_code == 401


def test_the_cookie_is_for_the_service_alone(lab, browser):
    given = browser.post("/login", data={"token": lab.ana}).headers["set-cookie"]
    name, *flags = given.split("; ")
    assert name.startswith("session=")
    assert {flag.lower() for flag in flags} == {"httponly", "max-age=604800", "path=/", "samesite=strict"}


def test_over_tls_the_cookie_is_secure(lab):
    app = guarded(lab.service, Endpoint(host="192.0.2.1", has_tls=True, names=("lab.example.org",)))
    with TestClient(app, base_url="https://lab.example.org", follow_redirects=False) as browser:
        answer = browser.post("/login", data={"token": lab.ana}, headers={"origin": "https://lab.example.org"})
        name, *flags = answer.headers["set-cookie"].split("; ")
        assert name.startswith("__Host-session=")
        assert {flag.lower() for flag in flags} == {"httponly", "max-age=604800", "path=/", "samesite=strict", "secure"}
        assert answer.headers["strict-transport-security"]
        assert browser.get("/api/v1/jobs").status_code == 200
        out = browser.post("/logout", headers={"origin": "https://lab.example.org"})
        assert "secure" in out.headers["set-cookie"].lower()
        assert browser.get("/api/v1/jobs").status_code == 401


def test_behind_a_proxy_only_its_headers_count(lab):
    endpoint = Endpoint(is_behind_proxy=True, names=("lab.example.org",), proxies=("10.0.0.0/8",))
    forwarded = {"x-forwarded-proto": "https", "x-forwarded-for": "192.0.2.9"}
    for peer, expected in (("10.0.0.3", 303), ("192.0.2.3", 403)):
        app = guarded(lab.service, endpoint)
        with TestClient(
            app, base_url="http://lab.example.org", follow_redirects=False, headers=forwarded, client=(peer, 1)
        ) as browser:
            headers = {"origin": "https://lab.example.org"}
            answer = browser.post("/login", data={"token": lab.ana}, headers=headers)
            assert answer.status_code == expected
            assert ("set-cookie" in answer.headers) == (expected == 303)
    last = (lab.service.data / ".service" / "audit.log").read_text().splitlines()[-2:]
    assert ['"192.0.2.9"' in line for line in last] == [True, False]


@pytest.mark.parametrize("token", ["", "md_x", "md_aaaaaaaa_" + "b" * 43, "\x00", "é" * 50, "<script>"])
def test_wrong_tokens(lab, browser, token):
    answer = browser.post("/login", data={"token": token, "to": "/jobs"})
    assert answer.status_code == 401
    assert 'role="alert"' in answer.text
    assert 'value="/jobs"' in answer.text
    assert "set-cookie" not in answer.headers
    assert "<script>" not in answer.text
    assert token not in answer.text or not token


@pytest.mark.parametrize(
    "body", [b"", b"token", b"token=%ff%fe", b"token=a&token=b", b"\xff", b"&" * 100, b"a=b&" * 50]
)
def test_odd_forms(lab, browser, body):
    headers = {"content-type": "application/x-www-form-urlencoded"}
    assert browser.post("/login", content=body, headers=headers).status_code in (401, 422)


@pytest.mark.parametrize(
    "target",
    [
        "https://evil.example", "//evil.example", "/\\evil.example", "\\\\evil.example", "javascript:alert(1)", "evil",
        "/a\r\nX: y", "/\tb", "", "/login", "/logout", "///evil.example", "/" + "a" * 3000, "/é", "http:/evil",
    ],
)  # fmt: skip
def test_the_login_leads_to_no_other_place(lab, browser, target):
    assert browser.post("/login", data={"token": lab.ana, "to": target}).headers["location"] == "/"


def test_the_secret_is_another_at_each_login_and_the_one_before_ends(lab, browser):
    browser.post("/login", data={"token": lab.ana})
    first = browser.cookies["session"]
    browser.post("/login", data={"token": lab.ana})
    assert browser.cookies["session"] != first
    assert lab.service.accounts.sessions.token(first) is None


def test_a_session_that_a_stranger_has_chosen_is_none(lab, browser):
    browser.cookies["session"] = "chosen"
    assert browser.get("/").status_code == 401
    browser.post("/login", data={"token": lab.ana})
    assert lab.service.accounts.sessions.token("chosen") is None


def test_mistyped_tokens_keep_nobody_out(lab, browser):
    for _ in range(30):
        assert browser.post("/login", data={"token": "x"}).status_code == 401
    assert browser.post("/login", data={"token": lab.ana}).status_code == 303


def test_pages_of_others_cannot_log_in_or_out(lab, browser):
    evil = {"origin": "http://evil.example"}
    assert browser.post("/login", data={"token": lab.ana}, headers=evil).status_code == 403
    browser.post("/login", data={"token": lab.ana})
    assert browser.post("/logout", headers=evil).status_code == 403
    assert browser.get("/").status_code == 200


def test_the_session_is_in_the_file_as_a_hash_only(lab, browser):
    browser.post("/login", data={"token": lab.ana})
    secret = browser.cookies["session"]
    folder = lab.service.data / ".service"
    for file in folder.iterdir():
        if file.is_file():
            assert secret.encode() not in file.read_bytes()
            assert stat.S_IMODE(file.stat().st_mode) & 0o077 == 0 or file.name.startswith("index"), file


def test_a_service_that_is_started_again_keeps_sessions(tmp_path, idle_races):
    data = tmp_path / "runs"
    with Service(data) as service:
        token = service.accounts.users.add("ana")
        with TestClient(guarded(service), base_url="http://localhost", headers=FORM) as browser:
            browser.post("/login", data={"token": token})
            cookies = dict(browser.cookies)
    with (
        Service(data) as service,
        TestClient(guarded(service), base_url="http://localhost", cookies=cookies) as browser,
    ):
        assert browser.get("/api/v1/jobs").status_code == 200
        service.accounts.users.revoke("ana")
        assert browser.get("/api/v1/jobs").status_code == 401


class TestSessions:
    @pytest.fixture
    def made(self, tmp_path, clock):
        found = Sessions(tmp_path / "s.sqlite", clock.now)
        yield found
        found.close()

    def test_they_end_with_the_token(self, made, clock):
        secret = made.begin("id", clock.now() + timedelta(hours=1))
        clock.seconds = 3599
        assert made.token(secret) == "id"
        clock.seconds = 3600
        assert made.token(secret) is None

    def test_old_ones_are_removed(self, made, clock, monkeypatch):
        monkeypatch.setattr(sessions, "MAX_SESSIONS", 3)
        until = clock.now() + timedelta(days=300)
        secrets = []
        for _ in range(5):
            clock.seconds += 1
            secrets.append(made.begin("id", until))
        other = made.begin("other", until)
        assert [made.token(one) is not None for one in (*secrets, other)] == [False, False, True, True, True, True]
        clock.seconds += 8 * 86_400
        made.begin("other", until)
        assert made._db.execute("SELECT count(*) FROM sessions").fetchone() == (1,)

    def test_the_file_is_for_its_owner_alone(self, made, tmp_path):
        made.begin("id", made._now() + timedelta(days=1))
        assert {stat.S_IMODE(file.stat().st_mode) for file in tmp_path.iterdir()} == {0o600}

    def test_a_damaged_file_is_made_again(self, tmp_path, clock):
        (tmp_path / "s.sqlite").write_bytes(b"damaged" * 1000)
        found = Sessions(tmp_path / "s.sqlite", clock.now)
        assert found.token("x") is None
        found.close()

    def test_a_file_that_cannot_be_read_lets_nobody_in(self, made):
        made.close()
        with pytest.raises(sqlite3.Error):
            made.token("x")
