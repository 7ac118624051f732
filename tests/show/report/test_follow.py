"""The page that follows a race: who gets it, what it shows, and when it ends."""

import fcntl
import http.client
import json
import os
import shutil
import threading

import pytest

from mercator_design.cli.races.reporting import latest_report
from mercator_design.errors import RaceError
from mercator_design.race.session.journal import Journal
from mercator_design.show.report import follow, page
from mercator_design.show.report.follow import HOST, FollowServer
from tests.processes import LIMIT

pytestmark = pytest.mark.together


@pytest.fixture(scope="module")
def raced(tmp_path_factory, mdesign_once):
    folder = tmp_path_factory.mktemp("follow") / "race"
    short = ("--method", "irace", "--set", "robots=2", "--set", "duration=3")
    mdesign_once("race", "aggregation", "--budget", 100, *short, "-j", 2, "-o", folder)
    return folder


@pytest.fixture
def folder(raced, tmp_path, monkeypatch):
    shutil.copytree(raced, tmp_path / "r")
    monkeypatch.setattr(page, "request", lambda facts: "")
    monkeypatch.setattr(follow, "POLL", 0.02)
    monkeypatch.setattr(follow, "FAREWELL", LIMIT)
    return tmp_path / "r"


@pytest.fixture
def running(folder):
    """The race as if a process ran it."""
    with Journal(folder / "journal.jsonl", new=False) as journal:
        yield journal


@pytest.fixture
def server(folder, running):
    with FollowServer(folder, lambda: "the whole report") as follower:
        thread = threading.Thread(target=follower.serve)
        thread.start()
        yield follower
        follower._is_sent = True
        thread.join()


def ask(server, path="/", method="GET", host=None):
    """Status, headers and body of an answer."""
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=LIMIT)
    try:
        connection.request(method, path, headers={"Host": host or f"{HOST}:{server.server_port}"})
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read().decode()
    finally:
        connection.close()


class TestAnswers:
    def test_the_page_asks_for_nothing_but_its_live_part(self, server):
        status, headers, text = ask(server)
        assert status == 200
        assert headers["Content-Type"] == "text/html; charset=utf-8"
        assert headers["X-Frame-Options"] == "DENY"
        assert "default-src 'none'" in text
        assert "connect-src 'self'" in text
        assert '<div id="live">' in text

    def test_the_live_part_is_that_of_the_journal(self, server):
        status, _, text = ask(server, "/live")
        told = json.loads(text)
        assert (status, told["ended"]) == (200, False)
        assert "100 of 100 experiments" in told["html"]
        assert told["seconds"] >= follow.SECONDS

    @pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "localhost", "0.0.0.0:1"])
    def test_other_hosts_are_refused(self, server, host):
        for path in ("/", "/live"):
            assert ask(server, path, host=host)[0] == 421

    def test_this_one_has_two_names(self, server):
        assert ask(server, host=f"localhost:{server.server_port}")[0] == 200
        assert server.server_address[0] == HOST

    @pytest.mark.parametrize("path", ["/journal.jsonl", "/../journal.jsonl", "/live/", "/%2e%2e/fsm.txt"])
    def test_there_is_nothing_else(self, server, path):
        assert ask(server, path)[0] == 404

    @pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS"])
    def test_nothing_can_be_sent(self, server, method):
        assert ask(server, method=method)[0] == 501


class TestEnd:
    def test_it_ends_with_the_race_when_a_page_has_the_report(self, folder):
        with Journal(folder / "journal.jsonl", new=False) as journal, FollowServer(folder, lambda: "report") as server:
            thread = threading.Thread(target=server.serve)
            thread.start()
            fcntl.flock(journal._file, fcntl.LOCK_UN)
            assert json.loads(ask(server, "/live")[2]) == {"ended": True}
            assert ask(server)[2] == "report"
            thread.join(LIMIT)
            assert not thread.is_alive()

    def test_a_report_that_cannot_be_made(self, folder):
        def fail():
            raise RaceError("r/fsm.txt: damaged")

        with Journal(folder / "journal.jsonl", new=False) as journal, FollowServer(folder, fail) as server:
            thread = threading.Thread(target=server.serve)
            thread.start()
            fcntl.flock(journal._file, fcntl.LOCK_UN)
            assert ask(server)[2] == "<p>r/fsm.txt: damaged</p>"
            thread.join(LIMIT)
            assert not thread.is_alive()

    def test_or_some_time_later(self, folder, monkeypatch):
        monkeypatch.setattr(follow, "FAREWELL", 0.0)
        with Journal(folder / "journal.jsonl", new=False) as journal, FollowServer(folder, lambda: "") as server:
            fcntl.flock(journal._file, fcntl.LOCK_UN)
            server.serve()

    def test_a_race_that_is_not_running(self, folder, mdesign):
        code, out, err = mdesign("report", folder, "--follow")
        assert (code, out) == (1, "")
        assert "expected a race that is running, found one that is finished" in err

    @pytest.mark.usefixtures("running")
    def test_a_port_that_is_taken(self, folder):
        with FollowServer(folder, lambda: "") as server, pytest.raises(RaceError, match="give another --port"):
            FollowServer(folder, lambda: "", server.server_port)

    @pytest.mark.usefixtures("running")
    def test_ctrl_c(self, folder, mdesign, monkeypatch):
        def interrupted(_):
            raise KeyboardInterrupt

        monkeypatch.setattr(FollowServer, "serve", interrupted)
        code, out, err = mdesign("report", folder, "--follow")
        assert (code, err.strip()) == (130, "Interrupted.")
        assert out.startswith(f"http://{HOST}:")

    def test_it_writes_nothing(self, folder, mdesign):
        assert mdesign("report", folder, "--follow", "--no-comparison")[0] == 2


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.write_bytes(b"\xff\xfe\x00")])
def test_report_that_is_no_report(make, folder):
    file = folder / "report.html"
    file.unlink(missing_ok=True)
    make(file)
    os.utime(file, (2e9, 2e9))  # newer than the journal
    assert latest_report(folder).startswith("<!doctype html>")
