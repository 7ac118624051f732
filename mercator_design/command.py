"""Shared by the commands mdesign and mercator-robot: messages, output files, exit codes, reading an fsm.txt.

Results go to stdout or named files, messages to stderr.
"""

import contextlib
import functools
import importlib
import io
import math
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import click

from mercator_design.config import spelling
from mercator_design.config.shipped import is_path
from mercator_design.config.writing import digest_of
from mercator_design.errors import (
    ITEM,
    FsmError,
    MercatorError,
    Signalled,
    excerpt,
    lack_of_memory,
    printable,
    printable_lines,
)
from mercator_design.modules.flavour import flavour_of, load_flavour
from mercator_design.plugins.loading import run_plugin
from mercator_design.plugins.sources import Plugin, is_plugin, read_plugin
from mercator_design.software.files import FsmFile, read_fsm, read_fsms, read_header
from mercator_design.software.needed import DIGEST, PLUGINS, is_changed
from mercator_design.system import address_space

_HELP = getattr(click.exceptions, "NoArgsIsHelpError", ())  # click before 8.2 prints the help itself

FILE = click.Path(path_type=Path, readable=False)  # the reader of the file reports errors
WINNER = "fsm.txt"
"""The file of a race's winner in its run folder."""


class ControllerFile(click.Path):
    """A file with control software; a run folder stands for that of its winner."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:  # noqa: ANN401
        path = Path(str(super().convert(value, param, ctx)))
        winner = path / WINNER
        return winner if winner.is_file() else path


FSM = ControllerFile(path_type=Path, readable=False)  # the reader of the file reports errors


Verb = Callable[..., None]


def beginning(load: Callable[[tuple[Path, ...], dict[str, Any]], None]) -> Callable[[Verb], Verb]:
    """Let a verb begin with its plugins, which `load` runs, and then its flavour: a name, or a file, which has a name.

    The flavour's modules may be those of the plugins, in whatever order the options are.
    """

    def begun(verb: Verb) -> Verb:
        if hasattr(verb, "has_beginning"):  # by another of its options
            return verb

        @functools.wraps(verb)
        def begin(*arguments: object, plugin: tuple[Path, ...] = (), **given: Any) -> None:  # noqa: ANN401 - the verb's
            load(plugin, given)
            if given.get("flavour") is not None:
                given["flavour"] = _flavour_named(given["flavour"])
                _warn_of_flavour(given["flavour"], given)
            verb(*arguments, **given)

        begin.has_beginning = True  # type: ignore[attr-defined]
        return begin

    return begun


def _flavour_named(name_or_path: str) -> str:
    """The name of a flavour that an option gives; an unknown name is a mistake of the command line."""
    try:
        return load_flavour(name_or_path).name
    except MercatorError as error:
        if is_path(name_or_path):
            raise
        raise click.BadParameter(str(error), param_hint="'--flavour'") from None


def _warn_of_flavour(name: str, arguments: Mapping[str, Any]) -> None:
    """Warn of files of a verb's arguments that were designed with another version of the flavour that is given."""
    for file in software_files(arguments):
        header = read_header(file)
        is_of_it = header.get("flavour", name) == name
        if is_of_it and header.get(DIGEST, digest_of(flavour_of(name))) != digest_of(flavour_of(name)):
            warn(f"{file}: the flavour {excerpt(name)} has changed since this was designed; the present one is used")


def software_files(arguments: Mapping[str, Any]) -> list[Path]:
    """The files of control software among a verb's arguments, as far as they are there."""
    found = (arguments.get(name) for name in ("fsm", "one", "other"))
    files = [file for each in found for file in (each if isinstance(each, tuple) else (each,))]
    return [file for file in files if isinstance(file, Path) and file.is_file()]


def check_modules(file: Path, header: Mapping[str, str], plugin: Plugin, arguments: Mapping[str, Any]) -> None:
    """Refuse a plugin whose modules have changed since a file was designed; with --flavour, warn of it.

    Raises:
        FsmError: The plugin has changed and is to be refused.
    """
    if not is_changed(plugin, header):
        return
    what = f"{file}: {excerpt(plugin.name)} has changed since this was designed"
    if arguments.get("flavour") is None:
        copy = file.parent / PLUGINS / plugin.name
        then = f"give --plugin {shlex.quote(str(copy))}" if is_plugin(copy) else "give it as it was then"
        raise FsmError(f"{what}; it was not run; {then}, or --flavour to use its modules as they are now")
    warn(f"{what}; the present version is used")


