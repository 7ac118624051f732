import json

import pytest

from mercator_design.missions.mission import load_mission
from mercator_design.serve.designs import Designs
from mercator_design.serve.jobs.operations import LimitReached
from mercator_design.serve.settings import ServiceError, UserLimits
from mercator_design.software.files import read_fsm
from tests.serve.machines import FSM, MISSION, STOP, client_of, race_in, short_mission

pytestmark = pytest.mark.together


def save(client, name="pair", *, fsm=FSM, **more):
    answer = client.post("/api/v1/designs", json={"name": name, "mission": MISSION, "fsm": {"fsm": fsm}, **more})
    assert answer.status_code == 201, answer.text
    return answer.json()


@pytest.fixture(scope="module")
def ann(service):
    with client_of(service, "ann") as client:
        yield client


@pytest.fixture(scope="module")
def bob(service):
    with client_of(service, "bob") as client:
        yield client


def folder_of(service, design):
    return service.data / ".service" / "designs" / design["id"]


class TestSave:
    def test_its_files_are_those_of_mdesign(self, ann, service, mdesign):
        design = save(ann, "two states")
        folder = folder_of(service, design)
        assert sorted(path.name for path in folder.iterdir()) == ["design.json", "fsm.txt", "mission.yaml"]
        mission = load_mission(folder / "mission.yaml")
        assert mission.digest == short_mission().digest
        assert read_fsm(folder / "fsm.txt").header["mission digest"] == mission.digest
        code, out, err = mdesign("evaluate", folder / "fsm.txt", "-n", 10, "--json", "--progress", "none")
        assert (code, err) == (0, "")
        assert json.loads(out)["mean"] == pytest.approx(design["mean"])
        assert (design["runs"], design["owner"], design["mission"]) == (10, "ann", "aggregation")

    def test_it_is_shown_and_fetched(self, ann, service):
        design = save(ann)
        shown = ann.get(f"/api/v1/designs/{design['id']}").json()
        assert shown["design"] == design
        assert (shown["fsm"]["text"], "<svg" in shown["fsm"]["diagram"]) == (FSM, True)
        text = ann.get(f"/api/v1/designs/{design['id']}/fsm.txt")
        assert text.text == (folder_of(service, design) / "fsm.txt").read_text()
        assert text.headers["content-type"].startswith("text/plain")

    def test_its_mission_and_fsm_are_used_again(self, ann):
        design = save(ann)
        body = {"mission": {"design": design["id"]}, "fsms": [{"design": design["id"]}, {"fsm": STOP}], "runs": 10}
        found = ann.post("/api/v1/fsms/evaluate", json=body).json()
        assert found["fsms"][0]["mean"] == pytest.approx(design["mean"])

    @pytest.mark.parametrize(
        "name", ["", " x", "a/b", "<b>", "a\nb", "x" * 101, "..", "a\n", "re\u0301sume\u0301", "a\u200db"]
    )
    def test_names(self, ann, name):
        body = {"name": name, "mission": MISSION, "fsm": {"fsm": FSM}}
        assert ann.post("/api/v1/designs", json=body).status_code == 422

    def test_what_is_not_valid_is_not_saved(self, ann, service):
        before = set((service.data / ".service" / "designs").iterdir())
        body = {"name": "x", "mission": MISSION, "fsm": {"fsm": "--nstates 1 --s0 9"}}
        assert ann.post("/api/v1/designs", json=body).status_code == 422
        body = {"name": "x", "mission": {"mission_text": "robots: 3"}, "fsm": {"fsm": FSM}}
        assert ann.post("/api/v1/designs", json=body).status_code == 422
        assert set((service.data / ".service" / "designs").iterdir()) == before

    def test_the_winner_of_a_run_folder(self, ann, service):
        race_in(service.data / "before")
        service.supervisor.reconcile()
        body = {"name": "kept", "mission": {"job": "before"}, "fsm": {"job": "before"}}
        answer = ann.post("/api/v1/designs", json=body)
        assert answer.status_code == 201, answer.text
        assert load_mission(folder_of(service, answer.json()) / "mission.yaml").robot_model == "mercator"

    def test_a_mission_with_files_of_its_own(self, ann, service):
        race_in(service.data / "own robot")
        model = service.data / "own robot" / "robot_model.yaml"
        model.write_text(model.read_text().replace("name: mercator", "name: own"))
        service.supervisor.reconcile()
        body = {"name": "kept", "mission": {"job": "own robot"}, "fsm": {"job": "own robot"}}
        answer = ann.post("/api/v1/designs", json=body)
        assert answer.status_code == 422
        assert "found own of its own" in answer.json()["errors"][0]


