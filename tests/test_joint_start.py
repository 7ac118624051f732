"""A joint start, with a leader, robots and connections that a test has in hand, in a time of its own."""

import heapq
import itertools
import math
import random
import re
import sys
import time
from types import SimpleNamespace

import pytest

from mercator_design.robot.protocols.clocks import Clock, answer, day_of, from_line, probe, to_line
from mercator_design.robot.protocols.joint_start import LEAD, SILENCE, Follower, Leader, Reference
from mercator_design.robot.run.joint import AwaitedStart

CYCLE, PATIENCE = 0.1, 6.0
STEP = 0.02
BLOCK = 50
SEEN = SILENCE + 0.25
"""[s] after which whoever hears nothing has acted, with delays of the connections of these tests."""


class Robot:
    """A follower whose clock is off; it drives from its first cycle until it is stopped."""

    def __init__(self, number, draw):
        self.name, self.follower = f"r{number}", Follower()
        self.off = draw.uniform(-1e5, 1e5)
        self.ready_at = draw.uniform(0.1, 3.0)
        self.is_ready = self.is_dead = False
        self.lateness = 0.0
        self.began, self.rests = math.inf, math.inf

    def step(self, now):
        """What it says at a time of the world's clock."""
        here = now + self.off
        if self.is_dead:
            return
        if not self.is_ready and now >= self.ready_at:
            self.is_ready = True
            yield self.follower.be_ready(here)
        self.follower.check_silence(here)
        at = self.follower.at
        is_due = self.is_ready and at is not None and here >= at + self.lateness and self.began == math.inf
        if is_due and not self.follower.why:
            yield self.follower.begin(here, CYCLE)
            self.began = now if not self.follower.why else math.inf
        if self.follower.why:
            self.rests = min(self.rests, now)

    def moved(self):
        """How long it drove [s]."""
        return 0.0 if self.began == math.inf else self.rests - self.began


class World:
    """A leader and its robots, and what is under way between them.

    faults: By time [s], what happens: ("cut", name), ("dies", name), ("leader dies", "").
    """

    def __init__(self, robots=3, seed=1, faults=(), delay=(0.001, 0.02)):
        self.draw = random.Random(seed)
        self.robots = {robot.name: robot for robot in (Robot(n, self.draw) for n in range(robots))}
        self.leader = Leader(self.robots, 0.0, patience=PATIENCE, cycle=CYCLE, host="desk")
        self.faults, self.delay = sorted(faults), delay
        self.cut, self.is_leader_dead = set(), False
        self.under_way, self.order, self.last = [], itertools.count(), {}
        self.now, self.offered = 0.0, math.inf

    def send(self, to, name, line):
        if name not in self.cut:
            arrives = max(self.now + self.draw.uniform(*self.delay), self.last.get((to, name), 0.0))
            self.last[to, name] = arrives
            heapq.heappush(self.under_way, (arrives, next(self.order), to, name, line))

    def run(self, seconds=13.0):
        while self.now < seconds:
            self.step()
        return self

    def step(self):
        while self.faults and self.faults[0][0] <= self.now:
            self.happens(*self.faults.pop(0)[1:])
        while self.under_way and self.under_way[0][0] <= self.now:
            _, _, to, name, line = heapq.heappop(self.under_way)
            self.arrives(to, name, line)
        for name, robot in self.robots.items():
            for line in robot.step(self.now):
                self.send("leader", name, line)
        if not self.is_leader_dead:
            self.leader.advance(self.now)
            for name, line in self.leader.lines():
                if '"start"' in line:
                    self.offered = min(self.offered, self.now)
                self.send("robot", name, line)
        self.now = round(self.now + STEP, 6)

    def arrives(self, to, name, line):
        robot = self.robots[name]
        if to == "leader" and not self.is_leader_dead:
            self.leader.call_off("killed", name) if line is None else self.leader.receive(name, line.encode(), self.now)
        elif to == "robot" and not robot.is_dead:
            if line is None:
                robot.follower.hang_up()
            elif (said := robot.follower.receive(line.encode(), self.now + robot.off)) is not None:
                self.send("leader", name, said)

    def happens(self, what, name):
        match what:
            case "cut":
                self.cut.add(name)
                self.under_way = [each for each in self.under_way if each[3] != name]
                heapq.heapify(self.under_way)
            case "dies":
                self.send("leader", name, None)
                self.robots[name].is_dead = True
                self.robots[name].rests = min(self.robots[name].rests, self.now)
            case "leader dies":
                for each in self.robots:
                    self.send("robot", each, None)
                self.is_leader_dead = True

    @property
    def start(self):
        """When robots were to begin [s]."""
        return self.offered + LEAD

    def all_run(self):
        return all(robot.moved() == math.inf for robot in self.robots.values())

    def none_moved(self):
        return not any(robot.moved() for robot in self.robots.values())


