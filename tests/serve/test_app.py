from mercator_design.serve.desk.desk import ASKED_BY


def test_the_list_of_jobs_is_empty_at_first(client):
    assert client.get("/api/v1/jobs").json() == {"jobs": [], "total": 0}


def test_the_desk_knows_who_asks_for_work(service, client, monkeypatch):
    asked = []
    monkeypatch.setattr(service.desk, "run", lambda *_: asked.append(ASKED_BY.get()) or {})
    assert client.get("/api/v1/schema/mission").json() == {}
    assert asked == ["local"]
    assert ASKED_BY.get() == ""
