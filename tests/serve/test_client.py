"""The client on the command line, against a service on a port of its own."""

import contextlib
import io
import json
import socket
import time
from pathlib import Path

import httpx
import pytest
from fastapi.sse import KEEPALIVE_COMMENT

from mercator_design.config import shipped
from mercator_design.missions.mission import load_mission
from mercator_design.serve.app import guarded
from mercator_design.serve.client import connection as connecting
from mercator_design.serve.client.connection import ClientError, Connection, token_for
from mercator_design.serve.client.fetch import fetch_folder
from mercator_design.serve.client.follow import events_of
from mercator_design.serve.service import Service
from mercator_design.software.files import fsm_of, read_fsm
from mercator_design.studies.plan import load_plan
from tests.processes import wait_until
from tests.serve.own_study import FILES, OWN, OWN_TOTAL
from tests.serve.serving import serving
from tests.serve.still import still

pytestmark = pytest.mark.together

SILENCE = KEEPALIVE_COMMENT.decode()
SMALL = ("--set", "duration=2", "--set", "robots=2", "--budget", "60")


@pytest.fixture(scope="module")
def service(tmp_path_factory, plain_races):
    """A service that runs races."""
    with Service(tmp_path_factory.mktemp("live") / "runs") as running:
        yield running


@pytest.fixture(scope="module")
def server(service):
    with serving(guarded(service)) as address:
        yield address


@pytest.fixture
def client(mdesign, server, monkeypatch, tmp_path):
    """Run a verb of the client."""
    monkeypatch.setenv("MERCATOR_DESIGN_SERVER", server)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("MERCATOR_DESIGN_TOKEN", raising=False)
    monkeypatch.chdir(tmp_path)
    return mdesign


@pytest.fixture(scope="module")
def told(server, mdesign_once):
    """What submitting a job and following it to its end have printed: stdout and stderr of each."""

    def run(*arguments):
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
            try:
                mdesign_once(*arguments, "--server", server)
            except AssertionError:
                raise AssertionError(err.getvalue()) from None
        return out.getvalue(), err.getvalue()

    submitted = run("submit", "aggregation", *SMALL, "--seed", "3")
    return submitted, run("follow", submitted[0].strip(), "--progress", "plain", "--json-lines")


@pytest.fixture(scope="module")
def done(told):
    """A job that has run to its end."""
    return told[0][0].strip()


@pytest.mark.thorough
def test_submit_and_follow_and_fetch(client, server, told, done, tmp_path):
    job, ((_, err), (out, progress)) = done, told
    assert err == f"Submitted; its page: {server}/jobs/{job}\n"
    events = [json.loads(line) for line in out.splitlines()]
    assert [events[0]["event"], events[-1]["event"]] == ["start", "test"]  # those of the winner follow the end
    assert sum(event["event"] == "experiment" for event in events) == 60
    assert "iteration 1 ended" in progress
    assert f"{job}: finished, 60 of 60 experiments, score " in progress
    assert " on 30 fresh instances" in progress
    code, out, err = client("fetch", job)
    assert (code, out) == (0, "")
    assert client("runs", "verify", job)[0] == 0
    journal = (tmp_path / job / "journal.jsonl").read_text().splitlines()
    told = [{key: value for key, value in json.loads(line).items() if key not in ("crc", "after")} for line in journal]
    assert [event for event in events if event["event"] != "stop"] == [one for one in told if one["event"] != "stop"]


@pytest.mark.thorough
def test_a_study_with_own_files_from_its_submission_to_its_tables(client, service, server, tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "mine.yaml").write_text(OWN)
    code, out, err = client("submit", "mine.yaml")
    assert code == 0, err
    job = out.strip()
    code, _, err = client("follow", job, "--progress", "plain")
    assert code == 0, err
    assert f"{job}: finished, {OWN_TOTAL} of {OWN_TOTAL} experiments" in err
    assert client("fetch", job)[0] == 0
    folder = tmp_path / job
    assert len((folder / "tables/designs.csv").read_text().splitlines()) == 1 + 2 * 2 + 2
    hand = read_fsm(folder / "cells/short/hand/0/1/fsm.txt").software
    assert hand == fsm_of(FILES["made/by-hand.txt"], "").software
    assert load_mission(folder / "cells/short/random/20/1/mission.yaml").duration == 1
    assert '<iframe class="report"' in httpx.get(f"{server}/jobs/{job}/race").text
    assert all(Path(file).is_relative_to(folder) for file in load_plan(folder / "study.yaml").files.values())
    assert client("study", folder / "study.yaml", "-o", folder, "--dry-run")[0] == 0
    for file in filter(Path.is_file, folder.rglob("*")):
        assert str(service.data).encode() not in file.read_bytes(), file


