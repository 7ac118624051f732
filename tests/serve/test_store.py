from dataclasses import replace

import pytest

from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.jobs.store import Store
from mercator_design.serve.settings import ServiceError

REQUEST = RaceRequest(mission="aggregation", budget=100)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path)


def create(store, *, text=None, **given):
    request = replace(REQUEST, mission="" if text else "aggregation", mission_text=text)
    return store.create(**{"owner": "ann", "name": "a test", "direction": "maximise", "request": request} | given)


def test_a_job_is_read_as_it_was_created(store):
    job = create(store, text="robots: 3\n", key="k")
    assert (store.read(job.id), store.ids()) == (job, [job.id])
    assert (job.id.startswith("a-test-"), job.owner, job.key) == (True, "ann", "k")
    assert store.request(job.id) == replace(REQUEST, mission="", mission_text="robots: 3\n")
    assert "robots: 3" not in store.file(job.id).read_text()  # the text has a file of its own


def test_a_shipped_mission_has_no_text(store):
    assert store.request(create(store).id) == REQUEST


def test_changes_are_there_after_a_restart(store):
    job = create(store)
    changed = store.update(job.id, wish="pause", shared=True)
    assert (changed.wish, changed.shared) == ("pause", True)
    assert Store(store.data).read(job.id) == changed


def test_a_job_is_not_written_if_nothing_changes(store, monkeypatch):
    job = create(store)
    monkeypatch.setattr(store, "write", lambda _job: pytest.fail("it was written"))
    assert store.update(job.id) == store.update(job.id, request=REQUEST, shared=False) == job


@pytest.mark.parametrize("wrong", [{"name": "../up"}, {"name": ""}, {"request": RaceRequest(mission="aac", budget=-1)}])
def test_what_is_not_valid_leaves_nothing(store, wrong):
    with pytest.raises(ServiceError, match=r"job\.json"):
        create(store, **wrong)
    assert list((store.data / ".service/jobs").iterdir()) == []


def test_a_job_in_the_folder_of_another_is_damaged(store):
    job = create(store)
    store.folder(job.id).rename(store.folder("other"))
    with pytest.raises(ServiceError, match=f"expected other, as its folder, found {job.id}"):
        store.read("other")


def test_a_damaged_text_is_said(store):
    job = create(store, text="x")
    (store.folder(job.id) / "mission.yaml").write_bytes(b"\xff")
    with pytest.raises(ServiceError, match=r"mission\.yaml"):
        store.request(job.id)


def test_deletion_takes_the_run_folder(store):
    job, other = create(store), create(store)
    (store.run_folder(job.id) / "replays").mkdir(parents=True)
    store.delete(job.id)
    assert store.ids() == [other.id]
    assert sorted(path.name for path in store.data.rglob("*")) == sorted([".service", "jobs", other.id, "job.json"])


def test_a_deletion_that_was_cut_off_is_finished_at_the_next_start(store):
    job, other = create(store), create(store)
    store.run_folder(job.id).mkdir()
    store.file(job.id).unlink()
    assert store.ids() == [other.id]
    again = Store(store.data)
    again.finish_deletions()
    assert (again.ids(), again.run_folder(job.id).exists()) == ([other.id], False)
    assert [path.name for path in store.folder(other.id).parent.iterdir()] == [other.id]


def test_a_run_folder_that_cannot_be_deleted_is_not_shown_to_all(store, monkeypatch):
    job = create(store)
    store.run_folder(job.id).mkdir()
    (store.run_folder(job.id) / "journal.jsonl").touch()
    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", lambda *_, **__: None)
        store.delete(job.id)
    assert (store.ids(), [*store.others()]) == ([], [])
    store.finish_deletions()
    assert not store.run_folder(job.id).exists()


def test_others_are_run_folders_of_no_job(store):
    job = create(store)
    for name in (job.id, "race", ".hidden", "empty"):
        (store.data / name).mkdir()
        if name != "empty":
            (store.data / name / "journal.jsonl").touch()
    assert [path.name for path in store.others()] == ["race"]