@pytest.mark.parametrize("robots", [1, 2, 20])
def test_all_begin_within_a_control_cycle_whatever_their_clocks_say(robots):
    world = World(robots).run()
    assert (world.all_run(), world.leader.is_over, world.leader.why) == (True, True, "")
    begins = [robot.began for robot in world.robots.values()]
    assert max(begins) - min(begins) <= 2 * STEP
    spread, uncertainty = world.leader.spread()
    assert abs(spread - (max(begins) - min(begins))) <= uncertainty + 1e-9
    for name, robot in world.robots.items():
        found = world.leader.difference(name)
        assert abs(found.offset + robot.off) <= found.uncertainty + STEP
        assert robot.follower.reference.host == "desk"


@pytest.mark.parametrize("block", range(3))
def test_whatever_fails_whenever_all_run_or_none(block):
    """Nobody moves if a fault is more than SILENCE before the start; none drives on if it is later."""
    outcomes = set()
    for seed in range(BLOCK * block, BLOCK * (block + 1)):
        draw = random.Random(f"fault {seed}")
        when, what, name = draw.uniform(0.0, 9.0), draw.choice(["cut", "dies", "leader dies"]), f"r{draw.randrange(3)}"
        world = World(seed=seed, faults=[(when, what, name)]).run()
        robots = world.robots.values()
        place = seed, when, what, name, world.start
        assert world.leader.is_over or what == "leader dies", place
        have_all_begun = all(robot.began < math.inf for robot in robots)
        if world.all_run() or (world.leader.is_over and not world.leader.why):  # it came in the middle of a run
            assert have_all_begun, place
            outcomes.add("run")
        elif when < world.start - SEEN:
            assert world.none_moved(), place
            outcomes.add("none")
        else:
            for robot in robots:
                # A robot that has heard that all run, and is cut off, cannot be told that another has not heard it.
                is_out_of_reach = what == "cut" and robot.name == name and have_all_begun
                assert robot.rests <= max(when, world.start) + SEEN or not robot.moved() or is_out_of_reach, place
            outcomes.add("stopped")
    assert outcomes == {"run", "none", "stopped"}


def test_a_connection_that_fails_shortly_before_the_start_stops_who_has_begun():
    world = World(faults=[(100.0, "", "")])
    while world.offered == math.inf:
        world.step()
    world.faults = [(world.start - 0.3, "cut", "r1")]
    world.run()
    assert [robot.began < math.inf for robot in world.robots.values()] == [True] * 3
    assert max(robot.moved() for robot in world.robots.values()) < SILENCE
    assert (world.leader.culprit, world.leader.why) == ("r1", "it has not answered for 1 s")
    assert world.robots["r0"].follower.why == "the start was called off: r1: it has not answered for 1 s"
    assert world.robots["r1"].follower.why == "nothing received for 1 s from the computer that starts the robots"


def test_a_robot_that_dies_shortly_before_the_start_keeps_all_others_at_rest():
    world = World(faults=[(100.0, "", "")])
    while world.offered == math.inf:
        world.step()
    world.faults = [(world.start - 0.1, "dies", "r2")]
    assert world.run().none_moved()
    assert world.leader.culprit == "r2"


