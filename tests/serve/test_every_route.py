"""Every route and method of the application, with every kind of credentials. New routes are found by themselves."""

import itertools
import re
from types import SimpleNamespace

import pytest
from fastapi.routing import iter_route_contexts
from starlette.testclient import TestClient

from mercator_design.serve.accounts.refusals import SAFE
from mercator_design.serve.app import application, guarded
from mercator_design.serve.designs import Design
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.service import Service
from mercator_design.system.files import write_text

pytestmark = pytest.mark.together

OPEN = {("GET", "/healthz"), ("GET", "/readyz"), ("GET", "/login"), ("POST", "/login"), ("GET", "/assets/{name}")}
"""All that needs no login. Of the assets, only what the login page loads; see below."""
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE")
BODIES = {"json": {}}


@pytest.fixture(scope="module")
def lab(tmp_path_factory, idle_races):
    """A service with two users and an administrator, and a private and a shared job of ana."""
    data = tmp_path_factory.mktemp("lab") / "runs"
    with Service(data) as service:
        users = service.accounts.users
        tokens = {name: users.add(name) for name in ("ana", "bob", "gone")}
        tokens["root"] = users.add("root", is_admin=True)
        tokens["expired"] = users.add_token("ana", days=-1)
        tokens["revoked"] = users.add_token("ana")
        users.revoke(tokens["revoked"].split("_")[1])
        users.revoke("gone")
        tokens |= {"unknown": tokens["ana"][:12] + "x" * 43, "malformed": "md_x"}
        request = RaceRequest(mission="aggregation", budget=100)
        private, shared = (service.jobs.submit("ana", name, "maximise", request).id for name in ("secret", "open"))
        service.jobs.change(shared, shared=True)
        for identity in (private, shared):
            service.jobs.pause(identity)
            service.store.run_folder(identity).mkdir(exist_ok=True)
            write_text(service.store.run_folder(identity) / "fsm.txt", "--nstates 1 --s0 0 --rwm0 20\n")
        design = Design(
            id="-", owner="ana", name="secret", mission="aggregation", direction="maximise", scores=(), created="",
            shared=False,
        )  # fmt: skip
        design = service.designs.create(design, "--nstates 1 --s0 1\n", "name: x\n").id
        with TestClient(guarded(service), base_url="http://localhost", follow_redirects=False) as client:
            yield SimpleNamespace(
                service=service,
                client=client,
                routes=routes(service),
                tokens=tokens,
                private=private,
                shared=shared,
                design=design,
            )


def routes(service):
    """All routes: their methods and paths."""
    found = {
        (method, route.path)
        for route in iter_route_contexts(application(service).routes)
        for method in route.methods or METHODS
    }
    assert len(found) > 20
    return sorted(found)


def filled(path, job="x"):
    """A path with values for its parameters."""
    values = {"id": job, "name": "fsm.txt"}
    return re.sub(r"\{(\w+)(?::\w+)?\}", lambda found: values.get(found[1], "x"), path)


def sent(lab, method, path, token=None, **given):
    headers = {"authorization": f"Bearer {lab.tokens[token]}"} if token else {}
    body = BODIES if method not in SAFE else {}
    return lab.client.request(method, path, headers=headers, **body, **given)


@pytest.mark.parametrize("token", [None, "malformed", "unknown", "expired", "revoked", "gone"])
def test_nobody_gets_in_without_a_valid_token(lab, token):
    closed = [route for route in lab.routes if route not in OPEN]
    jobs = ("x", lab.private, lab.shared)
    for method, path in sorted(
        {(method, filled(path, job)) for (method, path), job in itertools.product(closed, jobs)}
    ):
        answer = sent(lab, method, path, token)
        assert answer.status_code == 401, (method, path)
        assert lab.private not in answer.text.replace(path, "")


def test_nor_by_other_methods(lab):
    paths = sorted({path for _, path in lab.routes} | {"/nothing", "/api/v1", "/docs", "/redoc", "/openapi.json"})
    for method, path in itertools.product(METHODS, paths):
        if (method, path) not in OPEN:
            assert sent(lab, method, filled(path, lab.private)).status_code == 401, (method, path)


