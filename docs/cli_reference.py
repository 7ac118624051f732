"""Writes the reference of all commands, docs/reference/cli.md. Run: python docs/cli_reference.py"""

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from docs.made_part import MadePart, table
from mercator_design import cli
from mercator_design.robot import cli as robot_cli

COMMANDS = MadePart(Path(__file__).parent / "reference" / "cli.md", "commands", "cli_reference.py")
PROGRAMS = {"mdesign": cli.cli, "mercator-robot": robot_cli.cli}

Named = tuple[str, click.Command]


def reference() -> str:
    """A table of all commands, then a section for each."""
    commands = [one for name, program in PROGRAMS.items() for one in walk(name, program)]
    rows = [(f"[`{name}`](#{name.replace(' ', '-')})", cell(summary(command))) for name, command in commands]
    return "\n".join([table(("command", "what"), rows), *(section(name, command) for name, command in commands)])


def walk(name: str, command: click.Command) -> Iterator[Named]:
    """A command, and all below it."""
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=name)
        for verb in command.list_commands(context):
            below = command.get_command(context, verb)
            if below is not None and not below.hidden:
                yield from walk(f"{name} {verb}", below)


def section(name: str, command: click.Command) -> str:
    """Usage, description, arguments and options of a command, and what its help ends with."""
    usage = " ".join([name, *(one for p in command.params if (one := in_usage(p))), *trailing(command)])
    options = [p for p in command.params if isinstance(p, click.Option) and not p.hidden]
    rows = [(cell(names(p)), cell(meaning(p))) for p in options]
    parts = [f"## {name}\n", f"```\n{usage}\n```\n", *(f"{one}\n" for one in paragraphs(command.help or ""))]
    parts += [table(("option", "what"), rows)] if rows else []
    return "\n".join([*parts, *(f"{one}\n" for one in paragraphs(command.epilog or "") if one)])


def trailing(command: click.Command) -> list[str]:
    if isinstance(command, click.Group):
        return ["[COMMAND ...]" if command.invoke_without_command else "COMMAND ..."]
    return ["[OPTIONS]"]


def in_usage(parameter: click.Parameter) -> str:
    if isinstance(parameter, click.Argument):
        name = parameter.metavar or (parameter.name or "").upper() + "..." * (parameter.nargs == -1)
        return name if parameter.required or name.startswith("[") else f"[{name}]"
    return f"{parameter.opts[-1]} {value(parameter)}" if parameter.required else ""


def value(parameter: click.Parameter) -> str:
    """What an option takes, nothing for a flag."""
    kind = parameter.type
    if isinstance(parameter, click.Option) and (parameter.is_flag or parameter.count):
        return ""
    if parameter.metavar:
        return parameter.metavar
    if isinstance(kind, click.Choice):
        return "|".join(map(str, kind.choices))
    if isinstance(kind, click.Path):
        return "DIRECTORY" if not kind.file_okay else "FILE"
    if isinstance(kind, click.types.StringParamType):
        return "TEXT"
    return {"integer": "N", "integer range": "N", "float": "X", "float range": "X"}.get(kind.name, kind.name.upper())


def names(option: click.Option) -> str:
    taken = value(option)
    return f"`{', '.join([*option.opts, *option.secondary_opts])}{' ' + taken if taken else ''}`"


def meaning(option: click.Option) -> str:
    """The help of an option, with its default."""
    text = re.sub(r" {2,}", " ", option.help or "")
    if option.show_default is True and isinstance(option.default, str | int | float | Path) and not option.is_flag:
        text += f" [default: {option.default}]"
    return text + " Required." * option.required


def summary(command: click.Command) -> str:
    return command.get_short_help_str(limit=200).removesuffix(".")


def paragraphs(text: str) -> list[str]:
    """The paragraphs of a docstring; a paragraph that click does not wrap becomes a code block."""
    blocks = inspect.cleandoc(text).split("\f")[0].strip().split("\n\n")
    return [f"```\n{one[1:].strip()}\n```" if one.startswith("\b") else " ".join(one.split()) for one in blocks]


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def main() -> None:
    COMMANDS.write(reference())


if __name__ == "__main__":
    main()