@pytest.mark.thorough
def test_no_file_says_where_the_service_has_its_data(service, done):
    for file in (service.data / done).rglob("*"):
        assert str(service.data).encode() not in file.read_bytes(), file.name


def test_a_mission_file(client, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_bytes(shipped.missions()["aggregation"].read_bytes())
    code, out, err = client("submit", file, *SMALL, "--json")
    assert code == 0, err
    job = json.loads(out)
    assert job["budget"] == 60
    assert client("jobs", "cancel", job["id"])[0] == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [("extends: other.yaml\n", "extends: "), ("name: [\n", "mission.yaml"), (None, "no such file")],
)
def test_a_mission_that_is_refused(client, tmp_path, text, words):
    file = tmp_path / "bad.yaml"
    if text is not None:
        file.write_text(text)
    code, out, err = client("submit", file, *SMALL)
    assert (code, out) == (3, "")
    assert err.startswith("Error: ")
    assert words in err


def test_other_refusals(client):
    status, _, err = client("submit", "nowhere", *SMALL)
    assert status == 3
    assert err.startswith("Error: nowhere: no such mission; shipped are: ")
    assert client("submit", "aggregation", "--budget", "0")[0] == 2
    assert client("submit", "aggregation", *SMALL, "--budget", 10**7)[0] == 1
    for verb in (["follow"], ["fetch"], ["jobs", "pause"], ["jobs", "delete"], ["jobs", "show"]):
        assert client(*verb, "no/such job")[::2] == (1, "Error: there is no job no/such job\n") or verb
        assert client(*verb, "nowhere")[::2] == (1, "Error: there is no job nowhere\n")


def test_jobs(client, done):
    code, out, _ = client("jobs", "--json")
    assert code == 0
    assert done in [job["id"] for job in json.loads(out)]
    code, out, _ = client("jobs", "--state", "finished", "--text", done)
    assert code == 0
    head, line = out.splitlines()
    assert head.split()[:2] == ["job", "mission"]
    assert line.split()[0] == done
    assert client("jobs", "--text", "no such thing")[1] == "There are no such jobs.\n"
    assert json.loads(client("jobs", "show", done)[1])["id"] == done


def test_change_a_job(client):
    job = client("submit", "aggregation", *SMALL, "--priority", "-100")[1].strip()
    assert client("jobs", "pause", job)[0] == 0
    wait_until(lambda: json.loads(client("jobs", "show", job)[1])["state"] == "paused")
    assert client("jobs", "change", job, "--budget", "80", "--priority", "5", "--shared")[::2] == (
        0, f"{job}: queued\n",
    )  # fmt: skip
    assert client("jobs", "change", job)[0] == 2
    assert client("jobs", "cancel", job)[0] == 0
    wait_until(lambda: json.loads(client("jobs", "show", job)[1])["state"] == "cancelled")
    assert client("jobs", "resume", job)[::2] == (1, f"Error: {job}: cannot resume a job that is cancelled\n")
    code, _, err = client("follow", job, "--progress", "none")
    assert code == 1
    assert err.startswith(f"Error: {job}: cancelled, ")
    assert client("jobs", "delete", job)[::2] == (0, f"{job}: deleted\n")
    assert client("jobs", "show", job)[0] == 1


def test_fetch(client, done, tmp_path):
    code, out, _ = client("fetch", done, "--file", "fsm.txt")
    assert code == 0
    assert "--nstates" in out
    assert client("fetch", done, "--file", "fsm.txt", "-o", "mine.txt")[0] == 0
    assert (tmp_path / "mine.txt").read_text() == out
    assert client("fetch", done, "--file", "nothing")[::2] == (1, f"Error: {done} has no file nothing\n")
    assert client("fetch", done, "--file", "nothing", "-o", "none.txt")[0] == 1
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/file").touch()
    code, _, err = client("fetch", done, "-o", "taken")
    assert (code, err) == (1, "Error: taken: expected a new or empty folder, found files in it\n")
    (tmp_path / "empty").mkdir()
    assert client("fetch", done, "-o", "empty")[0] == 0
    assert client("runs", "verify", "empty")[0] == 0
    assert sorted(one.name for one in tmp_path.iterdir()) == ["empty", "mine.txt", "taken"]


