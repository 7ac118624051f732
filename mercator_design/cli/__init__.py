"""The command `mdesign`; each verb has its file.

Results go to stdout or named files; progress and messages go to stderr, progress only to a terminal. Exit codes:
0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM, 75 terminated (a race can be resumed), 130 interrupted. Heavy
modules are imported by the verb that needs them, so that `--help` is quick.
"""

import os
import sys
from pathlib import Path

import click

from mercator_design import __version__
from mercator_design.cli import draw, evaluate, export, missions, race, record, robots, runs, schema, tune, validate
from mercator_design.cli.terminal import Terminated, discard, tell, terminable
from mercator_design.errors import MercatorError, printable

_HELP = getattr(click.exceptions, "NoArgsIsHelpError", ())  # click before 8.2 prints the help itself


def main() -> None:
    """Run the command line; every way out has its exit code."""
    _open_streams()
    try:
        with terminable():
            sys.exit(cli.main(prog_name="mdesign", standalone_mode=False))
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        if not isinstance(error, _HELP):
            error.message = printable(error.message)  # type: ignore[misc]  # the only way in
        error.show()
        sys.exit(error.exit_code)
    except MercatorError as error:
        tell(f"Error: {error}")
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        tell("Interrupted.")
        sys.exit(130)
    except Terminated:
        tell("Terminated.")
        sys.exit(75)  # EX_TEMPFAIL: try again later
    except OSError as error:
        if not isinstance(error, BrokenPipeError):  # the reader of our output went away, and knows
            tell(f"Error: {error}")
        discard(sys.stdout)
        sys.exit(1)
    except MemoryError:
        tell("Error: not enough memory")
        sys.exit(1)


def _open_streams() -> None:
    """What was closed (`2>&-`) leads nowhere: else a file of ours, such as the journal, might have its number."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - until the end


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdesign")
def cli() -> None:
    """Design control software for swarms of Mercator robots.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM,
    75 terminated (resume the race), 130 interrupted.
    """  # noqa: D301 - click reads the control character


for _verb in (
    race.race,
    tune.tune,
    runs.runs,
    evaluate.evaluate,
    export.export,
    record.record,
    validate.validate,
    draw.draw,
    missions.missions,
    robots.robots,
    schema.schema,
):
    cli.add_command(_verb)
