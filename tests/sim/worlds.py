"""Small missions for tests."""

from mercator_design.fsm import parse
from mercator_design.missions.mission import parse_mission
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator

STOP = parse("--nstates 1 --s0 1")

TEXT = """
schema: 1
robots: {robots}
duration: {duration}
arena:
  walls: {{shape: regular_polygon, sides: {sides}, apothem: {apothem}}}
  obstacles: {obstacles}
floor: {floor}
placement: {placement}
objective: {{name: cell_age, direction: minimise, side: 2.5, cells: 10}}
"""


def mission(
    *,
    robots=1,
    duration=10,
    sides=12,
    apothem=1.226,
    obstacles="[]",
    floor="{background: gray}",
    placement="{shape: disc, radius: 1.0}",
    overrides=(),
):
    return parse_mission(
        TEXT.format(
            robots=robots,
            duration=duration,
            sides=sides,
            apothem=apothem,
            obstacles=obstacles,
            floor=floor,
            placement=placement,
        ),
        overrides=overrides,
    )


def simulator(*, robot_model=None, **given):
    return Simulator(mission(**given), robot_model or load_robot_model("mercator"))


def look(robot_model=None, **given):
    """What robots that stand still have perceived and measured after a cycle: its `Outcome`."""
    return simulator(robot_model=robot_model, **{"duration": 0.1, **given}).run(STOP, 1, record=True)


def at(*poses):
    """A placement at exact poses."""
    return "{shape: poses, poses: [" + ", ".join(f"[{x}, {y}, {heading}]" for x, y, heading in poses) + "]}"
