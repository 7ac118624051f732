import json
from xml.etree import ElementTree as ET

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import mercator_design as md
from mercator_design.errors import MissionError
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.fsm.text import to_text
from mercator_design.modules.flavour import flavour_of
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers.machines import Machines, compare_fsms, replays, run_experiments
from mercator_design.serve.workers.pool import Busy
from mercator_design.serve.workers.sources import FsmSource, MissionSource
from mercator_design.show.replay import replay_of
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import read_fsm
from tests.serve.machines import FSM, MISSION, STOP, client_of, race_in, short_mission, submitted

pytestmark = pytest.mark.together


@pytest.fixture(scope="module")
def job(client, service):
    return submitted(client, service)


def check(client, fsm, **more):
    answer = client.post("/api/v1/fsms/check", json={"fsm": fsm, **more})
    assert answer.status_code == 200, answer.text
    return answer.json()


class TestModules:
    @pytest.mark.parametrize("flavour", ["watermelon", "chocolate"])
    def test_they_are_those_of_the_tables(self, client, flavour):
        found = client.get("/api/v1/modules", params={"flavour": flavour}).json()
        for kind in ("behaviours", "conditions"):
            assert {one["number"]: one["name"] for one in found[kind]} == {
                number: module.name for number, module in flavour_of(flavour).numbered(kind.removesuffix("s")).items()
            }
            for one in found[kind]:
                assert one["description"].endswith(".")
                assert all(p["low"] <= p["middle"] <= p["high"] and p["description"] for p in one["parameters"])

    def test_parameters_have_units_and_words(self, client):
        found = client.get("/api/v1/modules").json()
        tau = found["behaviours"][0]["parameters"][0]
        assert (tau["name"], tau["unit"], tau["integer"], tau["middle"]) == ("tau", "cycles", True, 50)
        assert tau["description"].startswith("a turn away")
        label = next(one for one in found["conditions"] if one["name"] == "floor colour")["parameters"][1]
        assert label["words"] == ["green", "blue", "red", "yellow"]

    def test_a_flavour_that_does_not_exist(self, client):
        assert client.get("/api/v1/modules?flavour=mint").status_code == 422


