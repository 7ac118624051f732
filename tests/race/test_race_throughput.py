"""The benchmark of a race's throughput: simulated workers, and the time in compiled loops."""

from functools import partial

from benchmarks import race_throughput
from benchmarks.race_throughput import TimedExecutor, free_share, measure, simulate_workers
from benchmarks.virtual_workers import Drawn, VirtualExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.runner import RaceRun
from mercator_design.sim import simulate


class Thinking:
    """A clock that goes on when it is told to."""

    now = 0.0

    def __call__(self):
        return self.now


def test_simulated_workers_are_busy_as_long_as_there_are_items():
    executor = VirtualExecutor(2, lambda seconds: (seconds, f"{seconds:g} s"), thinking=Thinking())
    found = list(executor.run(None, [1.0, 3.0, 1.0, 1.0]))
    assert found == [(0, "1 s"), (2, "1 s"), (1, "3 s"), (3, "1 s")]
    assert (executor.now, executor.busy, executor.thought) == (3.0, 6.0, 0.0)


def test_simulated_workers_wait_while_the_caller_thinks():
    thinking = Thinking()
    executor = VirtualExecutor(1, lambda seconds: (seconds, None), thinking=thinking)
    for _ in executor.run(None, [1.0, 1.0, 1.0]):
        thinking.now += 1.5  # one more item waits, which goes on meanwhile
    assert (executor.now, executor.busy, executor.thought) == (5.5, 3.0, 4.5)


def test_workers_go_on_while_another_thread_proposes():
    """It takes 5 s of its own, of which what is upcoming takes 2."""

    class Slow(Drawn):
        def __init__(self):
            super().__init__("halving", 100)
            asks = self.optimizer.ask

            def ask():
                thinking.now += 5.0 * (self.optimizer.upcoming is not None)
                return asks()

            self.optimizer.ask = ask

    thinking, problem = Thinking(), Slow()
    executor = VirtualExecutor(100, lambda item: (2.0, Measurement(item % 97 / 7, "")), thinking=thinking)
    with executor:
        RaceRun(problem, executor).finish()
    n_proposals = thinking.now / 5.0
    assert n_proposals > 1
    assert executor.thought == 0.0
    assert executor.now > 5.0 * n_proposals


def test_items_that_are_not_known_yet_are_asked_for_again():
    def items():
        yield 1.0
        yield None
        assert executor.now == 1.0
        yield 2.0

    executor = VirtualExecutor(4, lambda seconds: (seconds, None), thinking=Thinking())
    assert [place for place, _ in executor.run(None, items())] == [0, 2]
    assert (executor.now, executor.busy) == (3.0, 3.0)


def test_a_race_is_the_same_whatever_the_workers():
    def race(executor):
        problem = Drawn("irace", 200)
        with executor:
            RaceRun(problem, executor).finish()
        return problem.optimizer.best

    bests = [
        race(VirtualExecutor(n, lambda item: (1.0, Measurement(item % 97 / 7, "")), thinking=Thinking()))
        for n in (1, 16)
    ]
    assert bests[0] == bests[1]


def test_simulated_workers_are_printed(capsys):
    simulate_workers("foraging", "random", 16, 200, [1.0, 2.0])
    words = capsys.readouterr().out.split("|")
    assert [word.strip() for word in words[1:4]] == ["foraging", "random", "16"]
    assert 0.3 < float(words[5].strip(" %")) / 100 <= 1


def test_compiled_loops_are_timed(monkeypatch, capsys):
    monkeypatch.setattr(simulate, "compiled", simulate.compiled)
    monkeypatch.setattr(race_throughput, "SMALL", 20)
    monkeypatch.setattr(race_throughput, "free_share", partial(free_share, seconds=0.02))
    found = measure("aggregation", "random", "threads", 1, 30)
    assert len(found.durations) == 30
    assert all(seconds > 0 for seconds in found.durations)
    words = capsys.readouterr().out.split("|")
    assert 0 < float(words[7].strip(" %")) <= 100


def test_what_an_experiment_takes_is_kept_beside_its_result():
    with TimedExecutor(ThreadExecutor(2)) as executor:
        found = sorted(executor.run(lambda x: 2 * x, [1, 2, 3]))
    assert found == [(0, 2), (1, 4), (2, 6)]
    assert len(executor.spent) == 3
    assert executor.cpu_elsewhere() == 0.0
    assert 0 < free_share(1, 0.01) < 1.5
    assert race_throughput.EXECUTORS == ("threads", "processes", "dask")
