"""mdesign missions: list, show and draw them, and make random ones."""

from pathlib import Path

import click

from mercator_design.cli.inputs import new_simulator, warn_of_mission
from mercator_design.cli.options import FOLDER, PICTURE, PLUGIN, ROBOT_MODEL, SEED, SET, seed_of
from mercator_design.cli.terminal import command_line, terminal_width
from mercator_design.command import print_result
from mercator_design.config import shipped
from mercator_design.config.writing import dump
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MercatorError, MissionError
from mercator_design.mission_sampler import CLASSES, MissionClass, sample_mission
from mercator_design.missions.mission import load_mission
from mercator_design.results.experiments.preview import preview_of
from mercator_design.show.text.missions import missions_json, missions_table
from mercator_design.system.files import write_text, writing


@click.group(invoke_without_command=True)
@click.pass_context
def missions(context: click.Context) -> None:
    """List, show and draw missions, and make random ones.

    Without a command, list the shipped missions.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_missions)


@missions.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON with all facts and the file.")
def list_missions(*, as_json: bool = False) -> None:
    """List the shipped missions."""
    print_result(missions_json() if as_json else missions_table(terminal_width()))


@missions.command(short_help="Print the YAML of a mission.")
@click.argument("mission")
@SET
@PLUGIN
def show(mission: str, overrides: tuple[str, ...]) -> None:
    """Print the YAML of MISSION with its comments, as a template for a mission of your own.

    With --set, print the mission that `mdesign race` would run: with overrides and all defaults, without comments.
    """
    loaded = load_mission(mission, overrides)
    if overrides:
        print_result(dump(loaded), nl=False)
    else:
        path = shipped.find(mission, shipped.missions(), "mission")
        print_result(text_of(path, error=MissionError), nl=False, exact=True)


@missions.command(short_help="Draw a mission from above.")
@click.argument("mission")
@click.option(
    "-o", "--output", type=PICTURE, help="Picture to write, .png or .svg.  [default: MISSION.png in the current folder]"
)
@seed_of("Seed of the instance to show: starting poses and colours of tiles.")
@ROBOT_MODEL
@SET
@PLUGIN
def preview(mission: str, output: Path | None, seed: int, robot_model: str | None, overrides: tuple[str, ...]) -> None:
    """Draw MISSION from above: arena, floor, lights, the starting area, and the starting poses of one instance.

    Prints the name of the picture.
    """
    from mercator_design.show.pictures.preview import save_preview  # matplotlib, for this verb only

    loaded = load_mission(mission, overrides)
    path = output or Path(f"{loaded.name}.png")
    simulator = new_simulator(loaded, robot_model)
    with writing(path):
        save_preview(path, preview_of(simulator, seed=seed), caption=command_line())
    warn_of_mission(simulator, refuse=False)
    print_result(path)


@missions.command(short_help="Write random missions of a class.")
@click.option("--class", "class_", type=click.Choice(CLASSES), required=True, help="Class of the missions.")
@SEED
@click.option("-n", "--number", type=click.IntRange(1, 10_000), default=1, show_default=True, help="Missions to make.")
@click.option("-o", "--output", type=FOLDER, default=".", help="Folder of the missions.  [default: the current folder]")
def sample(class_: MissionClass, seed: int, number: int, output: Path) -> None:
    """Write random missions of a class, for a test of a method on new missions.

    The same class and seed give the same missions; the first missions are the same whatever --number is. Prints the
    names of the files, CLASS-SEED-1.yaml and so on. These files must not exist.
    """
    with writing(output):
        output.mkdir(parents=True, exist_ok=True)
    paths = [output / f"{class_}-{seed}-{k}.yaml" for k in range(1, number + 1)]
    for path in paths:
        if path.exists():
            raise MercatorError(f"{path}: expected a new file, found an existing one")
    for k, path in enumerate(paths, start=1):
        with writing(path):
            write_text(path, dump(sample_mission(class_, seed=seed, number=k)))
        print_result(path)