def load_given(given: tuple[Path, ...], arguments: Mapping[str, Any]) -> None:
    """Run plugins, which must not have changed since the control software of a verb's arguments was designed.

    Raises:
        MissionError, FsmError: One cannot be read or run, or has changed (`check_modules`).
    """
    found = [(name, read_plugin(name)) for name in given]
    for file in software_files(arguments) if found else ():
        header = read_header(file)
        for _, plugin in found:
            check_modules(file, header, plugin, arguments)
    for name, plugin in found:
        run_plugin(plugin, str(name))


PLUGIN_OPTION = click.option(
    "--plugin",
    multiple=True,
    type=FILE,
    metavar="FILE.py|FOLDER|NAME",
    help="Plugin with more behaviours, conditions, flavours, objectives or floor dynamics: a file, the folder of a "
    "package, or the name of a plugin of an installed package. May be repeated.",
)
FLAVOUR_OPTION = click.option(
    "--flavour",
    metavar="NAME|FILE.yaml",
    help="Flavour of the module numbers in FSM.  [default: that of its header, else watermelon]",
)


def FLAVOUR(verb: Verb) -> Verb:  # noqa: N802 - as the options beside it
    """The options --flavour and --plugin of a verb that reads control software."""
    return FLAVOUR_OPTION(PLUGIN_OPTION(beginning(load_given)(verb)))


LENIENT = click.option(
    "--lenient",
    is_flag=True,
    help="Accept what the original AutoMoDe accepts, with a warning for each deviation.",
)


class OutputFile(click.Path):
    """A file to write; not `-`, which elsewhere is stdout."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401
        if value == "-":
            self.fail("expected a file, found '-'", param, ctx)
        return super().convert(value, param, ctx)


OUTPUT_FILE = OutputFile(path_type=Path)


class NumberRange(click.FloatRange):
    """Numbers in a range; click alone would accept NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ANN401
        number: float = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


def run(command: click.Command, name: str) -> None:
    """Run a command line, and exit with the documented exit code."""
    _open_streams()
    stdout = sys.stdout
    try:
        sys.exit(command.main(prog_name=name, standalone_mode=False))
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        if not isinstance(error, _HELP):
            error.message = printable(error.message)  # type: ignore[misc]  # there is no other way
        error.show(file=sys.stderr)
        sys.exit(error.exit_code)
    except MercatorError as error:
        print_error(error)
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        print_message("Interrupted.")
        sys.exit(130)
    except Signalled as signalled:
        print_message("; ".join([str(signalled), *getattr(signalled, "__notes__", ())]))
        sys.exit(signalled.exit_code)
    except SystemExit:
        if sys.stdout is stdout:
            raise
        _discard(stdout)  # the reader of stdout went away: click has wrapped it, and would exit with 1
        sys.exit(128 + signal.SIGPIPE)
    except Exception as error:
        if lack := lack_of_memory(error):
            print_message(f"Error: not enough memory{f': {lack}' * bool(str(lack))}")
        elif isinstance(error, OSError):
            print_message(f"Error: {error}")
        elif isinstance(error, UnicodeEncodeError):  # of a name in a file: streams take any text
            print_message(f"Error: {error.object}: no file can have this name in {error.encoding}; set PYTHONUTF8=1")
        else:
            raise
        _discard(sys.stdout)
        sys.exit(1)


def _open_streams() -> None:
    """Make streams take any text: closed ones lead to /dev/null, others escape what their encoding lacks.

    If a stream remained closed (`2>&-`), a file of ours, such as the journal, might get its number.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115 - until the end
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _discard(stream: TextIO) -> None:
    """Redirect a stream to /dev/null, so that its unwritten text is not tried again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_result(result: object, *, nl: bool = True, exact: bool = False, err: bool = False) -> None:
    """Print a result on stdout, without characters that control a terminal.

    Args:
        result: Printed as text.
        nl: Whether to add a newline.
        exact: Whether to print it unchanged if stdout is not a terminal, as for the contents of a file.
        err: Whether to print it on stderr, because stdout is for something else.
    """
    text = str(result)
    # click itself would write UTF-8 to streams of ASCII.
    file = sys.stderr if err else sys.stdout
    click.echo(text if exact and not sys.stdout.isatty() else printable_lines(text), nl=nl, file=file)


