"""Functions on studies that workers compute: checks before submission, the part of a job's page.

A study of a user is one text. It may not name files, so it has shipped missions, with overrides, and sampled ones.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mercator_design.config import shipped
from mercator_design.config.loading import parse
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MercatorError, StudyError, excerpt
from mercator_design.serve.jobs.job import MAX_BUDGET, StudyRequest
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers.findings import without_folders
from mercator_design.serve.workers.missions import mission_warnings
from mercator_design.serve.workers.races import PagePart
from mercator_design.serve.workers.sources import MissionSource, check_limits
from mercator_design.show.report.markup import section, table
from mercator_design.studies.folder import FACTS
from mercator_design.studies.plan import StudyMission, StudyPlan
from mercator_design.studies.reading import State, read_status
from mercator_design.studies.resolving import resolve

MAX_CELLS = 500
"""Maximum number of designs of a study: each has about ten files."""
_STATES: tuple[State, ...] = ("done", "to assess", "running", "interrupted", "to run")


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedStudy:
    """Facts and warnings of a study that was checked.

    experiments: At most, of all races and assessments.
    """

    name: str
    experiments: int
    warnings: tuple[str, ...]


def check_study(study: str, text: str | None, limits: UserLimits) -> CheckedStudy:
    """Check a study, and that its races can begin.

    Args:
        study: The name of a shipped one.
        text: Instead of it, the text of a study's file.
        limits: Limits of the service.

    Raises:
        MercatorError: It is not valid, names files, or is beyond a limit; with each mistake.
    """
    plan = _plan(study, text)
    if wrong := [*_mistakes(plan, limits)]:
        raise StudyError(*wrong)
    found = resolve(plan)
    for label, one in found.missions.items():
        check_limits(one.simulator.mission, limits, label)
    layout = found.layout
    if len(layout.cells) > MAX_CELLS:
        raise StudyError(
            f"{plan.name}: expected at most {MAX_CELLS} designs, the limit here, found {len(layout.cells)}"
        )
    experiments = sum(map(layout.n_experiments, layout.cells))
    if experiments > MAX_BUDGET:
        raise StudyError(f"{plan.name}: expected at most {MAX_BUDGET} experiments, found {experiments}")
    flavours = dict.fromkeys(method.flavour for method in found.methods.values())
    warnings = {
        f"{label}: {without_folders(what)}": None
        for label, one in found.missions.items()
        for flavour in flavours
        for what in mission_warnings(one.simulator, flavour)
    }
    return CheckedStudy(name=plan.name, experiments=experiments, warnings=(*warnings,))


def _plan(study: str, text: str | None) -> StudyPlan:
    if text is None:
        name = shipped.named(study, files := shipped.studies(), "study")
        label, text = name, text_of(files[name], error=StudyError)
    else:
        name, label = Path(StudyRequest.FILE).stem, StudyRequest.FILE
    plan: StudyPlan = parse(text, StudyPlan, error=StudyError, label=label, files=False, defaults={"name": name})
    return plan


def _mistakes(plan: StudyPlan, limits: UserLimits) -> Iterator[str]:
    """What a service does not run: the names that are not of shipped files, the missions beyond a limit."""
    for index, entry in enumerate(plan.missions):
        given = entry if isinstance(entry, StudyMission) else StudyMission(mission=entry)
        try:
            if given.mission is not None:
                MissionSource(name=given.mission, overrides=given.set).read(limits)
        except MercatorError as error:
            yield from (f"{plan.where(f'missions[{index}]')}: {message}" for message in error.messages)
    flavours = {f"methods.{name}.flavour": method.race_flavour for name, method in plan.methods.items()}
    models = {f"robot_models[{index}]": name for index, name in enumerate(plan.robot_models)}
    for index, reality in enumerate(plan.assess.realities):
        if isinstance(reality, str):
            models[f"assess.realities[{index}]"] = reality
    for named, known in ((flavours, shipped.flavours()), (models, shipped.robot_models())):
        for place, name in named.items():
            if name not in known:
                yield f"{plan.where(place)}: expected the name of a shipped one, found {excerpt(name)}"


def study_part(folder: Path) -> PagePart:
    """How far a study is: a table of its designs by state, as HTML.

    Raises:
        StudyError: The folder cannot be read.
    """
    if not (folder / FACTS).exists():
        return PagePart("")
    status = read_status(folder)
    groups: dict[tuple[str, str, int], Counter[State]] = {}
    for one in status.cells:
        key = one.cell.mission, one.cell.method, one.cell.budget
        groups.setdefault(key, Counter())[one.state] += 1
    states = [state for state in _STATES if any(counts[state] for counts in groups.values())]
    rows = [(*key, *(counts[state] or "" for state in states)) for key, counts in groups.items()]
    done = f"{status.counts['done']} of {len(status.cells)} designs are assessed."
    shown = table(("mission", "method", "budget", *states), rows, name="cells")
    return PagePart(section("cells", "Designs", f"<p>{done}</p>", shown))
