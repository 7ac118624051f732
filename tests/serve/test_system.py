"""Health, readiness, figures."""

import json
import re

from starlette.testclient import TestClient

from mercator_design.serve.app import guarded
from mercator_design.serve.service import Service


def test_health_and_readiness(client):
    assert client.get("/healthz").text == "ok\n"
    assert client.get("/readyz").text == "ready\n"


def test_it_is_not_ready_when_jobs_are_not_looked_after(client, service, monkeypatch):
    monkeypatch.setattr(type(service.supervisor), "is_alive", False)
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