def test_nor_with_a_session_that_has_ended(lab):
    accounts = lab.service.accounts
    holder = accounts.users.verify(lab.tokens["ana"])
    secret = accounts.sessions.begin(holder.token, holder.expires)
    accounts.sessions.end(secret)
    for method, path in lab.routes:
        if (method, path) not in OPEN:
            headers = {"cookie": f"session={secret}"}
            answer = lab.client.request(method, filled(path, lab.private), headers=headers)
            assert answer.status_code == 401, (method, path)


def test_what_is_open_says_nothing_of_jobs(lab):
    for method, path in OPEN - {("GET", "/assets/{name}")}:
        answer = lab.client.request(method, path)
        assert answer.status_code in (200, 401)
        assert lab.private not in answer.text
    page = lab.client.get("/login").text
    loaded = re.findall(r'(?:src|href)="(/assets/[^"]+)"', page)
    assert len(loaded) >= 4
    for address in loaded:
        assert lab.client.get(address).status_code == 200
    for other in ("viewer.js", "x", "../api/v1/jobs", "%2e%2e/api/v1/jobs"):
        assert lab.client.get(f"/assets/{other}").status_code == 401


def test_what_is_of_another_user_is_not_there(lab):
    """A job, a design, and whatever else has an id: the answer is that for one that does not exist."""
    checked = set()
    for method, path in lab.routes:
        if "{id}" in path:
            private = lab.design if "/designs/" in path else lab.private
            missing = "x" * len(private)
            answer, nothing = (sent(lab, method, filled(path, one), "bob") for one in (private, missing))
            assert answer.status_code in ((404,) if method in SAFE else (404, 422)), (method, path)
            assert nothing.status_code == answer.status_code
            assert nothing.text.replace(missing, "") == answer.text.replace(private, ""), (method, path)
            checked.add(path)
    assert len(checked) >= 12


def test_a_shared_job_is_seen_and_not_changed(lab):
    for method, path in lab.routes:
        if "{id}" in path and "/api/v1/jobs/" in path and method not in SAFE:
            assert sent(lab, method, filled(path, lab.shared), "bob").status_code in (403, 422), (method, path)
    assert sent(lab, "GET", f"/api/v1/jobs/{lab.shared}", "bob").status_code == 200
    assert lab.service.index.get(lab.shared).state == lab.service.index.get(lab.private).state == "paused"


def test_no_list_has_jobs_of_another_user(lab):
    for method, path in lab.routes:
        if method == "GET" and "{" not in path:
            answer = sent(lab, method, path, "bob")
            assert answer.status_code < 500
            assert lab.private not in answer.text, path
            assert lab.design not in answer.text, path
            assert not answer.headers.get("content-type", "").startswith("text/event-stream")
    assert lab.private in sent(lab, "GET", "/api/v1/jobs", "ana").text
    assert lab.private in sent(lab, "GET", "/api/v1/jobs", "root").text
    assert lab.shared in sent(lab, "GET", "/api/v1/jobs", "bob").text


def test_bodies_of_forms_are_refused_everywhere(lab):
    for method, path in lab.routes:
        if method not in SAFE and (method, path) not in OPEN:
            headers = {"authorization": f"Bearer {lab.tokens['ana']}"}
            answer = lab.client.request(method, filled(path, "x"), headers=headers, data={"a": "b"})
            assert answer.status_code == 415, (method, path)


def test_every_answer_has_the_headers(lab):
    for (method, path), token in itertools.product(lab.routes, (None, "bob")):
        headers = sent(lab, method, filled(path, "x"), token).headers
        assert headers["x-content-type-options"] == "nosniff", (method, path)
        assert "unsafe-inline" not in re.sub(r"style-src[^;]*", "", headers["content-security-policy"]), (method, path)
        assert headers["referrer-policy"] == "same-origin"


def test_files_of_the_service_are_not_reached(lab):
    for name in (
        ".service/users.json",
        "../.service/users.json",
        "%2e%2e/.service/users.json",
        "..%2f.service%2fusers.json",
    ):
        answer = sent(lab, "GET", f"/api/v1/jobs/{lab.private}/files/{name}", "ana")
        assert answer.status_code in (404, 422), name
    for identity in (".service", "..", "%2e%2e", "..%2f..", ".service%2fjobs"):
        for path in ("", "/files", "/files/users.json", "/events"):
            assert sent(lab, "GET", f"/api/v1/jobs/{identity}{path}", "root").status_code in (404, 307), (
                identity,
                path,
            )
