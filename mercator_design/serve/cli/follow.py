"""mdesign follow: follows a job of a service."""

import json

import click

from mercator_design.cli.options import PROGRESS
from mercator_design.command import print_message, print_result
from mercator_design.errors import MercatorError
from mercator_design.serve.cli.service import EPILOG, JOB, SERVICE, connected
from mercator_design.serve.client import follow as following
from mercator_design.serve.client.follow import STATE, JobEvent, result
from mercator_design.show.text.progress import Mode


@click.command(epilog=EPILOG)
@JOB
@click.option(
    "--json-lines",
    is_flag=True,
    help="Print each event of the race on stdout as a line of JSON, or each state of the study.",
)
@PROGRESS
@SERVICE
def follow(job: str, json_lines: bool, progress: Mode, server: str) -> None:
    """Follow JOB until it has ended, and show its progress as `mdesign watch` does, or that of the whole study.

    After a lost connection, it continues where it was. Ctrl-C ends this command only, not the job.

    Exit codes: 0, the job has finished; 1, it has failed or was cancelled, or the service refuses.
    """

    def each(received: JobEvent) -> None:
        if json_lines and (received.kind != STATE or received.data.get("kind") == "study"):
            print_result(json.dumps(received.data))

    with connected(server) as connection:
        job_at_end = following.follow(connection, job, progress, announce=print_message, each=each)
        if job_at_end.get("state") != "finished":
            raise MercatorError(result(job_at_end))
        print_message(result(job_at_end))
        print_message(f"Its files: mdesign fetch {job}; its page: {connection.page(job)}")
