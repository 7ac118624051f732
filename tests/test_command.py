"""What the commands mdesign and mercator-robot share."""

import contextlib
import io
import sys

import click
import pytest

from mercator_design.cli import cli as mdesign
from mercator_design.cli import main as mdesign_main
from mercator_design.cli.terminal import wrapped
from mercator_design.command import Spelled, SpelledGroup, print_error
from mercator_design.config import shipped
from mercator_design.errors import MissionError
from mercator_design.robot.cli import cli as mercator_robot
from mercator_design.robot.cli import main as robot_main


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


@pytest.mark.parametrize("encoding", ["latin-1", "ascii"])
@pytest.mark.parametrize("command", ["mdesign", "mercator-robot"])
class TestStreamsOfFewCharacters:
    """Of a terminal or file that is not UTF-8: what it lacks is escaped, wherever it is from."""

    @pytest.fixture
    def run_in(self, monkeypatch, command, encoding):
        """Run the command with arguments; return the exit code, and the bytes of stdout and stderr."""

        def run_it(*arguments):
            streams = {name: io.TextIOWrapper(io.BytesIO(), encoding, "strict") for name in ("stdout", "stderr")}
            for name, stream in streams.items():
                monkeypatch.setattr(sys, name, stream)
            monkeypatch.setattr(sys, "argv", [command, *arguments])
            with pytest.raises(SystemExit) as stop:
                {"mdesign": mdesign_main, "mercator-robot": robot_main}[command]()
            for stream in streams.values():
                stream.flush()
            return stop.value.code or 0, *(stream.buffer.getvalue().decode(encoding) for stream in streams.values())

        return run_it

    def test_wrong_usage(self, run_in):
        code, _, err = run_in("w\u00e4hle\u2192")
        assert code == 2
        assert "hle\\u2192'" in err

    def test_an_error(self, run_in, command):
        arguments = {"mdesign": ["evaluate", "no\u2192.txt"], "mercator-robot": ["run", "no\u2192.txt"]}[command]
        code, _, err = run_in(*arguments)
        assert code == 3
        assert "no\\u2192.txt: no such file" in err

    def test_a_result(self, run_in, command, tmp_path):
        if command == "mercator-robot":
            pytest.skip("its results are ASCII")
        (tmp_path / "m.yaml").write_text(shipped.missions()["aggregation"].read_text() + "# no\u2192", "utf-8")
        code, out, _ = run_in("missions", "show", str(tmp_path / "m.yaml"))
        assert code == 0
        assert "no\\u2192" in out


def test_long_lines_are_broken_between_words_in_a_terminal():
    text = "Branch 0: stop\n  It goes on to branch 1 in the same cycle\n\n" + "x" * 30 + "\n"
    assert wrapped(text, None) == text
    assert wrapped(text, 20) == (
        "Branch 0: stop\n  It goes on to\n    branch 1 in the\n    same cycle\n\n" + "x" * 30 + "\n"
    )
