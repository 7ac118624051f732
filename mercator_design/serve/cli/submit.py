"""mdesign submit: submits a design job to a service."""

import json
import secrets
import time
from pathlib import Path

import click

from mercator_design.cli.options import SEED, SET
from mercator_design.cli.races.common import method_option
from mercator_design.command import print_message, print_result, warn
from mercator_design.config.shipped import is_path
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.race.methods.table import DEFAULT_METHOD
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.serve.cli.service import EPILOG, SERVICE, connected
from mercator_design.serve.client.connection import ConnectionLost
from mercator_design.serve.jobs.job import MAX_BUDGET, MAX_PRIORITY, MAX_TESTS

_TRIES = 3


@click.command(epilog=EPILOG)
@click.argument("mission")
@click.option("--budget", type=click.IntRange(1, MAX_BUDGET), required=True, help="Maximum number of experiments.")
@SEED
@click.option(
    "--flavour",
    metavar="NAME",
    default=DEFAULT_FLAVOUR,
    show_default=True,
    help="Flavour to design with, of the service.",
)
@method_option(DEFAULT_METHOD)
@click.option(
    "--test-runs",
    type=click.IntRange(0, MAX_TESTS),
    default=TEST_RUNS,
    show_default=True,
    metavar="N",
    help="When the race has ended, run the winner on N fresh instances, beyond the budget: their mean is its score. "
    "0: do not.",
)
@click.option(
    "--priority",
    type=click.IntRange(-MAX_PRIORITY, MAX_PRIORITY),
    default=0,
    show_default=True,
    help="Priority among your jobs: a higher one runs first.",
)
@SET
@click.option("--json", "as_json", is_flag=True, help="Print the job as JSON, instead of its name.")
@SERVICE
def submit(
    mission: str,
    budget: int,
    seed: int,
    flavour: str,
    method: str,
    test_runs: int,
    priority: int,
    overrides: tuple[str, ...],
    as_json: bool,
    server: str,
) -> None:
    """Submit a job that designs control software for MISSION, and print its name.

    MISSION is a YAML file, or the name of a shipped mission (see `mdesign missions`). The file may not name other files
    of this machine, because only its text is sent. --budget, --seed, --flavour, --method, --test-runs and --set mean
    the same as for `mdesign race`.

    Exit codes: 3, the service refuses the mission or the request; 1, it cannot be reached or cannot take the job.
    """
    body: dict[str, object] = {
        "budget": budget, "seed": seed, "flavour": flavour, "method": method, "test_runs": test_runs,
        "priority": priority, "set": [*overrides],
    }  # fmt: skip
    if is_path(mission):
        body["mission_text"] = text_of(Path(mission), error=MissionError)
    else:
        body["mission"] = mission
    headers = {"Idempotency-Key": secrets.token_hex(16)}  # if the answer is lost, it is submitted once
    with connected(server) as connection:
        for left in reversed(range(_TRIES)):
            try:
                answer = connection.call("POST", "/jobs", json=body, headers=headers)
                break
            except ConnectionLost:
                if not left:
                    raise
                time.sleep(1.0)
        warn(*answer["warnings"])
        job = answer["job"]
        print_result(json.dumps(job, indent=2) if as_json else job["id"])
        print_message(f"Submitted; its page: {connection.page(job['id'])}")
