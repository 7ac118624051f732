from mercator_design.serve.app import application, route_info
from mercator_design.serve.workers.pool import CURRENT_USER


def test_the_list_of_jobs_is_empty_at_first(client):
    assert client.get("/api/v1/jobs").json() == {"jobs": [], "total": 0}


def test_events_alone_are_event_streams(service):
    is_stream = route_info(application(service)).is_stream
    assert is_stream("/api/v1/jobs/x/events")
    for path in ("/api/v1/jobs/x/files/fsm.txt", "/api/v1/jobs/x/files/events", "/api/v1/jobs", "/jobs/x"):
        assert not is_stream(path), path


def test_the_desk_knows_who_asks_for_work(service, client, monkeypatch):
    asked = []
    monkeypatch.setattr(service.workers, "run", lambda *_: asked.append(CURRENT_USER.get()) or {})
    assert client.get("/api/v1/schema/mission").json() == {}
    assert asked == ["local"]
    assert CURRENT_USER.get() == ""
