"""mdesign race --seeds: the same race with several seeds, which is the smallest study."""

import shlex
from pathlib import Path
from typing import Any, NamedTuple

import click
from click.core import ParameterSource

from mercator_design.cli.terminal import command_line
from mercator_design.config.shipped import is_path
from mercator_design.errors import StudyError
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.executor import Executor
from mercator_design.race.session.outcome import OnFailure
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.show.text.progress import Mode
from mercator_design.studies.plan import Assessing, StudyMethod, StudyMission, StudyPlan

_OF_ONE_RACE = ("seed", "resume", "test_elites", "test_iterations", "optuna", "json_lines", "no_comparison")
_MAX_FIRST, _MAX_SEEDS = 2**31 - 10**6, 10_000
"""Those of the file of a study."""


class Seeds(NamedTuple):
    """The first and the last of consecutive seeds."""

    first: int
    last: int


class _Seeds(click.ParamType):  # type: ignore[type-arg]  # has no argument in click before 8.2
    name = "A-B"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Seeds:  # noqa: ANN401
        if isinstance(value, Seeds):
            return value
        first, _, last = str(value).partition("-")
        is_number = first.isdecimal() and last.isdecimal()
        if is_number and int(first) <= _MAX_FIRST and 0 < int(last) - int(first) < _MAX_SEEDS:
            return Seeds(int(first), int(last))
        what = f"A up to {_MAX_FIRST} below B, at most {_MAX_SEEDS} seeds"
        raise click.BadParameter(f"expected A-B, as 1-20, with {what}, found '{value}'", ctx, param)


SEEDS = click.option(
    "--seeds",
    type=_Seeds(),
    metavar="A-B",
    help="Run the race with each of these seeds, e.g. 1-20: a study of one method, in studies/NAME or as -o says. "
    "The same command resumes it, and extends it to a larger B.",
)


def run_seeds(
    mission: str,
    seeds: Seeds,
    executor: Executor,
    *,
    budget: int,
    overrides: tuple[str, ...],
    method: str,
    flavour: str,
    test_runs: int | None,
    output: Path | None,
    executor_name: str,
    on_failure: OnFailure,
    reports: bool,
    progress: Mode,
) -> None:
    """Run the study of a race with several seeds.

    Raises:
        click.UsageError: An option is given that is of one race only.
        StudyError: The folder has a study of another method or budget, or with more seeds, whose results the page
            would lose.
    """
    from mercator_design.cli.study.run import checked_study, run_study  # pandas comes with it, which no race needs
    from mercator_design.studies.folder import FACTS, PLAN, read_facts

    context = click.get_current_context()
    for name in _OF_ONE_RACE:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name.replace('_', '-')} is of one race: it cannot be given with --seeds")
    if test_runs is not None and test_runs < 2:
        raise click.UsageError(f"--test-runs: expected at least 2 with --seeds, found {test_runs}")
    name = load_mission(mission, overrides).name
    plan = StudyPlan(
        name=name,
        seed=seeds.first,
        budgets=(budget,),
        repetitions=seeds.last - seeds.first + 1,
        methods={method: StudyMethod(method=method, flavour=flavour)},
        missions=(StudyMission(mission=str(Path(mission).resolve()) if is_path(mission) else mission, set=overrides),),
        assess=Assessing(runs=TEST_RUNS if test_runs is None else test_runs),
    )
    folder = output or Path("studies") / name
    if (folder / FACTS).exists():
        before = read_facts(folder).layout
        found, now = ([*before.methods], [*before.budgets]), ([method], [budget])
        if found != now:
            raise StudyError(
                f"{folder}: expected method {', '.join(found[0])} and budget {', '.join(map(str, found[1]))}, as in "
                f"the study there, found method {method} and budget {budget}: give another folder (-o), or add it to a "
                f"copy of {folder / PLAN} and run mdesign study"
            )
        last = before.seed + before.repetitions - 1
        if seeds.first == before.seed and seeds.last < last:
            raise StudyError(
                f"{folder}: expected seeds {before.seed}-{last} or a larger B, as the study there has these, found "
                f"seeds {seeds.first}-{seeds.last}: give another folder (-o); mdesign study report "
                f"{shlex.quote(str(folder))} writes the page of what has run so far"
            )
    run_study(
        checked_study(plan),
        folder,
        executor,
        part=None,
        executor_name=executor_name,
        on_failure=on_failure,
        reports=reports,
        progress=progress,
        again=command_line(),
    )
