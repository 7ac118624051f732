"""mdesign plot: figures of experiments."""

from pathlib import Path

import click

from mercator_design.cli.options import FileOf
from mercator_design.cli.terminal import command_line
from mercator_design.cli.views.sources import shows_experiments
from mercator_design.command import print_result
from mercator_design.errors import printable
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.pictures.figures import FORMATS
from mercator_design.show.pictures.plots import KINDS, save_plots, usual_kinds
from mercator_design.system.files import writing


@click.command()
@shows_experiments
@click.option(
    "-o",
    "--output",
    type=FileOf(*FORMATS),
    default=Path("plot.png"),
    show_default=True,
    help=f"The figure; its suffix, {', '.join(FORMATS)}, is the format.",
)
@click.option(
    "-k",
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice([*KINDS]),
    help="What to plot. May be repeated.  [default: all; leds where modules set them]",
)
def plot(shown: list[ShownExperiment], output: Path, kinds: tuple[str, ...]) -> None:
    """Plot experiments: a row for each kind of plot, and a column for each experiment.

    The sources are those of `mdesign replay`: FSM may also be a run folder, whose winner then runs.

    \b
    trajectories  paths of the robots, in the colours of their states
    presence      how long robots were where
    states        state of each robot over time
    leds          colour of each robot's LEDs over time, as modules set it
    distances     distances between robots over time
    score         score so far over time
    """  # noqa: D301 - click reads the control character
    with writing(output):
        save_plots(output, shown, kinds or usual_kinds(shown), caption=command_line())
    print_result(printable(str(output)))
