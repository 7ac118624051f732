"""How long a new job will wait, by the rules of the scheduler."""

from mercator_design.serve.jobs.scheduler import remaining_seconds, wait_of
from tests.serve.races import row_of as row


def wait(queued, running, *, owner="ann", priority=0, races=1, max_running=9, seconds=10.0):
    new = row("new", owner, priority=priority)
    found = wait_of(new, queued, running, seconds=lambda _: seconds, races=races, max_running=max_running)
    return found.running, found.queued, found.seconds


def test_nothing_is_before_it():
    assert wait([], []) == (0, 0, 0.0)
    assert wait([], [row("a")], races=2) == (1, 0, 0.0)


def test_older_jobs_of_the_same_user_come_first():
    assert wait([row("a"), row("b")], [row("c")]) == (1, 2, 30.0)


def test_unless_its_priority_is_higher():
    assert wait([row("a"), row("b", priority=5)], [row("c")], priority=1) == (1, 1, 20.0)


def test_users_take_turns():
    others = [row(str(number), "bob") for number in range(50)]
    running, queued, seconds = wait(others, [row("x", "bob")])
    assert (running, seconds) == (1, 10.0 + 10.0 * queued)
    assert queued <= 1


def test_several_races_at_a_time():
    assert wait([row("a"), row("b")], [row("c"), row("d")], races=2) == (2, 2, 20.0)


def test_a_limit_of_running_jobs():
    assert wait([], [row("a")], races=5, max_running=1) == (1, 0, 10.0)


def test_many_jobs_are_not_run_through():
    running, queued, _ = wait([row(str(number)) for number in range(2000)], [])
    assert (running, queued) == (0, 200)


def test_the_time_that_is_left():
    assert remaining_seconds(row("a", budget=100), 2.0) == 200.0
    assert remaining_seconds(row("a", budget=100, experiments=50, seconds=25.0), 2.0) == 25.0
    assert remaining_seconds(row("a", budget=100, experiments=120, seconds=25.0), 2.0) == 0.0
