"""mdesign submit: submits a race or a study to a service."""

import json
import secrets
import time
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from mercator_design.cli.contents import content_of, is_study
from mercator_design.cli.options import SEED, SET
from mercator_design.cli.races.common import method_option
from mercator_design.command import print_message, print_result, warn
from mercator_design.config.shipped import is_path, missions, studies
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError, StudyError
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.race.methods.table import DEFAULT_METHOD
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.serve.cli.service import EPILOG, SERVICE, connected
from mercator_design.serve.client.connection import ConnectionLost
from mercator_design.serve.jobs.job import MAX_BUDGET, MAX_PRIORITY, MAX_TESTS
from mercator_design.studies.plan import load_plan

_TRIES = 3
_OF_RACES = ("budget", "seed", "flavour", "method", "test_runs", "overrides")
"""Options that a study has in its file."""


@click.command(epilog=EPILOG)
@click.argument("mission")
@click.option(
    "--budget", type=click.IntRange(1, MAX_BUDGET), help="Maximum number of experiments; required for a mission."
)
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
    budget: int | None,
    seed: int,
    flavour: str,
    method: str,
    test_runs: int,
    priority: int,
    overrides: tuple[str, ...],
    as_json: bool,
    server: str,
) -> None:
    """Submit a job that designs control software for MISSION, or runs a study, and print its name.

    MISSION is a YAML file, or the name of a shipped mission (see `mdesign missions`). The file may not name other files
    of this machine, because only its text is sent. --budget, --seed, --flavour, --method, --test-runs and --set mean
    the same as for `mdesign race`.

    A file with the keys of a study, or the name of a shipped study, is run as by `mdesign study run`. The files of its
    missions and of hand-made control software are sent with it; they lie in its folder or below. It names no plugins;
    its flavours and robot models are shipped ones.

    Exit codes: 2, the file of a study is not valid; 3, the service refuses the mission or the request; 1, it cannot be
    reached or cannot take the job.
    """
    if (study := _study(mission)) is not None:
        context = click.get_current_context()
        for option in (one for one in context.command.params if one.name in _OF_RACES):
            if context.get_parameter_source(str(option.name)) is ParameterSource.COMMANDLINE:
                raise click.UsageError(f"{option.opts[0]} is of a race: {mission} is a study, which has it in its file")
        path, body = "/studies", study | {"priority": priority}
    elif budget is None:
        raise click.UsageError("Missing option '--budget'.")
    else:
        path, body = "/jobs", {
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
                answer = connection.call("POST", path, json=body, headers=headers)
                break
            except ConnectionLost:
                if not left:
                    raise
                time.sleep(1.0)
        warn(*answer["warnings"])
        job = answer["job"]
        print_result(json.dumps(job, indent=2) if as_json else job["id"])
        print_message(f"Submitted; its page: {connection.page(job['id'])}")


def _study(name: str) -> dict[str, Any] | None:
    """A study by its file, with the files that it names, or by its name, as the service takes it; None if it is none.

    Raises:
        StudyError: It is not valid, or a file that it names cannot be read or lies elsewhere.
    """
    if not is_path(name):
        return {"study": name} if name in studies().keys() - missions().keys() else None
    file = Path(name)
    if not is_study(content_of(file)):
        return None
    plan, folder, files = load_plan(file), file.parent.resolve(), dict[str, str]()
    for key, path in plan.files.items():
        if not Path(path).is_relative_to(folder) or ".." in Path(path).parts:
            raise StudyError(
                f"{plan.where(key)}: expected a file in the folder of the study or below, as the service gets "
                f"a copy of what is there, found {path}"
            )
        try:
            files[Path(path).relative_to(folder).as_posix()] = text_of(Path(path), error=StudyError)
        except StudyError as error:
            raise StudyError(*(f"{plan.where(key)}: {message}" for message in error.messages)) from None
    return {"study_text": text_of(file, error=StudyError), "study_name": plan.name, "files": files}
