"""mdesign record: the trace of one experiment."""

from pathlib import Path
from typing import Unpack

import click

from mercator_design.cli.inputs import Given, simulator_of, warn_of_mission, warn_of_no_effect
from mercator_design.cli.options import CONTROLLER, MISSION, FileOf, seed_of
from mercator_design.command import FSM, print_message, print_result, read_controller
from mercator_design.errors import printable
from mercator_design.show.text.missions import scores_text
from mercator_design.show.text.recording import FORMATS, check_size, write_recording
from mercator_design.sim.devices import DEVICES
from mercator_design.system.files import replacing, writing


@click.command()
@click.argument("fsm", type=FSM)
@click.option("-o", "--output", required=True, type=FileOf(*FORMATS), help="File, .csv or .npz.")
@click.option(
    "--devices", default="", metavar="NAME,...", help="Devices to record besides poses and states, e.g. imu,lidar."
)
@click.option(
    "--every",
    type=click.IntRange(1, 10**9),
    default=1,
    show_default=True,
    help="Record every N-th cycle, and the last.",
)
@click.option("--turns", is_flag=True, help="Record also each lidar's turns, with beams at their own times (.npz).")
@MISSION
@seed_of("Seed of the experiment: one of the `seeds` that evaluate --json lists.")
@CONTROLLER
def record(
    fsm: Path,
    output: Path,
    devices: str,
    every: int,
    turns: bool,
    seed: int,
    flavour: str | None,
    lenient: bool,
    **given: Unpack[Given],
) -> None:
    """Run one experiment and write its trace: poses, states and the readings of devices, with time stamps.

    FSM may also be a run folder, whose winner then runs.

    --turns adds to an .npz file what maps are made of: turns of the lidars, whose beams leave one after the other, and
    samples of the odometry, with its drift.

    Devices: wheels, leds, ground, ground_sensors, neighbours, neighbour_places, light, light_sensors, proximity,
    proximity_weights, lidar, lidar_points, ambient_light, velocity, accelerometer, gyroscope, imu, locator,
    quaternion. docs/reference/recorded-devices.md describes them.
    """
    names = list(dict.fromkeys(name.strip() for name in devices.split(",") if name.strip()))
    for name in names:
        if name not in DEVICES:
            raise click.BadParameter(f"expected a device: {', '.join(DEVICES)}, found '{name}'", param_hint="--devices")
    if turns and output.suffix.lower() != ".npz":
        raise click.UsageError(f"--turns: expected an --output that ends in .npz, found {output}")
    file = read_controller(fsm, flavour, lenient=lenient)
    simulator = simulator_of(fsm, file, given)
    loaded = simulator.mission
    warn_of_mission(simulator, refuse=False)
    warn_of_no_effect(simulator, file.software.flavour, file.software)
    rehearsal = simulator.rehearse(announce=print_message)
    if turns and not len(rehearsal.scene.lidar.outlines):
        print_message(
            f"Warning: {loaded.name}: lidars look over all walls and see only robots, so there is nothing to map"
        )
    check_size(rehearsal, names, cycles=loaded.cycles, every=every, with_turns=turns)
    with writing(output), replacing(output) as stream:
        outcome = simulator.run(file.software, seed, record=True)
        recording = outcome.recording if turns else None
        write_recording(stream, outcome.trace, names, every=every, suffix=output.suffix.lower(), turns=recording)
    print_result(printable(f"{output}: {loaded.name}, seed {seed}, {scores_text(loaded, outcome.scored)}"))
