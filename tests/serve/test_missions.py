"""The routes on missions, with good and with hostile ones."""

import io
import json

import pytest
import yaml
from jsonschema import Draft202012Validator
from PIL import Image

from mercator_design.config import shipped
from mercator_design.serve.http.schemas import MAX_TEXT
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers import estimates

TEXT = shipped.missions()["foraging"].read_text()
SMALL = ["duration=2", "robots=2"]
HOSTILE = {
    "aliases": "a: &a [x,x,x]\n" + "".join(f"b{i}: &b{i} [{','.join(['*a'] * 9)}]\n" for i in range(30)),
    "deep": "[" * MAX_TEXT,
    "tag": "!!python/object/apply:os.system ['id']",
    "huge number": TEXT.replace("robots: 3", "robots: " + "9" * 9000),
    "infinite": TEXT.replace("radius: 0.25", "radius: 1e400"),
    "not a number": TEXT.replace("duration: 120", "duration: .nan"),
    "image": TEXT.replace("  background: gray", "  background: gray\n  image: {path: /etc/passwd, size: [1, 1]}"),
    "robot model": TEXT.replace("robot_model: mercator", "robot_model: ../../etc/passwd.yaml"),
    "unknown robot model": TEXT.replace("robot_model: mercator", "robot_model: passwd"),
    "NUL": "robots: \0 3",
    "escapes": TEXT.replace("left source", "\x1b[31mleft\x07"),
    "quoted escapes": TEXT.replace("left source", '"left \\x1b \\u202e source"'),
    "line separators": TEXT.replace("robots: 3", "robots: \u2028 3\u0085 4"),
    "long text": "a: " + "x" * (MAX_TEXT - 3),
    "many bytes": TEXT + "#" + "é" * (MAX_TEXT // 2),
    "many keys": "".join(f"key{i}: 1\n" for i in range(5000)),
    "documents": "--- 1\n" * 1000,
    "empty": "",
    "spaces": " \t\n",
    "too many robots": TEXT.replace("robots: 3", "robots: 900"),
    "too long": TEXT.replace("duration: 120", "duration: 80000"),
    "no space": TEXT.replace("robots: 3", "robots: 90"),
}


def post(client, route, **body):
    return client.post(f"/api/v1/missions/{route}", json=body)


def test_shipped_missions(client):
    found = client.get("/api/v1/missions").json()
    assert [one["name"] for one in found] == [*shipped.missions()]
    (foraging,) = [one for one in found if one["name"] == "foraging"]
    assert (foraging["robots"], foraging["duration"], foraging["direction"]) == (3, 120.0, "maximise")
    assert client.get("/api/v1/missions/foraging").text == TEXT
    for name in ("none", "..%2F..%2Fetc%2Fpasswd", "foraging.yaml", "x" * 300):
        assert client.get(f"/api/v1/missions/{name}").status_code in (404, 422)


def test_the_schema_is_one(client):
    schema = client.get("/api/v1/schema/mission").json()
    Draft202012Validator.check_schema(schema)
    assert Draft202012Validator(schema).is_valid(yaml.safe_load(TEXT))


def test_a_valid_mission(client):
    found = post(client, "check", mission_text=TEXT, set=["name=mine"]).json()
    assert (found["errors"], found["warnings"]) == ([], [])
    facts = found["facts"]
    assert (facts["name"], facts["robots"], facts["objective"], facts["never_fires"]) == (
        "mine", 3, "trips", ["floor colour"],
    )  # fmt: skip
    assert len(facts["digest"]) == 16


def test_mistakes_with_their_places(client):
    text = TEXT.replace("robots: 3", "robtos: 3").replace("sides: 12", "sides: two")
    errors = post(client, "check", mission_text=text).json()["errors"]
    assert [(one["line"], one["column"], one["path"]) for one in errors] == [
        (7, 1, "robtos"), (15, 12, "arena.walls.sides"),
    ]  # fmt: skip
    assert "did you mean 'robots'?" in errors[0]["message"]


def test_what_robots_cannot_reach_and_limits(client):
    far = TEXT.replace("center: [0.75, 0]", "center: [7.5, 0]")
    found = post(client, "check", mission_text=far).json()
    (error,) = found["errors"]
    assert (error["line"], error["path"]) == (31, "floor.zones[2]")
    assert "lies outside the walls" in error["message"]
    assert found["warnings"] == []
    assert found["facts"]["robots"] == 3
    near = TEXT.replace("center: [0.75, 0]", "center: [1.1, 0]")
    (warning,) = post(client, "check", mission_text=near).json()["warnings"]
    assert "lie outside the walls" in warning["message"]
    assert warning["line"] == 31
    (error,) = post(client, "check", mission="foraging", set=["robots=101"]).json()["errors"]
    assert "expected at most 100" in error["message"]


def test_the_flavour_is_checked(client):
    mission = {"mission": "foraging", "set": ["robot_model=mercator-argos"]}
    assert post(client, "check", **mission, flavour="watermelon").json()["errors"] == []
    assert "chocolate" in post(client, "check", **mission, flavour="chocolate").json()["errors"][0]["message"]


def test_pictures(client):
    for kind, type_ in (("svg", "image/svg+xml"), ("png", "image/png")):
        answer = post(client, "preview", mission="foraging", kind=kind)
        assert answer.status_code == 200
        assert answer.headers["content-type"] == type_
        assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert Image.open(io.BytesIO(answer.content)).size[0] > 500
    other = post(client, "preview", mission="foraging", kind="png", seed=2)
    assert other.content != answer.content
    wrong = post(client, "preview", mission_text="robots: none")
    assert (wrong.status_code, wrong.headers["content-type"]) == (422, "application/problem+json")


def test_completions(client):
    found = post(client, "complete", text="robots: 3\nrobot_m", line=2, column=8).json()
    assert found["column"] == 1
    assert "robot_model" in [one["label"] for one in found["options"]]
    assert post(client, "complete", text="", line=9, column=9).json()["options"] == []


def test_an_estimate(client):
    answer = post(client, "estimate", mission="foraging", set=SMALL, budget=1000)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert found["cost"]["experiments"] == 1210  # with 30 of the winner, and 6 others on these instances
    for low, high in (found["cost"]["seconds"], found["cost"]["core_seconds"]):
        assert 0 < low < high
    assert found["wait"] == {"running": 0, "queued": 0, "seconds": 0.0}
    answer = post(client, "estimate", mission="foraging", set=SMALL, budget=3)
    assert answer.status_code == 422
    assert "budget: expected at least" in answer.json()["errors"][0]


def test_an_estimate_follows_from_the_times_of_experiments(monkeypatch):
    monkeypatch.setattr(estimates, "computing_times", lambda *_: (0.1, 0.1, 0.1, 0.1))
    costs = [
        estimates.cost_of(RaceRequest(mission="foraging", budget=budget), UserLimits(), cores)
        for budget, cores in ((1000, 1), (10_000, 1), (10_000, 10))
    ]
    assert [one.experiment for one in costs] == [pytest.approx(0.1)] * 3
    assert [one.experiments for one in costs] == [1210, 10_210, 10_210]
    assert costs[0].core_seconds[0] < 121 < costs[0].core_seconds[1]
    assert costs[1].seconds[0] > 5 * costs[0].seconds[0]
    assert costs[2].seconds[1] < 0.2 * costs[1].seconds[1]
    assert costs[2].core_seconds == costs[1].core_seconds


def submitted(client, **body):
    answer = client.post("/api/v1/jobs", json={"budget": 100, **body})
    assert answer.status_code == 201, answer.text
    return answer.json()["job"]["id"]


def test_the_mission_of_a_job_can_be_submitted_again(client):
    text = TEXT.replace("robots: 3", "robots: 2  # mine").replace("duration: 120", "duration: 2")
    job = submitted(client, mission_text=text)
    assert client.get(f"/api/v1/jobs/{job}/mission").text == text
    assert client.get(f"/api/v1/jobs/{submitted(client, mission='foraging')}/mission").text == TEXT
    changed = client.get(f"/api/v1/jobs/{submitted(client, mission='foraging', set=SMALL)}/mission").text
    again = post(client, "check", mission_text=changed).json()
    assert (again["errors"], again["facts"]["robots"], again["facts"]["name"]) == ([], 2, "foraging")
    assert client.get("/api/v1/jobs/none/mission").status_code == 404


def test_a_job_whose_robots_do_not_fit_is_refused(client):
    answer = client.post("/api/v1/jobs", json={"mission_text": HOSTILE["no space"], "budget": 100})
    assert answer.status_code == 422
    assert "do not fit" in answer.json()["errors"][0]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_missions(client, name):
    text = HOSTILE[name]
    found = post(client, "check", mission_text=text)
    assert found.status_code == 200
    assert found.json()["errors"], found.text
    assert len(found.content) < 20_000
    assert "root:" not in found.text
    assert "/site-packages/" not in found.text
    for one in found.json()["errors"]:
        assert one["message"].isprintable()
    assert post(client, "preview", mission_text=text).status_code == 422
    assert post(client, "estimate", mission_text=text, budget=100).status_code == 422
    middle = text.count("\n") // 2 + 1
    assert post(client, "complete", text=text, line=middle, column=1).status_code == 200


@pytest.mark.parametrize(
    "body",
    [
        {"mission_text": "x" * (MAX_TEXT + 1)},
        {"mission_text": 5},
        {"mission": "x" * 500},
        {"mission": "foraging", "set": ["x"] * 101},
        {"mission": "foraging", "more": 1},
        {"mission": "../../etc/passwd"},
        {"mission": "", "set": []},
        [],
    ],
)
def test_bodies_that_are_refused(client, body):
    for route in ("check", "preview", "estimate"):
        sent = body | {"budget": 100} if route == "estimate" and body else body
        answer = client.post(f"/api/v1/missions/{route}", json=sent)
        assert answer.status_code == 422
        assert answer.json()["errors"]


def test_halves_of_characters_are_refused(client):
    data = json.dumps({"mission_text": "robots: \ud800"})
    answer = client.post("/api/v1/missions/check", content=data, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 422)
    assert answer.json()["errors"]
