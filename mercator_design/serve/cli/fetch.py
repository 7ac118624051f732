"""mdesign fetch: fetches the files of a job of a service."""

import io
import shlex
import sys
from pathlib import Path

import click

from mercator_design.command import OUTPUT_FILE, print_message, print_result
from mercator_design.serve.cli.service import EPILOG, JOB, SERVICE, connected
from mercator_design.serve.client.fetch import fetch_file, fetch_folder
from mercator_design.system.files import replacing, writing

STUDY = "study.json"
"""A file that every study has, and no run folder."""


@click.command(epilog=EPILOG)
@JOB
@click.option(
    "-o",
    "--output",
    type=OUTPUT_FILE,
    help="Folder, new or empty; with --file, a file.  [default: a folder named as the job; stdout]",
)
@click.option("--file", "name", metavar="NAME", help="Fetch this file alone, for example fsm.txt.")
@SERVICE
def fetch(job: str, output: Path | None, name: str | None, server: str) -> None:
    """Fetch the folder of JOB, as `mdesign race` or `mdesign study` writes it, or one of its files.

    The folder appears when it is complete; `mdesign runs verify` and `mdesign report` work on a run folder, `mdesign
    study status` and `mdesign study report` on a study's.
    """
    with connected(server) as connection:
        if name is not None and output is not None:
            with writing(output), replacing(output) as file:
                fetch_file(connection, job, name, file)
        elif name is not None:
            whole = io.BytesIO()
            fetch_file(connection, job, name, whole)
            if sys.stdout.isatty():
                print_result(whole.getvalue().decode(errors="replace"), nl=False)
            else:
                sys.stdout.buffer.write(whole.getvalue())
        else:
            folder = output or Path(job)
            with writing(folder):
                names = fetch_folder(connection, job, folder)
            verb = "study status" if STUDY in names else "runs verify"
            check = f"mdesign {verb} {shlex.quote(str(folder))}"
            print_message(f"Written {folder}: {len(names)} files; to check it: {check}")
