"""The copy of a race in an Optuna storage."""

import threading
import time
from types import SimpleNamespace

import optuna
import pytest
import sqlalchemy

from mercator_design.race import IteratedRace
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session import optuna_mirror
from mercator_design.race.session.optuna_mirror import OptunaMirror
from mercator_design.race.session.record import Record
from tests.processes import LIMIT
from tests.race.racing import SPACE, measure, runner, undisturbed
from tests.storages import connections_closed
from tests.tiers import some

pytestmark = pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")


@pytest.fixture
def url(tmp_path):
    with connections_closed():
        yield f"sqlite:///{tmp_path / 'race.db'}"


def mirrored(url, record=None, *, budget=60, seed=1, method="irace", race=None, **options):
    """Race, with a mirror; gives the record and what the mirror complained of."""
    record, complaints = record if record is not None else Record(), []
    race = race or METHODS[method](SPACE, budget=budget, seed=seed)
    executor = ThreadExecutor(2)
    run = runner(record, executor, race=race, seed=seed, **options)
    mirroring = OptunaMirror(url, "study", race, run.view, maximise=False, warn=complaints.append)
    with executor, mirroring as mirror:
        for event in run:
            mirror.note(event)
        mirror.finish(race.best.configuration)
    return record, complaints


def trials_of(url):
    return optuna.load_study(study_name="study", storage=url).trials


def check(url, record):
    """That the study says what the record says: a trial for each configuration, with its number."""
    study = optuna.load_study(study_name="study", storage=url)
    raced = {one.configuration for one in record.experiments.values()}
    elites = {number for ended in record.iterations.values() for number in ended.elites}
    assert [trial.user_attrs["configuration"] for trial in study.trials] == [trial.number for trial in study.trials]
    assert {trial.number for trial in study.trials} == raced
    for trial in study.trials:
        assert trial.params == record.configurations[trial.number]
        own = {one.instance: one.score for one in record.experiments.values() if one.configuration == trial.number}
        assert trial.intermediate_values == own
        assert trial.state.name in ("COMPLETE" if trial.number in elites else "COMPLETE PRUNED")
        if trial.state.name == "COMPLETE":
            assert trial.value == pytest.approx(sum(own.values()) / len(own))
    assert study.user_attrs["winner"] == record.ends[-1].winner
    assert study.trials[record.ends[-1].winner].state.name == "COMPLETE"


def survivors_of(race):
    return {number for summary in race.iterations for number in summary.survivors}


def test_the_study_says_what_happened(url):
    record, complaints = mirrored(url)
    assert complaints == []
    assert record.digest() == undisturbed(budgets=(60,)).digest()
    check(url, record)


def test_no_connection_is_left(url):
    opened, closed = [], []

    def opens(connection, _):
        opened.append(connection)

    def closes(connection, _):
        closed.append(connection)

    sqlalchemy.event.listen(sqlalchemy.Engine, "connect", opens)
    sqlalchemy.event.listen(sqlalchemy.Engine, "close", closes)
    try:
        mirrored(url)
    finally:
        sqlalchemy.event.remove(sqlalchemy.Engine, "connect", opens)
        sqlalchemy.event.remove(sqlalchemy.Engine, "close", closes)
    assert opened
    assert {*map(id, opened)} == {*map(id, closed)}


@pytest.mark.swept
@pytest.mark.parametrize("method", some(METHODS, 1))
def test_whatever_the_method(url, method):
    race = METHODS[method](SPACE, budget=60, seed=1)
    record, complaints = mirrored(url, race=race)
    assert complaints == []
    check(url, record)
    complete = {trial.number for trial in trials_of(url) if trial.state.name == "COMPLETE"}
    elites = {elite.configuration for summary in race.iterations for elite in summary.elites}
    assert complete == survivors_of(race) | elites
    assert len(complete) > 1


@pytest.mark.thorough
def test_optunas_own_tools_show_the_race(url):
    from matplotlib import pyplot as plt
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
    from optuna.visualization import matplotlib

    record, _ = mirrored(url, budget=250, method="irace")
    study = optuna.load_study(study_name="study", storage=url)
    complete = [trial for trial in study.trials if trial.state.name == "COMPLETE"]
    points = matplotlib.plot_optimization_history(study).collections[0]
    plt.close("all")
    assert len(points.get_offsets()) == len(complete) > 4
    assert set(get_param_importances(study, evaluator=PedAnovaImportanceEvaluator())) == {"x", "y", "rule"}
    assert record.ends[-1].winner == study.user_attrs["winner"]