class TestChange:
    def test_rename_and_share(self, ann, bob):
        design = save(ann, "mine")
        path = f"/api/v1/designs/{design['id']}"
        assert ann.patch(path, json={"shared": True}).json() == {**design, "shared": True}
        assert ann.patch(path, json={"name": "ours"}).json()["name"] == "ours"
        assert bob.get(path).status_code == 200
        assert bob.patch(path, json={"name": "x"}).status_code == 403
        assert bob.delete(path).status_code == 403
        assert ann.patch(path, json={"owner": "bob"}).status_code == 422

    @pytest.mark.parametrize("name", ["re\u0301sume\u0301", "a\u200db"])
    def test_a_name_that_its_file_cannot_have(self, ann, service, name):
        design = save(ann, "mine")
        answer = ann.patch(f"/api/v1/designs/{design['id']}", json={"name": name})
        assert answer.status_code == 422
        assert answer.json()["errors"][0].startswith("body.name: expected a text: letters, digits, spaces")
        with pytest.raises(ServiceError, match="name: expected"):
            service.designs.update(design["id"], name=name)
        assert service.designs.read(design["id"]).name == service.designs.get(design["id"]).name == "mine"

    def test_delete(self, ann, service):
        design = save(ann)
        assert ann.delete(f"/api/v1/designs/{design['id']}").status_code == 204
        assert ann.get(f"/api/v1/designs/{design['id']}").status_code == 404
        assert not folder_of(service, design).exists()

    def test_those_of_others_are_not_there(self, ann, bob, client):
        design = save(ann, "secret")
        path = f"/api/v1/designs/{design['id']}"
        for method, where in (("GET", path), ("GET", f"{path}/fsm.txt"), ("PATCH", path), ("DELETE", path)):
            answer = bob.request(method, where, json={} if method == "PATCH" else None)
            assert answer.status_code == 404, (method, where)
        by_id = {"design": design["id"]}
        for body in ({"mission": by_id, "fsms": [{"fsm": FSM}]}, {"mission": MISSION, "fsms": [by_id]}):
            assert bob.post("/api/v1/fsms/replay", json=body).status_code == 404
        assert design["id"] not in bob.get("/api/v1/designs").text
        assert client.get(path).status_code == 200  # an administrator

    def test_find(self, ann, bob):
        design = save(ann, "Unusual", shared=True)
        for query in ("text=unus", "owner=ann&text=aggreg", "shared=true"):
            found = bob.get(f"/api/v1/designs?{query}").json()
            assert found["designs"][0] == design, query
        assert bob.get("/api/v1/designs?text=unus&offset=1").json() == {"designs": [], "total": 1}
        assert bob.get("/api/v1/designs?owner=bob").json()["total"] == 0


class TestFiles:
    def test_a_service_that_starts_again_knows_them(self, ann, service):
        design = save(ann, "kept", shared=True)
        again = Designs(service.data / ".service" / "designs", UserLimits())
        assert again.get(design["id"]) == service.designs.get(design["id"])

    def test_what_cannot_be_read_is_left_out(self, tmp_path, caplog):
        for name, text in (("a", "{"), ("b", "[" * 5000), ("c", '{"id": "x"}'), ("d", "")):
            (tmp_path / name).mkdir()
            (tmp_path / name / "design.json").write_text(text)
        assert Designs(tmp_path, UserLimits()).find(None) == []
        assert len(caplog.messages) == 4

    def test_limit(self, service, ann, tmp_path):
        design = service.designs.get(save(ann)["id"])
        few = Designs(tmp_path / "designs", UserLimits(designs=1))
        few.create(design, FSM, "")
        with pytest.raises(LimitReached, match="at most 1 designs of ann, found 1"):
            few.create(design, FSM, "")
