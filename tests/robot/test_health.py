"""How much of what a line brings arrives whole, and when that matters; what the RVR says of battery and motors."""

import random

import pytest

from mercator_design.errors import RobotStopped
from mercator_design.robot.devices.health import (
    ANSWER_LIMIT,
    ANSWERS_WINDOW,
    MIN_ANSWERS,
    WINDOW,
    Answers,
    LineHealth,
    RvrHealth,
)
from mercator_design.robot.devices.settings import Limits


def look(line, since, seconds, lost):
    """What is said while a share of 1000 bytes a second is lost; and when that is over."""
    said = []
    for _ in range(round(20 * seconds)):
        now, gone, came = since
        since = now + 0.05, gone + 50.0 * lost, came + 50.0
        said.append(line.check(*since))
    return [each for each in said if each is not None], since


def test_a_line_that_is_well_says_nothing():
    line = LineHealth(0.8)
    assert line.share == 1.0
    assert look(line, (5.0, 400.0, 1000.0), 10.0, 0.0)[0] == []
    assert (line.share, line.is_broken) == (1.0, False)


def test_damage_is_reported_when_it_begins_to_matter_and_when_it_is_over():
    line = LineHealth(0.8)
    said, since = look(line, (0.0, 0.0, 0.0), 5.0, 0.15)
    assert (said, line.is_broken) == ([True], False)
    assert line.share == pytest.approx(0.85)
    said, since = look(line, since, 5.0, 0.07)  # better, but not well
    assert said == []
    said, since = look(line, since, 5.0, 0.25)
    assert (said, line.is_broken) == ([], True)
    said, since = look(line, since, WINDOW + 4.0, 0.0)
    assert (said, line.is_broken, line.share) == ([], False, 1.0)
    assert look(line, since, 2.0, 0.0)[0] == [False]


def test_the_same_trouble_is_reported_once_though_the_counts_begin_anew():
    """As when a program was held up: what is told is the same trouble until the line was well for a while."""
    line = LineHealth(0.8)
    said, (now, _, _) = look(line, (0.0, 0.0, 0.0), 3.0, 0.15)
    assert said == [True]
    for _ in range(3):
        line.forget()
        assert (line.share, line.is_broken) == (1.0, False)
        said, (now, _, _) = look(line, (now + 8.0, 0.0, 0.0), 3.0, 0.15)
        assert said == []
    line.forget()
    said, since = look(line, (now + 8.0, 0.0, 0.0), 4.0, 0.0)
    assert said == []  # it has not been seen for long enough that it is well
    assert look(line, since, 2.0, 0.0)[0] == [False]


def test_a_line_breaks_within_the_window():
    line = LineHealth(0.8)
    _, since = look(line, (0.0, 0.0, 0.0), 5.0, 0.0)
    began = since[0]
    while not line.is_broken:
        _, since = look(line, since, 0.05, 0.5)
    assert 0.2 < since[0] - began < WINDOW
    assert look(line, since, WINDOW + 0.2, 0.0)[1]
    assert not line.is_broken


def test_after_a_long_time_without_a_look_only_what_comes_then_counts():
    line = LineHealth(0.8)
    _, (now, lost, came) = look(line, (0.0, 0.0, 0.0), 5.0, 0.5)
    line.check(now + 60.0, lost + 1e6, came + 1e6)
    assert line.share == 1.0


def test_notes_of_a_share_that_varies_by_chance_are_few():
    line, draws = LineHealth(0.8), random.Random(1)
    now = lost = came = 0.0
    said = []
    for _ in range(6000):  # ten minutes at the edge
        now, lost, came = now + 0.1, lost + (draws.random() < 0.1), came + 1.0
        said.append(line.check(now, lost, came))
    assert sum(each is not None for each in said) < 60


class TestAnswers:
    def test_what_is_answered_in_time_is_not_lost(self):
        answers = Answers()
        for number in range(10):
            answers.send(number, 0.1 * number)
        for number in range(8):
            answers.take(number, is_damaged=number == 3)
        answers.check(0.79 + ANSWER_LIMIT)
        assert (answers.all, answers.lost) == (8, 1)  # of the last two it is not known yet
        answers.check(0.81 + ANSWER_LIMIT)
        assert (answers.all, answers.lost) == (9, 2)
        answers.take(8, is_damaged=False)  # too late
        answers.take(77, is_damaged=True)  # to something else
        assert (answers.all, answers.lost) == (9, 2)

    def test_a_number_that_comes_again_is_the_new_command_s(self):
        answers = Answers()
        answers.send(1, 0.0)
        answers.send(2, 0.1)
        answers.send(1, 0.2)
        answers.check(0.15 + ANSWER_LIMIT)
        assert (answers.all, answers.lost) == (1, 1)

    def test_what_nobody_listened_for_is_not_lost(self):
        answers = Answers()
        answers.send(1, 0.0)
        answers.forget()
        answers.check(10.0)
        assert (answers.all, answers.lost) == (0, 0)

    @staticmethod
    def run(seconds, lost, draws, line):
        """Fourteen commands a second; when the line is broken [s], and how often something was told."""
        told = missed = 0
        for cycle in range(round(14 * seconds)):
            missed += draws.random() < lost
            told += line.check(cycle / 14, missed, cycle + 1) is not None
            if line.is_broken:
                return cycle / 14, told
        return seconds, told

    def test_one_command_in_twenty_may_be_lost_for_ten_minutes(self):
        """Of 70 in a window 15 would have to be: a chance of 2e-6 a window, of which there are 120."""
        line = LineHealth(0.8, ANSWERS_WINDOW, MIN_ANSWERS)
        assert self.run(600.0, 0.05, random.Random(3), line)[0] == 600.0

    @pytest.mark.parametrize(("lost", "within"), [(1.0, 1.1), (0.5, 3.5), (0.3, 10.0)])
    def test_a_robot_that_hears_too_little_is_stopped(self, lost, within):
        """The commands that are lost are those of the seed."""
        line = LineHealth(0.8, ANSWERS_WINDOW, MIN_ANSWERS)
        assert self.run(60.0, lost, random.Random(3), line)[0] < within

    def test_a_few_lost_commands_of_few_say_little(self):
        """Three a second, as of a robot at rest: not those that one question after the battery makes."""
        line = LineHealth(0.8, ANSWERS_WINDOW, MIN_ANSWERS)
        for second in range(20):
            assert line.check(second, 3.0 * (second >= 10), 3.0 * second) is None
        assert not line.is_broken


