"""The verb `twin`."""

from pathlib import Path

import click

from mercator_design.cli.options import PLUGIN, ROBOT_MODEL, SET, seed_of
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import FILE, NumberRange, print_message, print_result
from mercator_design.jit import announced, compiling
from mercator_design.missions.mission import load_mission
from mercator_design.robot.run.safety import raise_priority
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import robot_model_of
from mercator_design.twin.arena import TwinArena, without_noise
from mercator_design.twin.faults import Script, read_script
from mercator_design.twin.folder import open_log, usual_folder
from mercator_design.twin.terminals import Terminals
from mercator_design.twin.twin import Twin

_PRIORITY = 3
"""Higher than that of runs and their watchdogs: the devices of a real robot do not wait for its computer."""


@click.command()
@click.argument("mission")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of ports, robot.yaml files and the log.  [default: mercator-twin in the user's runtime directory]",
)
@click.option("--faults", type=FILE, metavar="FILE.yaml", help="Script of faults.")
@click.option("--duration", type=NumberRange(min=0.0, min_open=True), help="Seconds to run.  [default: until Ctrl-C]")
@click.option("--no-noise", is_flag=True, help="Simulate sensors and treads without noise.")
@seed_of("Seed of starting poses and noise.")
@ROBOT_MODEL
@SET
@PLUGIN
def twin(
    mission: str,
    folder: Path | None,
    faults: Path | None,
    duration: float | None,
    no_noise: bool,
    seed: int,
    robot_model: str | None,
    overrides: tuple[str, ...],
) -> None:
    """Simulate the devices of robots in MISSION's arena, in real time, behind serial ports.

    The ports of robot N are FOLDER/N/rvr, lidar and proximity; FOLDER/N/robot.yaml names them. FOLDER/twin.jsonl is the
    log, with one event a line. Ctrl-C or SIGTERM ends the twin. It runs with real-time priority if that is permitted,
    and warns if it is late.
    """
    script = read_script(faults) if faults is not None else Script()
    loaded = load_mission(mission, overrides)
    model = load_robot_model(robot_model) if robot_model else robot_model_of(loaded)
    if no_noise:
        model = without_noise(model)
    place = usual_folder() if folder is None else folder
    with announced(lambda: print_message(compiling("the twin"))):
        arena = TwinArena(loaded, model, seed)
        with open_log(place) as log:
            terminals = Terminals(Twin(arena, script, log), place)
            terminals.check()
            TwinArena(loaded, model, seed).rehearse()  # compiles; signals end this at once
            with Interrupt() as interrupt, terminals:
                raise_priority(_PRIORITY)
                for number, file in enumerate(terminals.robots):
                    print_result(f"robot {number}: {file}")
                timing = terminals.run(
                    lambda now: interrupt.came() or (duration is not None and now >= duration), print_message
                )
    print_message(
        f"{timing.duration:.1f} s, {timing.cpu:.2f} s of a core for each second; "
        f"at most {1000 * timing.latest:.0f} ms late; {timing.dropped} bytes not read"
    )
