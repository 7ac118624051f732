"""mdesign replay: an experiment to look at."""

import webbrowser
from pathlib import Path

import click

from mercator_design.cli.options import FileOf
from mercator_design.cli.terminal import command_line
from mercator_design.cli.views.sources import shows_experiments
from mercator_design.command import NumberRange, print_message, print_result
from mercator_design.errors import printable
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.page import ReplayPage
from mercator_design.show.pictures import figures, film
from mercator_design.show.text.progress import Display
from mercator_design.system.files import writing

_PAGES = (".html", ".htm")


@click.command()
@shows_experiments
@click.option(
    "-o",
    "--output",
    type=FileOf(*_PAGES, *figures.FORMATS),
    help="The page, or with --png the picture.  [default: replay.html; with --png replay.png]",
)
@click.option("--open", "is_opened", is_flag=True, help="Open the page in a browser.")
@click.option(
    "--video", type=FileOf(*film.FORMATS), metavar="FILE.mp4|FILE.gif", help="Write a film instead of the page."
)
@click.option("--speed", type=NumberRange(0.1, 64.0), default=4.0, show_default=True, help="Speed of the film.")
@click.option("--png", "at", type=NumberRange(0.0), metavar="SECONDS", help="Write a picture of this time instead.")
def replay(
    shown: list[ShownExperiment],
    output: Path | None,
    is_opened: bool,
    video: Path | None,
    speed: float,
    at: float | None,
) -> None:
    """Show an experiment: a page that plays it, a film or a picture.

    FSM runs now, on the instance of --seed; it may also be a run folder, whose winner then runs. TRACE is a .npz or
    .csv file of `mdesign record`, or of a tracking camera: the columns time, robot, x, y, heading and, if known, state.
    LOG is what `mercator-robot run` wrote; several robots of one experiment are shown together, at the poses of their
    odometry.

    The page is one file that plays without a network, in any browser.
    """
    if video is not None and at is not None:
        raise click.UsageError("expected --video or --png, not both")
    if video is not None and output is not None:
        raise click.UsageError("expected --video or -o, not both")
    longest = max(one.trace.cycles * one.trace.control_period for one in shown)
    if at is not None and at > longest:
        raise click.UsageError(f"--png: expected at most {longest:g} s, the end of the experiment, found {at:g} s")
    score = "; ".join(f"{one.title}: score {one.score:g}{_by(one)}" for one in shown if one.score is not None)
    if at is not None:
        path = FileOf(*figures.FORMATS).convert(output or "replay.png", None, None)
        with writing(path):
            film.save_still(path, shown, at, caption=command_line())
    elif video is not None:
        path = video
        frames = film.Film(shown, path, speed=speed, caption=command_line())
        with writing(path), Display(f"{path.name}: frames", len(frames.times)) as display:
            frames.write(display.show)
    else:
        path = FileOf(*_PAGES).convert(output or "replay.html", None, None)
        with writing(path):
            ReplayPage(shown).save(path)
    print_result(printable(f"{path}: {score}" if score else str(path)))
    if is_opened and at is None and video is None and not webbrowser.open(path.absolute().as_uri()):
        print_message(f"No browser was found; open {path} in one.")


def _by(shown: ShownExperiment) -> str:
    """The name of the objective of a score in words; empty if the mission has one, or weights for several."""
    mission = shown.mission
    return f" by {mission.objective_names[0]}" if mission is not None and mission.is_ranked_by_all else ""