def test_a_robot_that_is_not_ready_in_time():
    world = World()
    world.robots["r1"].ready_at = math.inf
    assert world.run().none_moved()
    assert (world.leader.culprit, world.leader.why) == ("r1", "it was not ready after 6 s")
    assert all("r1: it was not ready" in world.robots[name].follower.why for name in ("r0", "r2"))


def test_a_robot_that_is_late_is_refused_by_itself_and_stops_the_others():
    world = World()
    world.robots["r1"].lateness = 0.15
    world.run()
    assert world.robots["r1"].moved() == 0.0
    assert 0.0 < max(robot.moved() for robot in world.robots.values()) < 0.3
    assert re.fullmatch(r"the start is late by 0.1[5-7] s: is this computer too busy\?", world.leader.why)


@pytest.mark.parametrize(("lateness", "runs"), [(0.02, True), (0.07, False)])
def test_robots_that_did_not_begin_together_are_stopped(lateness, runs):
    """Each by itself was in time, but not one with the other, as far as clocks tell."""
    world = World(2, delay=(0.01, 0.012))
    world.robots["r1"].lateness = lateness
    world.run()
    assert world.all_run() == runs
    assert runs or ("the robots began " in world.leader.why and "the limit is 100 ms: are" in world.leader.why)
    assert runs or max(robot.moved() for robot in world.robots.values()) < 0.5


def test_a_clock_that_is_not_known_well_enough():
    world = World(delay=(0.06, 0.07)).run()
    assert world.none_moved()
    assert "its clock is known to " in world.leader.why
    assert "the limit is 50 ms: slow connection" in world.leader.why


def test_a_slow_connection_is_slow_most_of_the_time():
    """The answer that took the shortest time counts."""
    assert World(delay=(0.002, 0.08), robots=2).run().all_run()


class TestFollower:
    @pytest.fixture
    def follower(self):
        follower = Follower()
        assert from_line(follower.be_ready(10.0, log="a")) == {"say": "ready", "log": "a"}
        return follower

    @staticmethod
    def start(at, **given):
        return to_line("start", **{"at": at, "host": "desk", "offset": 1.0, "uncertainty": 0.01, **given}).encode()

    def test_from_start_to_confirmed(self, follower):
        said = [follower.receive(self.start(11.0), 10.1), follower.receive(b'{"say": "go"}\n', 10.2)]
        said += [follower.begin(11.0, CYCLE), follower.receive(b'{"say": "confirm"}', 11.1)]
        assert [from_line(line)["say"] for line in said] == ["accepted", "going", "started", "confirmed"]
        follower.check_silence(100.0)
        follower.hang_up()
        assert follower.why == ""
        follower.receive(to_line("stop", why="r2: it fell asleep").encode(), 101.0)
        assert follower.why == "r2: it fell asleep"

    @pytest.mark.parametrize(
        ("line", "why"),
        [
            (start(10.05), "the time of the start came too late: it was 0.05 s ago"),
            (start(100.0), "expected a start within 60 s, found one in 90 s"),
            (start("soon"), "the start: expected a number for at, found 'soon'"),
            (start(None), "the start: expected a number for at, found None"),
            (start(11.0, offset=True), "the start: expected a number for offset, found True"),
            (b'{"say": "start", "at": NaN}', "the start: expected a number for at, found nan"),
        ],
    )
    def test_a_start_that_is_refused(self, follower, line, why):
        assert from_line(follower.receive(line, 10.1)) == {"say": "failed", "why": why}
        assert follower.receive(self.start(12.0), 10.2) is None
        assert from_line(follower.begin(12.0, CYCLE))["say"] == "failed"

    def test_without_go_it_does_not_begin(self, follower):
        assert follower.receive(b'{"say": "go"}', 10.0) is None  # of no start
        follower.receive(self.start(10.5), 10.1)
        why = "the start was not confirmed by all robots in time"
        assert from_line(follower.begin(10.5, CYCLE)) == {"say": "failed", "why": why}

    def test_after_a_silence_it_does_not_begin(self, follower):
        follower.receive(self.start(12.0), 10.1)
        follower.receive(b'{"say": "go"}', 10.2)
        assert (
            from_line(follower.begin(12.0, CYCLE))["why"]
            == "nothing received for 1 s from the computer that starts the robots"
        )

    @pytest.mark.parametrize(
        "line",
        [
            b"Welcome!",
            b"",
            b"[1]",
            b'{"say": 1}',
            b"\xff",
            b"[" * 10_000,
            b'{"say": "sing"}',
            b'{"say": "probe", "sent": NaN}',
        ],
    )
    def test_what_is_no_line_of_a_leader_is_ignored(self, follower, line):
        assert follower.receive(line, 10.1) is None
        assert follower.why == ""

    def test_before_it_is_ready_nobody_need_be_heard(self):
        follower = Follower()
        follower.check_silence(1e6)
        assert follower.why == ""
        follower.hang_up()
        assert follower.why == "the connection to the computer that starts the robots has ended"


