"""What holds of all executors."""

import contextlib

import pytest

from mercator_design.errors import MissionError, RaceError
from mercator_design.race.executors.executor import ExecutorStopped, Failed, WorkerUnfit, in_order
from mercator_design.race.session.record import Record
from tests.race.racing import runner, undisturbed
from tests.race.work import FailsInSteps, Refused, fails, leaves, slow, square


class Conformance:
    """Of each: the fixture `make` makes one; `executor` is one for all tests."""

    @pytest.fixture(scope="class")
    @classmethod
    def executor(cls, make):
        with make() as executor:
            yield executor

    def test_every_item_has_its_result(self, executor):
        for _ in range(2):  # and the executor can be used again
            assert dict(executor.run(square, range(50))) == {k: k * k for k in range(50)}
        assert list(executor.run(square, [])) == []
        assert in_order(executor, square, range(7)) == [0, 1, 4, 9, 16, 25, 36]

    def test_a_function_with_steps_gives_what_its_calls_give(self, executor):
        results = dict(executor.run(FailsInSteps(), range(20)))
        failed = {k: result.reason for k, result in results.items() if isinstance(result, Failed)}
        assert failed == {3: "ValueError: first step", 4: "ValueError: second step", 5: "ValueError: last step"}
        assert {k: result for k, result in results.items() if k not in failed} == {
            k: 2 * k for k in range(20) if k not in failed
        }

    def test_what_fails_is_reported_and_hurts_nothing_else(self, executor):
        results = dict(executor.run(fails, range(8)))
        failed = {k: result for k, result in results.items() if isinstance(result, Failed)}
        assert {k: failure.reason.partition(":")[0] for k, failure in failed.items()} == {
            3: "MissionError", 4: "ZeroDivisionError", 5: "Stubborn",
        }  # fmt: skip
        assert isinstance(failed[3].error, MissionError)
        assert str(failed[3].error) == "three is not allowed"
        assert {k: result for k, result in results.items() if k not in failed} == {k: k for k in (0, 1, 2, 6, 7)}
        with pytest.raises(MissionError, match="three is not allowed"):
            in_order(executor, fails, range(4))

    def test_what_would_end_the_program_is_a_failure_too(self, executor):
        for _ in range(2):  # and no thread or worker is missing afterwards
            results = dict(executor.run(leaves, range(8)))
            failed = {k: result.reason for k, result in results.items() if isinstance(result, Failed)}
            assert failed == {1: "SystemExit: 0", 2: "KeyboardInterrupt", 3: "Leave: now", 4: "Mute"}
            assert {k: result for k, result in results.items() if k not in failed} == {k: k for k in (0, 5, 6, 7)}
        with pytest.raises(RaceError, match="an experiment failed: SystemExit: 0"):
            in_order(executor, leaves, range(2))

    def test_items_are_drawn_when_there_is_room(self, executor):
        drawn = []

        def items():
            for k in range(12):
                drawn.append(k)
                yield k

        for done, _ in enumerate(executor.run(slow, items()), start=1):
            assert len(drawn) - done <= 2 * executor.jobs

    def test_there_may_be_nothing_to_run_until_something_has_finished(self, executor):
        todo, found = [0], []

        def items():
            while len(found) < 20:
                yield todo.pop() if todo else None

        for _, result in executor.run(square, items()):
            found.append(result)
            todo.append(len(found))
        assert found[:20] == [k * k for k in range(20)]

    def test_items_that_end_early(self, executor):
        """What is under way is still given."""
        stopped = False

        def items():
            for k in range(100):
                if stopped:
                    return
                drawn.add(k)
                yield k

        drawn, found = set(), set()
        for k, _ in executor.run(slow, items()):
            found.add(k)
            stopped = len(found) > 10
        assert found == drawn
        assert len(found) < 40

    def test_a_caller_that_goes_away(self, make):
        with contextlib.suppress(RaceError), make() as executor:
            next(executor.run(square, range(1000)))
            raise RaceError("enough")
        with make() as executor:
            results = executor.run(square, range(1000))
            next(results)
            results.close()
            assert dict(executor.run(fails, range(3))) == {0: 0, 1: 1, 2: 2}  # not what was under way before

    def test_a_race_is_the_same(self, executor):
        expected = undisturbed()
        record = Record()
        runner(record, executor).finish()
        assert record.digest() == expected.digest()
        assert record.ends == expected.ends

    def test_a_race_that_is_stopped_keeps_what_was_under_way(self, executor):
        record = Record()
        with pytest.raises(ExecutorStopped):
            runner(record, executor, stopped=lambda: len(record.experiments) > 50).finish()
        assert 50 < len(record.experiments) < 70
        runner(record, executor).finish()
        assert record.digest() == undisturbed().digest()


class WorkersConformance(Conformance):
    """Of those with worker processes."""

    def test_a_worker_that_cannot_run_it_is_no_failure_of_an_experiment(self, executor):
        with pytest.raises(
            WorkerUnfit, match=r"a worker \(process .* cannot run this race: ValueError: another version"
        ):
            list(executor.run(Refused(), range(5)))
        assert in_order(executor, square, range(3)) == [0, 1, 4]
