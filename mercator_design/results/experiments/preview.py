"""A mission before an experiment: the start of one instance, and the places that robots can reach."""

from typing import NamedTuple

from mercator_design.missions.mission import Mission
from mercator_design.sim.checks.reach import Reach, reach_of
from mercator_design.sim.simulate import Simulator
from mercator_design.sim.world import Instance


class MissionPreview(NamedTuple):
    """A mission at the start of an instance; `reach` is None if it is not known."""

    mission: Mission
    instance: Instance
    reach: Reach | None


def preview_of(simulator: Simulator, *, seed: int) -> MissionPreview:
    """The mission of a simulator at the start of the instance of a seed.

    Raises:
        MissionError: The robots do not fit.
    """
    instance = simulator.instance(seed)
    return MissionPreview(simulator.mission, instance, reach_of(simulator.mission, simulator.robot_model))