def print_message(message: str) -> None:
    """Print a message on stderr, unless stderr is closed."""
    try:
        click.echo(printable(message), file=sys.stderr, err=True)  # a progress bar may replace sys.stderr
    except OSError:  # for example, the terminal was closed
        _discard(sys.stderr)


def print_note(note: str) -> None:
    """Print a note on stderr, unless the command has the option --quiet."""
    context = click.get_current_context(silent=True)
    if context is None or not context.params.get("quiet"):
        print_message(note)


def print_error(error: MercatorError) -> None:
    """Print each mistake in a line of its own, and the notes of the error with the last one."""
    *others, last = error.messages
    for message in (*others, "; ".join([last, *getattr(error, "__notes__", ())])):
        first, *items = message.split(ITEM)
        print_message(f"Error: {first}")
        for item in items:
            print_message(f"{ITEM}{item}")


class Spelled(click.Choice):  # type: ignore[type-arg]  # has no argument in click before 8.2
    """A choice of words, in British or American spelling."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401
        return super().convert(spelling.find(value, self.choices) or value, param, ctx)


class SpelledGroup(click.Group):
    """Commands whose names may be in British or American spelling."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return super().get_command(ctx, spelling.find(cmd_name, self.commands) or cmd_name)


class LazyVerb(NamedTuple):
    """A command that is imported when it is used."""

    module: str  # has the command under its name
    help: str  # its line on the page of all commands
    is_light: bool = False  # whether it runs without the packages of the designer


def lack_of_designer(what: str, error: ModuleNotFoundError, extra: str = "design") -> MercatorError:
    """What to say where a package is not installed that only the designer needs, or the service."""
    part = {"design": "the designer", "serve": "the design service"}[extra]
    return MercatorError(
        f"{what} needs {part}: the package {error.name} is not installed; in the clone: pip install '.[{extra}]'"
    )


class LazyGroup(click.Group):
    """Commands, some of which are imported when they are used, so that `--help` is quick and needs few packages."""

    def __init__(self, *arguments: Any, lazy: Mapping[str, LazyVerb], **given: Any) -> None:  # noqa: ANN401 - click's
        super().__init__(*arguments, **given)
        self.lazy = lazy

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted([*super().list_commands(ctx), *self.lazy])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        verb = self.lazy.get(cmd_name)
        if verb is None:
            return super().get_command(ctx, cmd_name)
        if not verb.is_light:
            address_space.prepare_for_libraries()
        try:
            module = importlib.import_module(verb.module)
        except ModuleNotFoundError as error:
            package = verb.module.rpartition(".")[0]
            if error.name is None or (error.name.startswith("mercator_design.") and error.name != package):
                raise  # a bug in this program
            extra = "serve" if verb.module.startswith("mercator_design.serve.") else "design"
            raise lack_of_designer(cmd_name, error, extra) from None
        command: click.Command = getattr(module, cmd_name)
        command.short_help = verb.help
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        lines = {name: command.get_short_help_str(formatter.width) for name, command in self.commands.items()}
        lines |= {name: verb.help for name, verb in self.lazy.items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted(lines.items()))


def warn(*messages: str) -> None:
    """Print warnings."""
    for message in messages:
        print_message(f"Warning: {message}")


@contextlib.contextmanager
def naming_header(fsm: Path) -> Iterator[None]:
    """Name the file in errors on the header of an fsm.txt."""
    try:
        yield
    except FsmError as error:
        raise FsmError(*(f"{fsm}: {message}" for message in error.messages)) from None


def read_controllers(path: Path, flavour: str | None, *, lenient: bool) -> dict[str, FsmFile]:
    """Read a file of one or several PFSMs, as `read_controller`; by name: that of the file, perhaps with the line."""
    found = read_fsms(path, flavour, tolerate=(lambda what: warn(f"{path}: {what}")) if lenient else None)
    return {f"{path}:{line}" if len(found) > 1 else str(path): file for line, file in found.items()}


def read_controller(path: Path, flavour: str | None, *, lenient: bool) -> FsmFile:
    """Read an fsm.txt; warn of deviations that are tolerated."""
    return read_fsm(path, flavour, tolerate=(lambda what: warn(f"{path}: {what}")) if lenient else None)