class TestCheck:
    def test_a_line(self, client):
        found = check(client, f"  --fsm-config {FSM}")
        assert (found["valid"], found["errors"], found["text"]) == (True, [], FSM)
        picture = ET.fromstring(found["diagram"])  # noqa: S314 - our own
        marks = {
            name: {node.get(name) for node in picture.iter()} - {None} for name in ("data-state", "data-transition")
        }
        assert marks == {"data-state": {"0", "1"}, "data-transition": {"0-0", "1-0"}}
        assert "stands still" in found["explanation"]

    def test_all_forms_are_of_the_same_fsm(self, client):
        found = check(client, FSM)
        assert found["structure"]["states"][0] == {
            "name": "exploration",
            "behaviour": "exploration",
            "tau": 5,
            "transitions": [{"condition": "black floor", "to": "stop", "beta": 0.9}],
        }
        for form in ("file", "yaml", "structure"):
            assert check(client, found[form]) == found, form

    def test_names_of_states_and_the_flavour_are_kept(self, client):
        states = [{"name": "to the light", "behaviour": "phototaxis", "transitions": []}]
        found = check(client, {"flavour": "chocolate", "states": states})
        assert found["text"] == "--nstates 1 --s0 2"
        assert check(client, found["file"])["structure"] == found["structure"]

    def test_all_mistakes_are_found_with_their_places(self, client):
        states = [
            {"name": "a", "behaviour": "exploration", "tau": 500, "transitions": [{"condition": "mist", "to": "b"}]},
            {"name": "a", "behaviour": "stop", "beta": 1},
        ]
        found = check(client, {"states": states})
        assert not found["valid"]
        places = {one.partition(": ")[0] for one in found["errors"]}
        assert places == {"states[0].tau", "states[0].transitions[0].condition", "states[1].beta"}, found["errors"]

    def test_a_mistake_of_a_line(self, client):
        found = check(client, "--nstates 1 --s0 9")
        assert "expected one of 0 exploration" in found["errors"][0]

    def test_an_fsm_of_another_flavour(self, client):
        assert "flavour chocolate" in check(client, "--nstates 1 --s0 5 --rep0 2")["errors"][0]
        assert check(client, "--nstates 1 --s0 5 --rep0 2", flavour="chocolate")["valid"]

    def test_findings_are_those_of_the_mission(self, client):
        line = FSM.replace("--c0x0 0", "--c0x0 2")  # white floor
        assert check(client, line)["findings"] == []
        found = check(client, line, mission=MISSION)["findings"]
        assert "never-fires" in [one["code"] for one in found]

    def test_a_mission_that_is_not_valid(self, client):
        body = {"fsm": FSM, "mission": {"mission_text": "schema: 1\nrobots: -1"}}
        answer = client.post("/api/v1/fsms/check", json=body)
        assert answer.status_code == 422
        assert any("robots" in one for one in answer.json()["errors"])

    @pytest.mark.parametrize(
        "mission", [{}, {"mission": "foraging", "mission_text": "x"}, {"mission": "foraging", "job": "x"}]
    )
    def test_a_mission_is_given_in_one_way(self, client, mission):
        assert client.post("/api/v1/fsms/check", json={"fsm": FSM, "mission": mission}).status_code == 422

    @pytest.mark.parametrize(
        "override", ["robot_model=/etc/passwd", "robot_model=robot_model.yaml", "floor.image.path=x.png"]
    )
    def test_missions_may_not_name_files(self, client, job, override):
        identity, _ = job
        for mission in ({"mission": "foraging"}, {"job": identity}):
            body = {"fsm": FSM, "mission": {**mission, "set": [override]}}
            answer = client.post("/api/v1/fsms/check", json=body)
            assert answer.status_code == 422
            assert "root:" not in answer.text

    def test_the_mission_of_a_job_with_overrides(self, client, job):
        identity, _ = job
        mission = {"job": identity, "set": ["robots=3"]}
        found = client.post(
            "/api/v1/fsms/evaluate", json={"mission": mission, "fsms": [{"fsm": FSM}], "runs": 1}
        ).json()
        assert (found["robots"], found["duration"]) == (3, 3)


HOSTILE = [
    "",
    "\0",
    "--nstates",
    "--nstates 99999999999999999999",
    "--nstates 1 --s0 " + "9" * 60_000,
    "\n" * 60_000,
    "--nstates 1 --s0 1\n--nstates 1 --s0 1",
    "# flavour: mint\n--nstates 1 --s0 1",
    "# state names: <script>\n--nstates 1 --s0 1",
    "{" * 5_000,
    "[" * 30_000,
    "---\n" + "&a [" + "*a," * 1000 + "]",
    "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]",
    "--- !!python/object/apply:os.system ['true']",
    "schema: 1\nstates: [{name: ../../x, behaviour: stop}]",
    "schema: 1\nheader: {flavour: chocolate}\nstates: [{name: x, behaviour: stop}]",
    "\ud800",
    {"states": []},
    {"states": [{"name": "a", "behaviour": "stop"}] * 9},
    {"states": [{"name": "\ud800", "behaviour": "\u202e"}]},
    {"states": [{"name": "a", "behaviour": "exploration", "tau": 10**400}]},
    {"states": [{"name": "a", "behaviour": "exploration", "tau": "NaN"}]},
    {"states": [{"name": "a", "behaviour": "stop", "transitions": [{"condition": "x", "to": "a"}] * 9}]},
    {"states": [{"name": "a", "behaviour": "stop", "transitions": [{"condition": "fixed probability", "to": "a"}]}]},
]


@pytest.mark.parametrize("fsm", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_fsms_are_refused(client, fsm):
    body = json.dumps({"fsm": fsm}).encode()
    answer = client.post("/api/v1/fsms/check", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 422), answer.text
    if answer.status_code == 200:
        assert not answer.json()["valid"]
        assert 0 < len(answer.json()["errors"]) <= 50
        assert all(len(one) < 1000 for one in answer.json()["errors"])


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 100_000,
        b'{"fsm": {"states": ' + b"[" * 500 + b"]" * 500 + b"}}",
        b'{"fsm": 1' + b"0" * 5000 + b"}",
        b'{"fsm": NaN}',
        b'{"fsm": {"states": [{"name": "a", "behaviour": "exploration", "tau": Infinity}]}}',
        b'{"fsm": {"states": [{"name": "a", "behaviour": "exploration", "tau": {"a": 1}}]}}',
        b'{"fsm": {"\\ud800": 1, "states": []}}',
        b"\xff",
    ],
    ids=range(8),
)
def test_hostile_bodies_are_refused(client, body):
    answer = client.post("/api/v1/fsms/check", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 400, 422), answer.text
    assert answer.status_code != 200 or not answer.json()["valid"]