def test_no_service(client):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    code, out, err = client("jobs", "--server", f"http://127.0.0.1:{port}")
    assert (code, out) == (1, "")
    assert err.startswith(f"Error: http://127.0.0.1:{port}: cannot be reached: ")
    assert err.endswith("a service is started by: mdesign serve\n")


@pytest.mark.parametrize(
    "address", ["nowhere", "ftp://x", "http://", "http://a:b@c", "http://x?y", "http://x:99999", ""]
)
def test_addresses_that_are_none(client, address):
    code, _, err = client("jobs", "--server", address)
    assert code == 1
    assert err.startswith("Error: expected the address of a service, such as http://127.0.0.1:8000, found")


class TestToken:
    @pytest.fixture
    def file(self, tmp_path, monkeypatch):
        file = tmp_path / "tokens"
        monkeypatch.setattr(connecting, "token_file", lambda: file)
        return file

    def test_none(self, file):
        assert token_for("http://a", {}) == ""

    @pytest.mark.usefixtures("homeless")
    def test_without_a_home(self):
        assert token_for("http://a", {}) == ""

    def test_of_the_environment(self, file):
        assert token_for("http://a", {"MERCATOR_DESIGN_TOKEN": " t1 "}) == "t1"

    def test_of_the_file_goes_to_its_service_only(self, file):
        file.write_text("# mine\nhttps://a/ t1\n\nhttps://b t2\n")
        file.chmod(0o600)
        assert [token_for(one, {}) for one in ("https://a", "https://b", "http://a")] == ["t1", "t2", ""]

    def test_a_file_that_others_may_read_is_refused(self, file):
        file.write_text("https://a t1\n")
        file.chmod(0o640)
        with pytest.raises(ClientError, match="other users of this machine may read it; run: chmod 600 "):
            token_for("https://a", {})

    @pytest.mark.parametrize("text", ["t1\n", "https://a t1 t2\n", "https://a t\u00e9\n", b"\xff\xff"])
    def test_a_damaged_file(self, file, text):
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        file.chmod(0o600)
        with pytest.raises(ClientError, match="tokens"):
            token_for("https://a", {})

    def test_it_is_sent_and_not_shown(self, file):
        seen = []

        def answer(request):
            seen.append(request.headers["authorization"])
            return httpx.Response(401, json={"errors": ["expected a valid token"]})

        with Connection("http://lab.example", "secret", transport=httpx.MockTransport(answer)) as connection:
            with pytest.raises(ClientError) as error:
                connection.call("GET", "/jobs")
            assert connection.sends_token_unencrypted
        assert seen == ["Bearer secret"]
        assert "secret" not in str(error.value)
        assert error.value.messages[1].startswith("give your token for http://lab.example in MERCATOR_DESIGN_TOKEN")


