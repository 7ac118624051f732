"""mdesign calibrate: the noise of a robot's sensors, from recordings."""

import os
from pathlib import Path

import click

from mercator_design.calibration.sensors import calibrate as fit
from mercator_design.cli.options import JSON, plot_of, seed_of
from mercator_design.cli.terminal import command_line
from mercator_design.command import FILE, OUTPUT_FILE, print_message, print_result
from mercator_design.config.building import is_name
from mercator_design.errors import MercatorError
from mercator_design.show.text.calibration import calibration_json, calibration_page, model_text, save_noise
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.system.files import write_text, writing


@click.command()
@click.argument("recordings", type=FILE, nargs=-1, required=True, metavar="RECORDING...")
@click.option(
    "-o", "--output", type=OUTPUT_FILE, required=True, metavar="MODEL.yaml", help="Robot model to write, a new file."
)
@plot_of("Draw the measured noise and the fitted distributions.")
@click.option(
    "--base", default="mercator", show_default=True, help="Robot model whose noise is measured: a file or name."
)
@click.option("--name", help="Name of the robot model.  [default: the file's]")
@seed_of("Seed of the simulated measurements for intervals and p-values.")
@JSON
def calibrate(
    recordings: tuple[Path, ...],
    output: Path,
    plot: Path | None,
    base: str,
    name: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Fit the noise of a robot's sensors to recordings of `mercator-robot record`, and write it as a robot model.

    The robot must be at rest. It may be moved between recordings: each time that it stands still is a scene. For each
    sensor the more likely distribution is used, Gaussian or uniform. `mdesign evaluate --robot-model MODEL.yaml`
    measures controllers with this noise.

    \b
    Columns: sensor; used samples; scenes; noise, with the interval of its
    parameter; Akaike's criterion of the other distribution minus that of
    this one (below 2: not decided); the p-value of the fit (below 0.05:
    the noise has another distribution).
    """  # noqa: D301 - click reads the control character
    if output.exists():
        raise MercatorError(f"{output}: expected a new file, found an existing one; give another name, or remove it")
    result = fit(recordings, load_robot_model(base), seed=seed)
    for note in result.notes:
        print_message(f"Note: {note}")
    if plot is not None:
        with writing(plot):
            save_noise(plot, result, caption=command_line())
    beside = base if is_name(base) else os.path.relpath(base, output.parent)
    with writing(output):
        write_text(output, model_text(result, beside, name))
    print_result(calibration_json(result, seed) if as_json else calibration_page(result))
