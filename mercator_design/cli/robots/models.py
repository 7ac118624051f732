"""mdesign robots: list and show robot models."""

import click

from mercator_design.cli.terminal import terminal_width
from mercator_design.command import print_result
from mercator_design.config import shipped
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError
from mercator_design.show.text.missions import robot_models_table
from mercator_design.sim.robot_model import load_robot_model


@click.group(invoke_without_command=True)
@click.pass_context
def robots(context: click.Context) -> None:
    """List and show the shipped robot models.

    Without a command, list them.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_robots)


@robots.command("list")
def list_robots() -> None:
    """List the shipped robot models."""
    print_result(robot_models_table(terminal_width()))


@robots.command("show")
@click.argument("name")
def show_robot(name: str) -> None:
    """Print the YAML of a robot model with its comments."""
    load_robot_model(name)
    print_result(
        text_of(shipped.find(name, shipped.robot_models(), "robot model"), error=MissionError), nl=False, exact=True
    )
