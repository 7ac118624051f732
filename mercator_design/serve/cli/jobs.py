"""mdesign jobs: lists and changes the jobs of a service."""

import json
from typing import Any
from urllib.parse import quote

import click

from mercator_design.cli.options import JSON
from mercator_design.cli.terminal import terminal_width
from mercator_design.command import print_message, print_result
from mercator_design.serve.cli.service import EPILOG, JOB, SERVICE, connected
from mercator_design.serve.jobs.job import MAX_BUDGET, MAX_PRIORITY, STATES
from mercator_design.show.text.columns import narrowed

_PAGE = 500  # jobs of a request
_DISPENSABLE = ("submitted", "owner", "mission", "message", "measured")
"""Columns to drop from a table that is too wide, in this order."""


@click.group(invoke_without_command=True, epilog=EPILOG)
@click.option(
    "--state", "states", type=click.Choice(STATES), multiple=True, help="Only jobs in this state. May be repeated."
)
@click.option("--owner", default="", help="Only of this user.")
@click.option("--text", default="", help="Only with this text in the name of the job or mission.")
@JSON
@SERVICE
@click.pass_context
def jobs(context: click.Context, states: tuple[str, ...], owner: str, text: str, as_json: bool, server: str) -> None:
    """List the jobs of a service, the latest first; with a command, show or change one.

    Exit codes: 0 done; 1, the service refuses or cannot be reached; 2 wrong usage.
    """
    if context.invoked_subcommand is not None:
        context.obj = server
        return
    found: list[dict[str, Any]] = []
    wanted = {"state": [*states], "owner": owner, "text": text, "limit": _PAGE}
    with connected(server) as connection:
        while True:
            page = connection.call("GET", "/jobs", params={**wanted, "offset": len(found)})
            found += page["jobs"]
            if not page["jobs"] or len(found) >= page["total"]:
                break
    print_result(json.dumps(found, indent=2) if as_json else _table(found, terminal_width()))


def _table(found: list[dict[str, Any]], width: int | None) -> str:
    if not found:
        return "There are no such jobs."
    rows = [
        {
            "job": one["id"],
            "mission": one["name"],
            "state": one["state"],
            "experiments": f"{one['experiments']}/{one['budget']}",
            "score": None if one["best"] is None else f"{one['best']:.4g}",
            "measured": one["measured"] or None,
            "owner": one["owner"] or None,
            "submitted": one["submitted"][:16].replace("T", " "),
            "message": one["message"] or None,
        }
        for one in found
    ]
    columns = [name for name in rows[0] if any(row[name] is not None for row in rows)]
    table = [columns, *([row[name] for name in columns] for row in rows)]
    return "\n".join(narrowed(table, _DISPENSABLE, width))


def _send(server: str, method: str, job: str, after: str = "", **given: Any) -> Any:  # noqa: ANN401 - JSON
    """The answer to a request on a job."""
    with connected(server) as connection:
        return connection.call(method, f"/jobs/{quote(job, safe='')}{after}", **given)


_SERVICE = click.option(
    "--server",
    metavar="URL",
    default=lambda: click.get_current_context().obj,
    help="Address of the service.  [default: as for `mdesign jobs`]",
)


@jobs.command(short_help="Show a job.")
@JOB
@_SERVICE
def show(job: str, server: str) -> None:
    """Show JOB as JSON."""
    print_result(json.dumps(_send(server, "GET", job), indent=2))


def _print_job(job: dict[str, Any]) -> None:
    print_message(f"{job['id']}: {job['state']}" + f", {job['message']}" * bool(job["message"]))


@jobs.command(short_help="Stop a job until it is resumed.")
@JOB
@_SERVICE
def pause(job: str, server: str) -> None:
    """Stop JOB until it is resumed; its running experiments finish."""
    _print_job(_send(server, "POST", job, "/pause"))


@jobs.command(short_help="Let a job go on.")
@JOB
@_SERVICE
def resume(job: str, server: str) -> None:
    """Let JOB go on that was paused or has failed."""
    _print_job(_send(server, "POST", job, "/resume"))


@jobs.command(short_help="Stop a job for good.")
@JOB
@_SERVICE
def cancel(job: str, server: str) -> None:
    """Stop JOB for good; its results so far stay."""
    _print_job(_send(server, "POST", job, "/cancel"))


@jobs.command(short_help="Change budget, priority or sharing of a job.")
@JOB
@click.option(
    "--budget", type=click.IntRange(1, MAX_BUDGET), help="A larger budget; a job that has ended goes on with it."
)
@click.option("--priority", type=click.IntRange(-MAX_PRIORITY, MAX_PRIORITY), help="Priority among your jobs.")
@click.option("--shared/--private", default=None, help="Show it to all users, or to you alone.")
@_SERVICE
def change(job: str, budget: int | None, priority: int | None, shared: bool | None, server: str) -> None:
    """Extend the budget of JOB, change its priority, share it."""
    wanted = {"budget": budget, "priority": priority, "shared": shared}
    body = {name: value for name, value in wanted.items() if value is not None}
    if not body:
        raise click.UsageError("expected --budget, --priority, --shared or --private")
    _print_job(_send(server, "PATCH", job, json=body))


@jobs.command(short_help="Delete a job with its files.")
@JOB
@_SERVICE
def delete(job: str, server: str) -> None:
    """Delete JOB, which does not run, with all its files."""
    _send(server, "DELETE", job)
    print_message(f"{job}: deleted")
