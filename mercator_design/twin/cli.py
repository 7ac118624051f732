"""The verb `twin`."""

from pathlib import Path

import click

from mercator_design.cli.options import PLUGIN, ROBOT_MODEL, SET, seed_of
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import FILE, NumberRange, tell
from mercator_design.errors import RobotError


@click.command(short_help="Run robots that are not there, in real time.")
@click.argument("mission")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("/tmp/twin"),  # noqa: S108 - where people look for it
    show_default=True,
    help="For ports, robot.yaml of each robot, and the log.",
)
@click.option("--faults", type=FILE, metavar="FILE.yaml", help="What goes wrong, and when.")
@click.option("--duration", type=NumberRange(min=0.0, min_open=True), help="Seconds to run.  [default: until Ctrl-C]")
@click.option("--no-noise", is_flag=True, help="What is measured, and what the treads do, is exact.")
@seed_of("Of where the robots stand, and of noise.")
@ROBOT_MODEL
@SET
@PLUGIN
def twin(
    mission: str,
    folder: Path,
    faults: Path | None,
    duration: float | None,
    no_noise: bool,
    seed: int,
    robot_model: str | None,
    overrides: tuple[str, ...],
) -> None:
    """Run robots that are not there: their serial ports, in MISSION's arena, in real time.

    Robot N's ports are FOLDER/N/rvr, lidar and proximity; FOLDER/N/robot.yaml names them. What happens is in
    FOLDER/twin.jsonl, one event a line. Ctrl-C or SIGTERM ends it.
    """
    try:
        from mercator_design.missions.mission import load_mission
        from mercator_design.sim.robot_model import load_robot_model
        from mercator_design.twin.arena import Arena, without_noise
        from mercator_design.twin.faults import Script, read_script
        from mercator_design.twin.terminals import Terminals, open_log
        from mercator_design.twin.twin import Twin
    except ImportError as error:
        raise RobotError(f"a twin needs what the designer needs: {error}; in a checkout: pip install .") from None

    script = read_script(faults) if faults is not None else Script()
    loaded = load_mission(mission, overrides)
    model = load_robot_model(robot_model or loaded.robot_model)
    if no_noise:
        model = without_noise(model)
    Arena(loaded, model, seed).rehearse(tell)  # compiles, which signals may end at once
    with Interrupt() as interrupt, open_log(folder) as log:
        running = Twin(Arena(loaded, model, seed), script, log)
        with Terminals(running, folder) as terminals:
            for number, file in enumerate(terminals.robots):
                click.echo(f"robot {number}: {file}")
            timing = terminals.run(lambda now: interrupt.came() or (duration is not None and now >= duration))
    tell(
        f"{timing.duration:.1f} s, {timing.cpu:.2f} s of a core for each; at most {1000 * timing.latest:.0f} ms late; "
        f"{timing.dropped} bytes that nobody fetched"
    )
