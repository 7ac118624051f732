"""What modules set beside the wheels, on the robot: lamps, logs and their replay."""

import math

import pytest

from mercator_design.modules import perception
from mercator_design.modules.perception import proximity_weight
from mercator_design.modules.reference import Actions, Readings, ReferenceModel
from mercator_design.robot.logs.log import replay, to_lines
from tests.own_modules import BLINKS, blink, entered
from tests.robot.log_events import read


@pytest.fixture
def blinks(robot):
    """Run a robot whose module sets a colour and a signal in the third cycle; returns the cycles of its log."""
    with entered(blink, **BLINKS):

        def run(values):
            robot.run(f"--nstates 1 --s0 0 {values}", "--flavour", "tested", "--duration", "1")
            assert robot.ended()[0] == 0
            return [event for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle"]

        yield run


def shown(robot):
    """Red, green, blue of a lamp, by what the robot was told."""
    told = [values for _, name, values in robot.devices.commands if name == "set_all_leds"]
    return [tuple(each["led_brightness_values"][:3]) for each in told if each["led_group"] == 0x3FFFFFFF]


def test_lamps_show_what_modules_set(blinks, robot):
    cycles = blinks("--led0 3 --call0 5")
    assert [event["led_colour"] for event in cycles] == [-1, -1] + [3] * (len(cycles) - 2)
    assert [event["signal"] for event in cycles[:4]] == [0, 0, 5, 0]
    lit = [colour for colour in shown(robot) if any(colour)]
    assert set(lit) == {(255, 0, 0)}


def test_lamps_show_the_state_where_no_module_sets_them(robot):
    robot.run("--nstates 1 --s0 1", "--duration", "0.5")
    assert (0, 114, 178) in shown(robot)


def test_a_replay_compares_them(blinks, robot):
    blinks("--led0 3 --call0 5")
    log = robot.folder / "log.jsonl"
    assert {decision.differs for _, decision in replay(log)} == {""}
    events = [*read(log)]
    for name, other in (("led_colour", 2), ("signal", 6)):
        changed = [event | {name: other} if event.get("cycle") == 2 else event for event in events]
        log.write_text("".join(to_lines(changed)))
        differing = [decision.cycle for _, decision in replay(log) if decision.differs]
        assert differing == [2]


def test_a_wrong_number_stops_nothing(blinks, robot):
    cycles = blinks("--led0 7 --call0 0.5")
    assert [event["led_colour"] for event in cycles[:4]] == [-1, -1, None, None]
    assert [event["signal"] for event in cycles[:4]] == [0, 0, None, 0]
    assert math.isclose(cycles[-1]["wheels"][0], 0.5)
    assert not any(map(any, shown(robot)))
    assert {decision.differs for _, decision in replay(robot.folder / "log.jsonl")} == {""}


def perceives(model, readings, memory, u):
    """Drive along a curve."""
    return Actions(0.5 + 0.0 * readings.odometry_x, 0.8 + 0.0 * readings.ranges_0, -1.0, 0.0)


def test_motion_and_ranges_are_those_of_the_devices(robot):
    near = (0.2, 0.1, math.inf, math.inf, 0.3, math.inf, math.inf, 0.15)
    measured = {"locator": (0.3, 0.1), "imu": (0.0, 0.0, 0.5), "proximity": near}
    robot.act(lambda run: run.devices.measured.update(measured))
    with entered(perceives, reads={"heading", "odometry", "ranges"}):
        robot.run("--nstates 1 --s0 0", "--flavour", "tested", "--duration", "2")
        assert robot.ended()[0] == 0, robot.ended()
    cycles = [Readings(*event["readings"]) for event in read(robot.folder / "log.jsonl") if event["event"] == "cycle"]
    assert (cycles[0].heading, perception.ranges(cycles[0])) == (pytest.approx(0.0, abs=1e-5), (0.0,) * 8)
    last = cycles[-1]
    assert (last.heading, last.odometry_x, last.odometry_y) == pytest.approx((0.5, 0.3, 0.1), abs=1e-3)
    weights = [proximity_weight(ReferenceModel(), near[k]) for k in (1, 0, 7, 6, 5, 4, 3, 2)]
    assert perception.ranges(last) == pytest.approx(weights, abs=1e-6)
