"""What the commands mdesign and mercator-robot share."""

import contextlib

import click
import pytest

from mercator_design.cli import cli as mdesign
from mercator_design.command import Spelled, SpelledGroup, print_error
from mercator_design.errors import MissionError
from mercator_design.robot.cli import cli as mercator_robot


def verbs(group):
    """All of a command, and of its verbs."""
    for name in group.list_commands(click.Context(group)):
        verb = group.get_command(click.Context(group), name)
        yield verb
        if isinstance(verb, click.Group):
            yield from verbs(verb)


def options(command, are_wanted):
    """Options of all verbs, each with a context in which it may be given."""
    return [(click.Context(verb), option) for verb in verbs(command) for option in verb.params if are_wanted(option)]


@pytest.mark.parametrize("command", [mdesign, mercator_robot])
def test_only_a_table_goes_to_stdout_by_a_dash(command):
    """Elsewhere it would be the name of a file, which is not easily removed."""
    outputs = options(command, lambda o: "-o" in o.opts and getattr(o.type, "file_okay", False) and o.callback is None)
    accepting = []
    for context, option in outputs:
        with contextlib.suppress(click.BadParameter):
            option.type_cast_value(context, "-")
            accepting.append(context.command.name)
    assert len(outputs) > 2
    assert set(accepting) <= {"csv", "mcap", "record"}  # the last two refuse it by themselves


@pytest.mark.parametrize("command", [mdesign, mercator_robot])
def test_what_is_no_number_is_in_no_range(command):
    """A duration or a guard that is NaN would be none."""
    numbers = options(command, lambda option: isinstance(option.type, click.types.FloatParamType))
    assert numbers
    for context, option in numbers:
        with pytest.raises(click.BadParameter, match="'nan' is not a number"):
            option.type_cast_value(context, "nan")


def test_words_may_have_either_spelling():
    seen = []

    @click.group(cls=SpelledGroup)
    def group() -> None:
        pass

    @group.command()
    @click.argument("colours", nargs=-1, type=Spelled(["gray", "red"]))
    def color(colours):
        seen.extend(colours)

    group.main(["colour", "grey", "red", "gray"], standalone_mode=False)
    assert seen == ["gray", "red", "gray"]
    with pytest.raises(click.BadParameter, match="is not one of 'gray', 'red'"):
        group.main(["color", "greyish"], standalone_mode=False)


def test_each_mistake_has_its_line(capsys):
    error = MissionError("a.yaml:1: x", "a.yaml:2: y\n")
    error.add_note("resume it")
    print_error(error)
    assert capsys.readouterr().err == "Error: a.yaml:1: x\nError: a.yaml:2: y\\n; resume it\n"