def test_a_race_that_is_resumed_goes_on_in_its_study(url, monkeypatch):
    monkeypatch.setattr(optuna_mirror, "MAX_WAIT_INTERRUPTED", optuna_mirror.MAX_WAIT)
    record = Record()
    race = IteratedRace(SPACE, budget=60, seed=1)
    executor = ThreadExecutor(1)
    run = runner(record, executor, race=race, stopped=lambda: len(record.experiments) > 30)
    mirroring = OptunaMirror(url, "study", race, run.view, maximise=False, warn=pytest.fail)
    with executor, pytest.raises(ExecutorStopped), mirroring as mirror:
        list(map(mirror.note, run))
    before = len(trials_of(url))
    assert before > 5
    record, complaints = mirrored(url, record)
    assert complaints == []
    check(url, record)


def test_a_storage_that_fails_at_once_is_reported_and_stops_nothing(tmp_path):
    record, complaints = mirrored(f"sqlite:///{tmp_path}/nowhere/race.db")
    assert len(complaints) == 1
    assert "the race is no longer copied to the Optuna storage" in complaints[0]
    assert record.digest() == undisturbed(budgets=(60,)).digest()


def test_one_that_fails_later_too(url, monkeypatch):
    reports = []
    report = optuna_mirror._Study.report

    def fails(self, *arguments):
        reports.append(arguments)
        if len(reports) > 10:
            raise OSError("disk full")
        report(self, *arguments)

    monkeypatch.setattr(optuna_mirror._Study, "report", fails)
    record, complaints = mirrored(url)
    assert complaints == ["the race is no longer copied to the Optuna storage: OSError: disk full"]
    assert record.digest() == undisturbed(budgets=(60,)).digest()


def test_one_that_never_answers(url, monkeypatch):
    monkeypatch.setattr(optuna_mirror, "MAX_WAIT", 0.2)
    answered = threading.Event()
    monkeypatch.setattr(optuna_mirror._Study, "report", lambda *_: answered.wait(10 * LIMIT))
    start = time.monotonic()
    record, complaints = mirrored(url)
    assert complaints == ["the Optuna storage is slow: it does not have the whole race"]
    assert time.monotonic() - start < LIMIT
    answered.set()
    assert record.digest() == undisturbed(budgets=(60,)).digest()


def failing(item):
    (x, _, _), _ = item
    if x > 2:
        raise ArithmeticError("too far")
    return measure(item)


def test_what_failed_is_a_failed_trial(url):
    record, complaints = mirrored(url, function=failing, on_failure="reject")
    assert complaints == []
    failed = [t for t in trials_of(url) if t.state is optuna.trial.TrialState.FAIL]
    assert {t.user_attrs["configuration"] for t in failed} == {
        one.configuration for one in record.experiments.values() if one.failure
    }
    assert {t.user_attrs["failure"] for t in failed} == {"ArithmeticError: too far"}


def test_a_race_that_is_resumed_after_its_end_adds_no_trial(url):
    record, _ = mirrored(url, function=failing, on_failure="reject")
    before = trials_of(url)
    assert {"FAIL", "COMPLETE"} <= {trial.state.name for trial in before}
    mirrored(url, record, function=failing, on_failure="reject")
    assert trials_of(url) == before


def test_a_new_configuration_is_not_looked_up_with_all_before_it():
    n_looked_up = 0

    class Counted(dict):
        def __contains__(self, key):
            nonlocal n_looked_up
            n_looked_up += 1
            return super().__contains__(key)

    race = METHODS["halving"](SPACE, budget=300, seed=1)
    n = len({one.configuration for one in race.ask()})
    study = optuna_mirror._Study(None, "study", race, maximise=False)
    study._scores = Counted()
    for number in range(n):
        study.report(SimpleNamespace(configuration=number, instance=0, score=1.0, failure=""))
    assert len(study._scores) == n > 20
    assert n_looked_up <= 3 * n
