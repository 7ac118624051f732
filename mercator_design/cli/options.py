"""Types and options that several verbs have."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import load_plugins
from mercator_design.command import FLAVOUR_OPTION, LENIENT, PLUGIN_OPTION, OutputFile, beginning
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.show.text.progress import MODES

FOLDER = click.Path(path_type=Path, file_okay=False)


JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
CSV = click.option("--csv", "as_csv", is_flag=True, help="Print the table as CSV.")
_begun = beginning(load_plugins)


def PLUGIN(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The option --plugin of a verb: before the verb begins, plugins are compared with its other arguments and run."""
    return PLUGIN_OPTION(_begun(verb))


def FLAVOUR(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The option --flavour of a verb that reads control software; its modules may be of plugins."""
    return FLAVOUR_OPTION(PLUGIN(verb))


def design_flavour(verb: Callable[..., None]) -> Callable[..., None]:
    """The option --flavour of a verb that designs control software."""
    option = click.option(
        "--flavour",
        metavar="NAME|FILE.yaml",
        default=DEFAULT_FLAVOUR,
        show_default=True,
        help="Modules to design with.",
    )
    return option(_begun(verb))


SET = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a key of the mission, e.g. robots=20 or floor.zones[0].radius=0.3. May be repeated.",
)
MISSION = click.option(
    "--mission",
    help="YAML file or name of a shipped mission.  [default: the mission in FSM's header]",
)
ROBOT_MODEL = click.option(
    "--robot-model", help="YAML file or name of a shipped robot model.  [default: the mission's]"
)


def seed_of(text: str, largest: int = 2**63 - 1) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --seed, with a help text and the largest seed."""
    return click.option("--seed", type=click.IntRange(0, largest), default=1, show_default=True, help=text)


SEED = seed_of("Master seed of all randomness.")


def jobs_of(default: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --jobs, with the default in words."""
    return click.option(
        "-j",
        "--jobs",
        type=click.IntRange(1, 256),
        help=f"Number of experiments that run at the same time.  [default: {default}]",
    )


JOBS = jobs_of("the cores that it may use")


def CONTROLLER(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The options of a verb that runs a controller: how its file is read, and its robots and mission."""
    return ROBOT_MODEL(FLAVOUR(LENIENT(SET(verb))))


def PROGRESS(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The options --progress and --quiet of a verb, which gets the mode as `progress`."""

    @functools.wraps(verb)
    def with_mode(*arguments: object, quiet: bool, **given: Any) -> None:  # noqa: ANN401 - the verb's
        verb(*arguments, **given | ({"progress": "none"} if quiet else {}))

    progress = click.option(
        "--progress",
        type=click.Choice(MODES),
        default="auto",
        show_default=True,
        help="How to show progress on stderr: rich: as a moving line; plain: as lines, at each iteration's end and at "
        "least every 30 s; auto: rich on a terminal, else plain.",
    )
    quiet = click.option("-q", "--quiet", is_flag=True, help="Show no progress and no notes on stderr, only warnings.")
    return progress(quiet(with_mode))


class FileOf(OutputFile):
    """A file to write; its suffix, one of several, is the format."""

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path, dir_okay=False)
        self._suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:  # noqa: ANN401
        path = Path(str(super().convert(value, param, ctx)))
        if path.suffix.lower() not in self._suffixes:
            *others, last = self._suffixes
            expected = f"expected a name that ends in {', '.join(others)} or {last}"
            self.fail(f"{expected}, found '{path.name}'", param, ctx)
        return path


PICTURE = FileOf(".png", ".svg")


def plot_of(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --plot, with a help text."""
    return click.option("--plot", type=PICTURE, metavar="FILE.png|FILE.svg", help=text)