def heat(left, right, left_state, right_state):
    return {
        "left_motor_temperature": left,
        "left_motor_status": left_state,
        "right_motor_temperature": right,
        "right_motor_status": right_state,
    }


class TestRvr:
    @pytest.fixture
    def rvr(self):
        return RvrHealth(Limits(battery_low=20.0, battery_critical=5.0, stall=2.0))

    def test_a_battery_that_gets_low_is_reported_once(self, rvr):
        levels = [87, 21, 20, 19, 18, 21, 19, 22, 19]
        told = [[*rvr.take("get_battery_percentage", {"percentage": level})] for level in levels]
        low = ["rvr: the battery is low (19 %); charge it soon"]
        assert told == [[], [], [], low, [], [], [], [], low]

    def test_so_is_one_of_which_the_rvr_says_so(self, rvr):
        assert [*rvr.take("battery_voltage_state_change", {"state": 2})] == ["rvr: the battery is low; charge it soon"]
        assert [*rvr.take("get_battery_voltage_state", {"state": 2})] == []
        assert [*rvr.take("get_battery_percentage", {"percentage": 33})] == []

    @pytest.mark.parametrize(
        ("name", "values", "words"),
        [
            ("get_battery_percentage", {"percentage": 4}, r"^rvr: the battery is critical \(4 %\); charge it$"),
            ("get_battery_voltage_state", {"state": 3}, "^rvr: the battery is critical; charge it$"),
            ("battery_voltage_state_change", {"state": 3}, "^rvr: the battery is critical; charge it$"),
            (
                "motor_thermal_protection_status",
                heat(30.0, 81.6, 0, 2),
                r"^rvr: the right motor is too hot \(82 degrees\); let it cool, and leave the RVR switched on$",
            ),
            ("get_motor_thermal_protection_status", heat(75.0, 30.0, 2, 0), "^rvr: the left motor is too hot"),
            ("motor_fault", {"is_fault": True}, "^rvr: a motor has a fault$"),
            ("get_motor_fault_state", {"is_fault": True}, "^rvr: a motor has a fault$"),
            ("did_sleep", {}, "^rvr: it fell asleep$"),
        ],
    )
    def test_what_stops_it(self, rvr, name, values, words):
        with pytest.raises(RobotStopped, match=words):
            [*rvr.take(name, values)]

    def test_a_hot_motor_is_reported_when_that_changes(self, rvr):
        told = [
            [*rvr.take("motor_thermal_protection_status", heat(*each))]
            for each in [(30, 30, 0, 0), (62, 30, 1, 0), (63, 61, 1, 1), (50, 61, 0, 1)]
        ]
        assert told == [
            [],
            ["rvr: the left motor is hot (62 degrees)"],
            ["rvr: the right motor is hot (61 degrees)"],
            ["rvr: the left motor is no longer hot (50 degrees)"],
        ]

    def test_a_stuck_tread_stops_it_after_a_while(self, rvr):
        rvr.check(10.0)
        told = [*rvr.take("motor_stall", {"motor_index": 1, "is_triggered": True})]
        assert told == ["rvr: the right tread is stuck"]
        rvr.check(11.9)
        with pytest.raises(RobotStopped, match=r"^rvr: the right tread is stuck for 2.1 s; the limit is 2 s; free it$"):
            rvr.check(12.1)

    def test_one_that_gets_free_does_not(self, rvr):
        now = 0.0
        for _ in range(10):
            for is_stuck in (True, False):
                [*rvr.take("motor_stall", {"motor_index": 0, "is_triggered": is_stuck})]
                for _ in range(15):
                    now += 0.1
                    rvr.check(now)

    def test_one_that_the_rvr_tries_again_and_again_does(self, rvr):
        """Stuck for 1.5 s, and free for half a second in between."""
        now = 0.0

        def tries():
            nonlocal now
            for is_stuck, cycles in ((True, 15), (False, 5)):
                [*rvr.take("motor_stall", {"motor_index": 0, "is_triggered": is_stuck})]
                for _ in range(cycles):
                    now += 0.1
                    rvr.check(now)

        tries()
        with pytest.raises(RobotStopped, match="left tread is stuck"):
            tries()

    def test_what_has_no_values_says_nothing(self, rvr):
        for name in (
            "get_battery_percentage",
            "get_battery_voltage_state",
            "get_motor_thermal_protection_status",
            "get_motor_fault_state",
        ):
            assert [*rvr.take(name, {})] == []
