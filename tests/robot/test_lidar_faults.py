"""Lidars that see nothing, see their own robot, turn slowly, or are no X4: what `check` and `run` say of them."""

import re
from pathlib import Path

import pytest

from mercator_design.errors import SettingsError
from mercator_design.robot.devices.settings import parse_settings
from mercator_design.robot.devices.sight import Sight
from mercator_design.twin.devices.lidar import Hiding, LidarState
from tests.robot.log_events import read
from tests.robot.simulated import START
from tests.robot.ways import ALL, check, write_files
from tests.tiers import some

FOREIGN = bytes.fromhex("aa550002010581052e5755a00f55a40f")
"""A packet with samples of three bytes, the first one an intensity."""
POST = LidarState(hidings=(Hiding(0.14, (81.0, 91.0)),))
HALL = (Hiding(0.0, (100.0, 190.0)),)


def blind(turns=1.0):
    return LidarState(hidings=(Hiding(0.0, turns=turns),))


def sends(devices, data):
    """A lidar that answers as an X4, and sends something else."""
    devices.lidar._packet = lambda first, count, _: data * (count // 2)


@pytest.fixture
def rows(robot_command, simulated, tmp_path, processes):
    """Check a lidar in a state in a room, after robot.yaml's lines; gives the exit code, and marks and words by row."""
    simulated.wall = 2.0

    def run(state=None, settings=""):
        if state is not None:
            simulated.lidar.change(state, simulated.now)
        write_files(tmp_path, simulated.names, "", f"null}}\nlidar: {{blind: [{settings}]")
        code, out, _ = robot_command("check", "--robot", tmp_path / "robot.yaml")
        return code, {row[7:34].strip(): (row[:5].strip(), row[34:]) for row in out.splitlines()}

    return run


class TestCheck:
    def test_a_room(self, rows):
        code, found = rows()
        assert code == 0
        assert found["lidar's sight"] == ("ok", "719 readings in a turn")
        assert {"lidar's surroundings", "lidar's sectors"}.isdisjoint(found)

    @pytest.mark.swept
    @pytest.mark.parametrize("turns", some([0.2, 0.5, 0.9], 1))
    def test_turns_without_a_reading_between_others(self, rows, turns):
        code, found = rows(blind(turns))
        mark, words = found["lidar's sight"]
        assert (code, mark) == (1, "WRONG")
        assert re.match(r"719 readings in a turn, but none in \d+ of 1[34] turns; ", words)
        assert "5 V and 1 A" in words

    @pytest.mark.swept
    @pytest.mark.parametrize("distance", some([0.0, 0.06, 16.0], 1))
    def test_all_turns_without_a_reading(self, rows, distance):
        """Too near or beyond the range of a lidar is no reading either."""
        code, found = rows(LidarState(hidings=(Hiding(distance),)))
        mark, words = found["lidar's sight"]
        assert (code, mark, words[:22]) == (0, "look", "0 readings in a turn; ")
        assert words.endswith("A run that reads neighbours would stop after 5 s (limits.lidar_blind)")

    @pytest.mark.swept
    @pytest.mark.parametrize(
        ("sector", "proposal"),
        some([((100.0, 190.0), "[100, 190]"), ((315.0, 45.0), "[315, 45]"), ((-30.0, 0.0), "[330, 0]")], 2),
    )
    def test_a_blank_sector(self, rows, sector, proposal):
        code, found = rows(LidarState(hidings=(Hiding(0.0, sector),)))
        mark, words = found["lidar's sectors"]
        assert (code, mark) == (0, "look")
        (first, last), (begin, end) = eval(words.partition("blind: [")[2].partition("]}")[0]), eval(proposal)  # noqa: S307
        assert (abs(first - begin) <= 1, abs(last - end) <= 1) == (True, True), words
        _, found = rows(settings=proposal)
        assert "lidar's sectors" not in found

    @pytest.mark.swept
    @pytest.mark.parametrize(
        ("sector", "proposal"),
        some([((81.2, 90.8), "[80, 92]"), ((352.2, 8.8), "[351, 10]"), ((-2.5, 3.5), "[356, 5]")], 2),
    )
    def test_a_part_of_its_own_robot(self, rows, sector, proposal):
        state = LidarState(hidings=(Hiding(0.14, sector),))
        code, found = rows(state)
        mark, words = found["lidar's surroundings"]
        assert (code, mark) == (1, "WRONG")
        assert words.startswith("it sees something at 0.14 m from ")
        assert f"put `lidar: {{blind: [{proposal}]}}` into robot.yaml" in words
        code, found = rows(state, proposal)
        assert code == 0, found
        assert "lidar's surroundings" not in found

    def test_a_cover(self, rows):
        _, found = rows(LidarState(hidings=(Hiding(0.14),)))
        mark, words = found["lidar's surroundings"]
        assert (mark, "all around" in words, "is it covered?" in words) == ("WRONG", True, True)

    @pytest.mark.parametrize("is_alone", [True, False])
    def test_bytes_of_another_model(self, rows, simulated, is_alone):
        """A few of its packets may be valid: those with one sample of range 0."""
        simulated.wall = 0.0
        if is_alone:
            sends(simulated, FOREIGN)
        code, found = rows(None if is_alone else LidarState(has_intensities=True))
        mark, words = found["lidar's line"]
        assert (code, mark) == (1, "WRONG")
        assert re.match(r"0\.[0-9] % arrives whole; ", words)
        assert "another model or mode" in words
        assert {"lidar's turns", "lidar's sight"}.isdisjoint(found)

    @pytest.mark.swept
    @pytest.mark.parametrize(
        ("state", "row", "words"),
        some(
            [
                (LidarState(is_one_way=True), "lidar", "it sends unasked and answers nothing: is it a one-way model"),
                (LidarState(model=5), "lidar", "it is model 5, not an X4 (model 6): "),
                (LidarState(unanswered=frozenset({"device_info"})), "lidar", "it does not answer which model it is"),
                (LidarState(unanswered=frozenset({"health"})), "lidar's health", "it does not answer how it is"),
                (LidarState(unanswered=frozenset({"health", "device_info", "scan"})), "lidar", "is it an X4?"),
                (LidarState(rate=3.9), "lidar's turns", "3.9 a second; slow: an X4 makes 5 to 12."),
            ],
            3,
        ),
    )
    def test_what_a_run_does_not_need(self, rows, state, row, words):
        code, found = rows(state)
        mark, said = found[row]
        assert (code, mark, words in said) == (0, "look", True), found
        assert found["lidar's line"][1].startswith("100.0 % arrives whole; ")

    def test_turns_with_which_a_run_would_stop(self, rows):
        code, found = rows(LidarState(rate=1.5))
        mark, said = found["lidar's turns"]
        assert (code, mark) == (1, "WRONG")
        assert "below 2.1 a run takes it for silent (limits.lidar)" in said

    def test_a_one_way_lidar_of_another_model(self, rows):
        code, found = rows(LidarState(is_one_way=True, has_intensities=True))
        mark, said = found["lidar"]
        assert (code, mark, said[:10]) == (1, "WRONG", "no answer;")
        assert "bytes from it make no sense: another model or mode, another device" in said

    def test_a_lidar_that_answers_and_sends_nothing(self, rows, simulated):
        sends(simulated, b"")
        code, found = rows()
        mark, said = found["lidar's line"]
        assert (code, mark, said[:15]) == (1, "WRONG", "nothing arrives")


class TestRun:
    @pytest.fixture
    def run(self, robot, simulated):
        """Run a PFSM that reads neighbours, with a lidar in a state from a time on; gives what was said."""

        def run(state, code, words, *options, settings="", seconds="9", until=None):
            robot.act(lambda _: simulated.lidar.change(state, simulated.now))
            if until is not None:
                simulated.then(
                    lambda: simulated.now > robot.began - START + until,
                    lambda: simulated.lidar.change(LidarState(), simulated.now),
                )
            robot.run(ALL, "--duration", seconds, *options, settings=settings)
            return check(robot, code, words)

        return run

    @pytest.mark.parametrize("distance", [0.0, 0.06])
    def test_a_lidar_that_sees_nothing_any_more(self, run, robot, distance):
        """What is nearer than any robot is nothing, such as a cover."""
        state = LidarState(hidings=(Hiding(distance),))
        said = run(state, 4, "lidar: it saw nothing in 5.0 of the last 10 s; the limit is 5 s; is there nothing")
        assert "lidar: it has seen nothing for 2 s; is there nothing at its height" in said
        assert robot.late() == pytest.approx(5.0, abs=0.5)

    def test_a_lidar_that_sees_nothing_from_the_start(self, robot, simulated):
        simulated.wall = 0.0
        robot.run(ALL, "--duration", "9")
        said = check(robot, 4, "lidar: it saw nothing in 5.")
        assert "lidar: it has seen nothing for 2 s" in said

    def test_a_lidar_that_sees_something_again(self, run):
        said = run(blind(), 0, "The duration is over", until=3.0)
        assert "lidar: it has seen nothing for 2 s" in said
        assert re.search(r"lidar: it sees something again \(\d+ readings in a turn\)", said)

    @pytest.mark.swept
    @pytest.mark.parametrize(("turns", "code"), some([(0.1, 0), (0.5, 0), (0.75, 4)], 2))
    def test_turns_without_a_reading_between_others(self, run, turns, code):
        """Each is judged; users are told once while it goes on."""
        said = run(blind(turns), code, "" if code else "The duration is over")
        assert len(re.findall(r"between turns with \d+ and 719 readings, so neighbours were missed; has it", said)) == 1
        assert ("it saw nothing in 5." in said) == (code == 4)

    def test_no_limit(self, run):
        run(blind(), 0, "The duration is over", settings="}\nlimits: {lidar_blind: null")

    def test_a_pfsm_that_does_not_read_neighbours(self, robot, simulated):
        simulated.wall = 0.0
        robot.run("--nstates 1 --s0 1", "--duration", "7")
        assert "lidar: it has seen nothing for 2 s" in check(robot, 0, "The duration is over")

    def test_a_part_of_its_own_robot(self, run, robot):
        said = run(POST, 0, "The duration is over")
        assert said.count("it sees something at 0.14 m from 80 to 92 degrees, and takes it for a neighbour;") == 1
        *_, last = (event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle")
        assert len(last["neighbours"]) == 1

    def test_a_sector_that_is_left_out(self, run, robot, simulated):
        """Its readings are no neighbours, those beside it are."""
        simulated.heads = [(1.0, 0.5)]
        said = run(POST, 0, "The duration is over", settings="}\nlidar: {blind: [[80, 92]]")
        assert "takes it for a neighbour" not in said
        *_, last = (event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle")
        ((distance, bearing),) = last["neighbours"]
        assert (distance, bearing) == (pytest.approx(0.5, abs=0.02), pytest.approx(1.0, abs=0.02))

    def test_a_blank_sector(self, run):
        said = run(LidarState(hidings=HALL), 0, "The duration is over")
        assert said.count("lidar: it sees nothing from 100 to 190 degrees, but something in 100 % of the rest;") == 1

    @pytest.mark.parametrize(
        ("state", "words"),
        [
            (LidarState(is_one_way=True), "Warning: lidar: it sends unasked and answers nothing"),
            (LidarState(model=5), "Warning: lidar: it is model 5, not an X4"),
            (LidarState(unanswered=frozenset({"device_info"})), "Warning: lidar: it does not answer which model it is"),
            (LidarState(unanswered=frozenset({"health", "scan"})), "Warning: lidar: it does not answer how it is"),
            (LidarState(rate=3.9), "The duration is over"),
        ],
    )
    def test_what_a_run_does_not_need(self, robot, simulated, state, words):
        simulated.heads = [(1.0, 0.5)]
        simulated.lidar.change(state, simulated.now)
        robot.run(ALL, "--duration", "1")
        assert words in check(robot, 0, "The duration is over")
        *_, last = (event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle")
        assert [distance for distance, _ in last["neighbours"]] == [pytest.approx(0.5, abs=0.02)]

    def test_bytes_of_another_model(self, robot, simulated):
        sends(simulated, FOREIGN)
        robot.run(ALL)
        said = check(robot, 1, "lidar: nothing yet; ", zeros=False)
        assert "another model or mode" in said


@pytest.mark.parametrize(
    ("blind", "words"),
    [
        ("[80, 80]", r"lidar.blind\[0\]: expected two angles, from the first to the second; found \[80, 80\]"),
        ("[0, 360]", r"lidar.blind\[0\]: expected two angles"),
        ("[1, 2], [80, 400]", r"lidar.blind\[1\]\[1\]: expected .*<= 360"),
        ("[80]", r"lidar.blind\[0\]: expected"),
        ("[0, 180], [180, 359.9]", "lidar.blind: expected sectors that leave something to see"),
    ],
)
def test_sectors_that_are_none(blind, words):
    with pytest.raises(SettingsError, match=words):
        parse_settings(f"lidar: {{blind: [{blind}]}}", "robot.yaml", Path())


class TestTurnsOfARobotThatMoves:
    def empty_turn(self, readings, turned):
        """The notes on a turn of the lidar without a reading, in which the robot turned by an angle [rad]."""
        sight = Sight(5.0, (), 0.1)
        for k, (found, heading) in enumerate([(readings, 0.0), (0, turned), (readings, turned)]):
            sight.take(found, [], heading, 0.147 * k)
        return sight.check(0.5)

    @pytest.mark.parametrize("readings", [17, 37])
    def test_the_head_of_one_robot_may_pass_where_a_turn_ends(self, readings):
        assert self.empty_turn(readings, 0.6) == []

    def test_a_room_cannot(self):
        assert "between turns with 719 and 719 readings" in self.empty_turn(719, 0.6)[0]