class TestLostConnections:
    """A service whose streams break, before a transport without a network."""

    EVENTS = 12

    def stream(self, request, after, upto, state="running"):
        start = int(request.headers.get("last-event-id") or 0)
        assert start == after
        text = "".join(
            f'event: experiment\nid: {k}\ndata: {{"k": {k}}}\n\n{SILENCE}' for k in range(start + 1, upto + 1)
        )
        text += f'event: state\nid: {upto}\ndata: {{"state": "{state}"}}\n\n'
        return httpx.Response(200, headers={"content-type": "text/event-stream"}, text=text)

    def follow(self, *answers):
        left, waited, announced = list(answers), [], []

        def answer(request):
            found = left.pop(0)(request)
            if isinstance(found, Exception):
                raise found
            return found

        with Connection("http://x", transport=httpx.MockTransport(answer)) as connection:
            told = [*events_of(connection, "j", announce=announced.append, sleep=waited.append)]
        assert not left
        return [one.data["k"] for one in told if one.kind == "experiment"], waited, announced

    def test_each_event_once(self):
        found, waited, announced = self.follow(
            lambda request: self.stream(request, 0, 5),  # ends, as when a service stops
            lambda _: httpx.ConnectError("refused"),
            lambda _: httpx.ReadError("reset"),
            lambda _: httpx.Response(503, json={"errors": ["busy"]}),
            lambda request: self.stream(request, 5, 9),
            lambda _: httpx.ReadTimeout("silent"),
            lambda request: self.stream(request, 9, self.EVENTS, "finished"),
        )
        assert found == [*range(1, self.EVENTS + 1)]
        assert waited == [0.5, 1.0, 2.0, 5.0, 0.5, 1.0]
        assert len(announced) == 2

    def test_too_many_streams_are_waited_for(self):
        found, waited, announced = self.follow(
            lambda _: httpx.Response(429, json={"errors": ["expected at most 40 event streams"]}),
            lambda request: self.stream(request, 0, self.EVENTS, "finished"),
        )
        assert (len(found), waited) == (self.EVENTS, [0.5])
        assert announced == ["expected at most 40 event streams; trying again"]

    @pytest.mark.parametrize("status", [401, 403, 404, 409, 500])
    def test_refusals_end_it(self, status):
        with pytest.raises(ClientError, match="no"):
            self.follow(
                lambda request: self.stream(request, 0, 5),
                lambda _: httpx.Response(status, json={"errors": ["no"]}),
            )

    @pytest.mark.parametrize(
        "answer",
        [
            httpx.Response(200, text="<html>"),
            httpx.Response(200, headers={"content-type": "text/event-stream"}, text="data: x\n\n"),
            httpx.Response(200, headers={"content-type": "text/event-stream"}, text="data: [1]\n\n"),
        ],
    )
    def test_other_servers(self, answer):
        with pytest.raises(ClientError, match="expected"):
            self.follow(lambda _: answer)


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x", "", ".", "a\0b", "a//b"])
def test_a_service_cannot_write_elsewhere(tmp_path, name):
    answers = {"/api/v1/jobs/j/files": httpx.Response(200, json=[{"name": name, "bytes": 1}])}
    transport = httpx.MockTransport(lambda request: answers.get(request.url.path, httpx.Response(200, text="x")))
    with (
        Connection("http://x", transport=transport) as connection,
        pytest.raises(ClientError, match="the name of a file"),
    ):
        fetch_folder(connection, "j", tmp_path / "to")
    assert [*tmp_path.iterdir()] == []


def test_a_folder_appears_when_it_is_complete(tmp_path):
    def answer(request):
        if request.url.path.endswith("/files"):
            return httpx.Response(200, json=[{"name": "journal.jsonl", "bytes": 1}, {"name": "fsm.txt", "bytes": 1}])
        assert [*tmp_path.glob("to*")] == []
        if request.url.path.endswith("journal.jsonl"):  # the last one
            raise httpx.ReadError("reset")
        return httpx.Response(200, text="x")

    reset = pytest.raises(ClientError, match="cannot be reached: reset")
    with Connection("http://x", transport=httpx.MockTransport(answer)) as connection, reset:
        fetch_folder(connection, "j", tmp_path / "to")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("text", ["[", "[]" * 3, '{"errors": 3}', '{"errors": [3]}', '"x"', ""])
def test_errors_in_other_forms(text):
    transport = httpx.MockTransport(lambda _: httpx.Response(500, text=text))
    refused = pytest.raises(ClientError, match="the service answers 500 Internal Server Error")
    with Connection("http://x", transport=transport) as connection, refused:
        connection.call("GET", "/jobs")


def test_follow_goes_on_over_a_restart_of_the_service(tmp_path, raced):
    """The same data folder at the same port: no event is lost, and none comes twice."""
    told, announced = [], []
    with still(tmp_path / "runs", raced) as one:
        job = one.submit("local")
        one.race(job, lines=20)
        app = guarded(one.service)
        with serving(app) as address:
            port = int(address.rpartition(":")[2])
            connection = Connection(address)
            following = events_of(connection, job, announce=announced.append, sleep=lambda _: time.sleep(0.01))
            told += [next(following) for _ in range(20)]
    with still(tmp_path / "runs", raced) as one:
        one.race(job)
        with serving(guarded(one.service), port):
            told += [*following]
    connection.http.close()
    journal = (raced / "journal.jsonl").read_text().splitlines()
    experiments = [event.data["experiment"] for event in told if event.kind == "experiment"]
    assert experiments == [json.loads(line)["experiment"] for line in journal if '"event":"experiment"' in line]
    assert len(announced) <= 1