class TestLeader:
    @pytest.mark.parametrize(
        ("line", "why"),
        [
            ('{"say": "clock", "sent": 0.5, "monotonic": "now", "day": 1}', "clock: expected a number for monotonic, "),
            ('{"say": "clock", "sent": 1e9, "monotonic": 1, "day": 1}', "clock: expected an answer to a probe sent"),
            ('{"say": "started", "at": null}', "started: expected a number for at, found None"),
            ('{"say": "failed"}', "None"),
        ],
    )
    def test_a_robot_that_says_what_no_robot_says(self, line, why):
        leader = Leader(["a", "b"], 0.0, patience=20.0, cycle=CYCLE, host="desk")
        leader.receive("a", b'{"say": "ready"}', 0.4)
        leader.receive("a", line.encode(), 1.0)
        assert (leader.is_over, leader.culprit, leader.why[: len(why)]) == (True, "a", why)
        assert {name for name, line in leader.lines() if '"stop"' in line} == {"a", "b"}


class TestClock:
    @pytest.mark.parametrize("seed", range(20))
    def test_the_truth_is_within_the_uncertainty(self, seed):
        draw, clock = random.Random(seed), Clock()
        off = draw.uniform(-1e6, 1e6)
        for k in range(50):
            sent = 0.1 * k
            heard = sent + draw.expovariate(50.0)
            received = heard + draw.expovariate(50.0)
            clock.take(from_line(answer(from_line(probe(sent)), heard + off, 0.0)), received)
        assert clock.difference.uncertainty < 0.02
        assert abs(clock.difference.offset + off) <= clock.difference.uncertainty + 1e-9

    def test_nothing_is_known_of_one_that_never_answered(self):
        assert Clock().difference.uncertainty == math.inf


def test_only_words_of_a_start_are_kept():
    leader = Leader(["r0"], 0.0, patience=PATIENCE, cycle=CYCLE, host="desk")
    for word in ("ready", "hello", "goodbye"):
        leader.receive("r0", to_line(word, log="log.jsonl").encode(), 0.0)
    assert leader._robots["r0"].said.keys() == {"ready"}


def interrupt(monkeypatch, lateness):
    """Let time pass after each read of the time of day, which is 5000 s ahead of the monotonic clock."""
    now, late = [100.0], iter(lateness)

    def day():
        read = now[0] + 5000.0
        now[0] += next(late, 0.0)
        return read

    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "time", day)


@pytest.mark.parametrize("lateness", [[0.03], [0.03] * 9, [0.04, 0.03, 0.04] * 4])
def test_clocks_that_are_not_read_at_the_same_time_are_read_again(lateness, monkeypatch):
    """As another program gets the processor between; if it always does, the shortest time of all counts."""
    interrupt(monkeypatch, lateness)
    error = 0.5 * min(lateness) if len(lateness) > 10 else 0.0
    assert day_of(1.0) == pytest.approx(5001.0 - error)


def test_the_offset_in_the_log_is_within_its_uncertainty(monkeypatch):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: 0))
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(fileno=lambda: 1))
    joint = AwaitedStart()
    joint._follower.reference = Reference(host="desk", offset=4993.0, uncertainty=0.0004)
    interrupt(monkeypatch, [0.03])
    assert joint.clock() == ("desk", pytest.approx(7.0, abs=0.0004), 0.0004)