words = st.sampled_from(["exploration", "stop", "attraction", "black floor", "neighbours count", "a", "b", "", "é"])
numbers = st.one_of(st.integers(), st.floats(), words)
extra = st.dictionaries(st.sampled_from(["tau", "alpha", "beta", "xi", "eta", "label", "x"]), numbers, max_size=3)
transitions = st.lists(st.builds(lambda c, t, e: {**e, "condition": c, "to": t}, words, words, extra), max_size=5)
states = st.lists(
    st.builds(lambda n, b, t, e: {**e, "name": n, "behaviour": b, "transitions": t}, words, words, transitions, extra),
    max_size=5,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(fsm=st.one_of(st.text(max_size=200), st.builds(lambda s: {"states": s}, states)))
def test_any_fsm_is_checked_or_refused(client, fsm):
    body = json.dumps({"fsm": fsm}).encode()
    answer = client.post("/api/v1/fsms/check", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 422), answer.text


def evaluate(client, **body):
    return client.post("/api/v1/fsms/evaluate", json={"mission": MISSION, **body})


class TestEvaluate:
    def test_the_figures_are_those_of_mdesign_evaluate(self, client, mdesign, tmp_path):
        for name, text in (("mine", FSM), ("still", STOP)):
            (tmp_path / name).write_text(text)
        given = ("--mission", "aggregation", "--set", "duration=3", "--set", "robots=2", "-n", 5, "--seed", 7)
        _, out, _ = mdesign("evaluate", tmp_path / "mine", tmp_path / "still", *given, "--json", "--progress", "none")
        fsms = [{"name": str(tmp_path / "mine"), "fsm": FSM}, {"name": str(tmp_path / "still"), "fsm": STOP}]
        answer = evaluate(client, fsms=fsms, runs=5, seed=7)
        assert answer.status_code == 200, answer.text
        found = answer.json()
        assert found.pop("chart").startswith("<svg")
        assert found == json.loads(out)

    def test_one_fsm(self, client):
        found = evaluate(client, fsms=[{"fsm": FSM}], runs=1).json()
        assert (found["best"], found["pairs"], found["fsms"][0]["confidence_interval"]) == ("FSM 1", [], None)

    def test_a_job_against_a_text(self, client, job):
        identity, run = job
        fsms = [{"fsm": FSM, "name": "<b>mine"}, {"job": identity}, {"job": identity}]
        found = client.post(
            "/api/v1/fsms/evaluate", json={"mission": {"job": identity}, "fsms": fsms, "runs": 3}
        ).json()
        assert [one["name"] for one in found["fsms"]] == ["<b>mine", identity, f"{identity} (2)"]
        assert found["fsms"][1]["fsm"] == to_text(run.pfsm)
        assert len(found["pairs"]) == 3
        assert "<b>" not in found["chart"]

    def test_pieces_give_what_one_piece_gives(self, client, monkeypatch):
        whole = evaluate(client, fsms=[{"fsm": FSM}, {"fsm": STOP}], runs=4).json()
        monkeypatch.setattr("mercator_design.serve.http.machines.fsms.PART_OF_LIMIT", 0.0)
        assert evaluate(client, fsms=[{"fsm": FSM}, {"fsm": STOP}], runs=4).json() == whole

    def test_one_that_has_begun_waits_for_a_worker(self, client, service, monkeypatch):
        run, asked = service.workers.run, []

        def sometimes_busy(function, *arguments):
            asked.append(function)
            if asked in ([run_experiments] * 2, [*[run_experiments] * 3, compare_fsms]):
                raise Busy("the service is busy")
            if function is run_experiments:
                arguments = (*arguments[:-1], 0.0)  # one experiment at a time
            return run(function, *arguments)

        monkeypatch.setattr(service.workers, "run", sometimes_busy)
        assert evaluate(client, fsms=[{"fsm": FSM}], runs=2).status_code == 200
        assert asked == [run_experiments, run_experiments, run_experiments, compare_fsms, compare_fsms]
        asked[:] = [run_experiments]  # the next one is refused
        assert evaluate(client, fsms=[{"fsm": FSM}], runs=2).status_code == 503

    def test_what_takes_too_long_is_refused(self, client, monkeypatch):
        monkeypatch.setattr("mercator_design.serve.http.machines.fsms.PART_OF_LIMIT", 0.0)
        monkeypatch.setattr("mercator_design.serve.http.machines.fsms.MAX_OF_LIMIT", 0.0)
        answer = evaluate(client, fsms=[{"fsm": FSM}], runs=1000)
        assert answer.status_code == 422
        assert "ask for fewer runs" in answer.json()["errors"][0]

    def test_limits(self, client):
        assert evaluate(client, fsms=[{"fsm": FSM}], runs=1001).status_code == 429
        assert evaluate(client, fsms=[], runs=1).status_code == 422
        assert evaluate(client, fsms=[{"fsm": FSM}] * 7, runs=1).status_code == 422
        assert evaluate(client, fsms=[{"fsm": FSM, "job": "x"}], runs=1).status_code == 422

    def test_a_mistake_says_in_which_fsm_it_is(self, client):
        fsms = [{"fsm": FSM}, {"fsm": "--nstates 1 --s0 2", "name": "my\x1b own"}, {"fsm": "--nstates 1 --s0 9"}]
        (first,) = evaluate(client, fsms=fsms[:2], runs=1).json()["errors"]
        assert first.startswith("my\\x1b own:1: state 0: --att0")
        (second,) = evaluate(client, fsms=[fsms[0], fsms[2]], runs=1).json()["errors"]
        assert second.startswith("FSM 2:1: --s0, ")

    def test_an_fsm_whose_senses_the_robot_lacks(self, client):
        fsm = {"fsm": "--nstates 1 --s0 2", "flavour": "chocolate"}
        answer = evaluate(client, fsms=[fsm], runs=1)
        assert answer.status_code == 422
        assert "needs light" in answer.json()["errors"][0]


class TestReplay:
    def test_it_is_what_the_viewer_plays(self, client):
        body = {"mission": MISSION, "fsms": [{"fsm": FSM, "name": "mine"}, {"fsm": STOP}], "seed": 5}
        found = client.post("/api/v1/fsms/replay", json=body).json()
        simulator = Simulator(short_mission())
        for one, text, name in zip(found, (FSM, STOP), ("mine", "FSM 2"), strict=True):
            title = f"{name} on aggregation, seed 5"
            shown = ShownExperiment.simulated(simulator, md.parse_fsm(text), 5, title=title)
            assert one == json.loads(json.dumps(replay_of(shown)))

    def test_one_that_is_too_long(self, client):
        mission = {"mission": "aggregation_20", "set": ["control_period=0.05", "duration=3600"]}
        answer = client.post("/api/v1/fsms/replay", json={"mission": mission, "fsms": [{"fsm": FSM}]})
        assert answer.status_code == 422
        assert "found 1,440,000" in answer.json()["errors"][0]

    def test_a_floor_that_changes_too_often(self, monkeypatch):
        blink = "{name: schedule, zones: [spot], times: [0.1, 0.2], colors: [white, black], every: 0.2}"
        mission = MissionSource(name="aggregation", overrides=("duration=3", f"floor.dynamics=[{blink}]"))
        machines = Machines(fsms=(FsmSource(name="one", text=STOP),) * 2, mission=mission, limits=UserLimits())
        n = sum(len(one["header"]["floor"]["changes"]) for one in replays(machines, 1))
        monkeypatch.setattr("mercator_design.serve.workers.machines.MAX_CHANGES", n - 1)
        with pytest.raises(MissionError, match=f"at most {n - 1:,} changes of zones in a replay, found {n:,}"):
            replays(machines, 1)

    def test_of_a_job(self, client, job):
        identity, run = job
        (found,) = client.get(f"/api/v1/jobs/{identity}/replay", params={"seed": 3}).json()
        shown = ShownExperiment.simulated(Simulator(short_mission()), run.pfsm, 3)
        assert found["data"] == replay_of(shown)["data"]
        assert found["header"]["score"] == shown.score

    def test_of_a_configuration_of_a_job(self, client, job, service):
        """Also when another one is the best by now."""
        identity, run = job
        raced = RaceStatus(service.store.run_folder(identity)).read_on().configurations
        other = next(one for one in raced if one != run.result.configuration)
        pfsm = to_pfsm(raced[other], "watermelon")
        for number, fsm in ((other, pfsm), (run.result.configuration, run.pfsm)):
            given = {"seed": 3, "configuration": number}
            (found,) = client.get(f"/api/v1/jobs/{identity}/replay", params=given).json()
            assert found["data"] == replay_of(ShownExperiment.simulated(Simulator(short_mission()), fsm, 3))["data"]
        answer = client.get(f"/api/v1/jobs/{identity}/replay", params={"configuration": 10**6})
        assert answer.status_code == 422
        assert "expected the number of a configuration of its race, found 1000000" in answer.text


class TestWinner:
    def test_of_a_race_that_has_ended(self, client, job):
        identity, run = job
        found = client.get(f"/api/v1/jobs/{identity}/winner").json()
        assert found["is_winner"]
        assert found["configuration"] == run.result.configuration
        assert found["fsm"]["text"] == to_text(run.pfsm)
        assert found["fsm"]["structure"]["states"][0]["behaviour"] == run.pfsm.states[0].behaviour

    def test_its_file_is_that_of_the_race(self, client, service, job, tmp_path):
        identity, _ = job
        (tmp_path / "fsm.txt").write_text(client.get(f"/api/v1/jobs/{identity}/winner").json()["fsm"]["file"])
        ours, theirs = read_fsm(tmp_path / "fsm.txt"), read_fsm(service.store.run_folder(identity) / "fsm.txt")
        assert ours.pfsm == theirs.pfsm
        assert ours.header.items() <= theirs.header.items()

    def test_while_the_race_runs(self, client, service, job):
        identity, _ = job
        journal = service.store.run_folder(identity) / "journal.jsonl"
        whole = journal.read_text()
        lines = whole.splitlines(keepends=True)
        first = next(k for k, line in enumerate(lines) if '"event":"iteration"' in line.replace(" ", ""))
        try:
            journal.write_text("".join(lines[: first + 1]))
            found = client.get(f"/api/v1/jobs/{identity}/winner").json()
            assert not found["is_winner"]
            assert found["configuration"] == json.loads(lines[first])["elites"][0]
            journal.write_text("".join(lines[:first]))
            answer = client.get(f"/api/v1/jobs/{identity}/winner")
            assert answer.status_code == 422
            assert "no winner yet" in answer.json()["errors"][0]
        finally:
            journal.write_text(whole)

    def test_of_a_run_folder_that_was_there_before(self, client, service):
        run = race_in(service.data / "old run")
        service.supervisor.reconcile()
        found = client.get("/api/v1/jobs/old run/winner").json()
        assert found["fsm"]["text"] == to_text(run.pfsm)
        assert client.get("/api/v1/jobs/old run/replay").status_code == 200


def test_jobs_of_others_are_not_there(service, job, client):
    identity, _ = job
    bodies = {
        "/fsms/check": {"fsm": FSM, "mission": {"job": identity}},
        "/fsms/evaluate": {"mission": MISSION, "fsms": [{"job": identity}], "runs": 1},
        "/fsms/replay": {"mission": {"job": identity}, "fsms": [{"fsm": FSM}]},
    }
    with client_of(service, "eve") as eve:
        for path, body in bodies.items():
            assert eve.post(f"/api/v1{path}", json=body).status_code == 404, path
        for path in ("winner", "replay"):
            assert eve.get(f"/api/v1/jobs/{identity}/{path}").status_code == 404
        client.patch(f"/api/v1/jobs/{identity}", json={"shared": True})
        assert eve.get(f"/api/v1/jobs/{identity}/winner").status_code == 200
        client.patch(f"/api/v1/jobs/{identity}", json={"shared": False})
