"""Options that several verbs have."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import load_plugins
from mercator_design.command import FILE

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


def seed_of(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --seed, with a help text."""
    return click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True, help=text)


SEED = seed_of("Master seed of all randomness.")
JOBS = click.option(
    "-j",
    "--jobs",
    type=click.IntRange(1, 256),
    help="Number of experiments that run at the same time.  [default: the cores of this machine]",
)


def PLUGIN(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The option --plugin of a verb: before the verb begins, plugins are compared with its other arguments and run."""

    @functools.wraps(verb)
    def with_plugins(*arguments: object, plugin: tuple[Path, ...], **given: Any) -> None:  # noqa: ANN401 - the verb's
        if plugin:
            load_plugins(
                plugin,
                controller=given.get("fsm"),
                folder=given.get("directory") or given.get("resume"),
                flavour=given.get("flavour"),
                refuse=given.get("mission") is None,
            )
        verb(*arguments, **given)

    return click.option(
        "--plugin",
        multiple=True,
        type=FILE,
        metavar="FILE.py",
        help="Python file with more objectives or floor dynamics for missions. May be repeated.",
    )(with_plugins)


def picture(_: click.Context, __: click.Parameter, path: Path | None) -> Path | None:
    """The callback of an option for the name of a picture."""
    if path is not None and path.suffix.lower() not in {".png", ".svg"}:
        raise click.BadParameter(f"expected a name that ends in .png or .svg, found '{path.name}'")
    return path
