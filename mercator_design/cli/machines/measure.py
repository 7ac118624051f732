"""Measures the occupancy of a PFSM's states on a mission, for `mdesign fsm show`."""

from pathlib import Path

from mercator_design.api import fresh_instances
from mercator_design.cli.inputs import simulator_of, warn_of_mission
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import print_message
from mercator_design.results.analysis.occupancy import Occupancy, occupancy
from mercator_design.show.text.progress import Display
from mercator_design.software.files import FsmFile


def measured(fsm: Path, file: FsmFile, mission: str, runs: int, seed: int) -> tuple[Occupancy, str]:
    """The occupancy of the states on fresh instances of a mission, and a description of the measurement."""
    simulator = simulator_of(fsm, file, {"mission": mission, "robot_model": None, "overrides": ()})
    warn_of_mission(simulator, refuse=False)
    simulator.check(file.pfsm)
    simulator.rehearse(announce=print_message)
    loaded = simulator.mission
    with Interrupt() as interrupt, Display(f"{loaded.name}: measuring", runs) as display:
        traces = []
        for done, instance in enumerate(fresh_instances(seed, runs)):
            display.show(done)
            interrupt.check(f"{done} of {runs} experiments were done")
            traces.append(simulator.run(file.pfsm, instance).trace)
    words = f"{loaded.name}: {runs} experiments of {loaded.duration:g} s with {loaded.robots} robots"
    return occupancy(traces, len(file.pfsm.states)), words
