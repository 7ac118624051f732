"""Functions on studies that workers compute: checks before submission, the part of a job's page.

A study of a user is a text with the texts of missions and control software that it names. They are checked in a folder
as they will run in that of the job. As in races, missions name no files, and nobody brings code.
"""

import tempfile
from collections.abc import Iterator, Mapping
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
from mercator_design.studies.plan import StudyPlan
from mercator_design.studies.reading import STATES, read_status
from mercator_design.studies.resolving import resolve

MAX_CELLS = 500
"""Maximum number of designs of a study: each has about ten files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedStudy:
    """Facts and warnings of a study that was checked.

    experiments: At most, of all races and assessments.
    """

    name: str
    experiments: int
    warnings: tuple[str, ...]


def check_study(
    study: str, text: str | None, study_name: str, files: Mapping[str, str], limits: UserLimits
) -> CheckedStudy:
    """Check a study, and that its races can begin.

    Args:
        study: The name of a shipped one.
        text: Instead of it, the text of a study's file.
        study_name: Its name, if the text has none; or empty.
        files: The texts that this names, by their paths beside it.
        limits: Limits of the service.

    Raises:
        MercatorError: It is not valid, names other files, or is beyond a limit; with each mistake.
    """
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as made:
        folder = Path(made).resolve()
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content, encoding="utf-8", newline="")
        try:
            return _checked(_plan(study, text, study_name, folder), folder, files, limits)
        except MercatorError as error:
            raise StudyError(*(one.replace(f"{folder}/", "") for one in error.messages)) from None


def _checked(plan: StudyPlan, folder: Path, files: Mapping[str, str], limits: UserLimits) -> CheckedStudy:
    if wrong := [*_mistakes(plan, folder, files, limits)]:
        raise StudyError(*wrong)
    found = resolve(plan)
    if others := [name for name, method in found.methods.items() if method.flavour not in shipped.flavours()]:
        raise StudyError(*(f"{plan.where(f'methods.{name}')}: expected a shipped flavour" for name in others))
    for label, one in found.missions.items():
        check_limits(one.simulator.mission, limits, label)
    layout = found.layout
    experiments = sum(map(layout.n_experiments, layout.cells))
    if experiments > MAX_BUDGET:
        raise StudyError(f"{plan.name}: expected at most {MAX_BUDGET} experiments, found {experiments}")
    warnings = {
        f"{label}: {without_folders(what)}": None
        for label, one in found.missions.items()
        for flavour in dict.fromkeys(method.flavour for method in found.methods.values())
        for what in mission_warnings(one.simulator, flavour)
    }
    return CheckedStudy(name=plan.name, experiments=experiments, warnings=(*warnings,))


def _plan(study: str, text: str | None, study_name: str, folder: Path) -> StudyPlan:
    if text is not None:
        file = Path(StudyRequest.FILE)
        defaults = {"name": study_name or file.stem}
        own: StudyPlan = parse(text, StudyPlan, error=StudyError, label=file.name, folder=folder, defaults=defaults)
        return own
    name = shipped.named(study, known := shipped.studies(), "study")
    text = text_of(known[name], error=StudyError)
    plan: StudyPlan = parse(text, StudyPlan, error=StudyError, label=name, files=False, defaults={"name": name})
    return plan


def _mistakes(plan: StudyPlan, folder: Path, files: Mapping[str, str], limits: UserLimits) -> Iterator[str]:
    """What a service does not run: code, files that were not sent, missions beyond a limit, too many designs."""

    def found(name: str) -> str:
        return f"found {excerpt(name.removeprefix(f'{folder}/'))}"

    if plan.n_designs > MAX_CELLS:
        yield f"{plan.name}: expected at most {MAX_CELLS} designs, the limit here, found {plan.n_designs}"
    for index, name in enumerate(plan.plugins):
        what = "expected no plugin, as only the administrator of a service brings code, for all"
        yield f"{plan.where(f'plugins[{index}]')}: {what}, {found(name)}"
    named = {key: file.removeprefix(f"{folder}/") for key, file in plan.files.items()}
    for key, file in named.items():
        if file not in files:
            yield f"{plan.where(key)}: expected a file that is sent with the study, {found(file)}"
    for file in sorted(files.keys() - {*named.values()}):
        yield f"{file}: expected only files that the missions and methods of the study name, found one more"
    for index, given in enumerate(plan.mission_entries):
        file = named.get(f"missions[{index}]", "")
        if given.mission is None or (file and file not in files):
            continue
        try:
            MissionSource(name=file or given.mission, text=files.get(file), overrides=given.set).read(limits)
        except MercatorError as error:
            yield from (f"{plan.where(f'missions[{index}]')}: {message}" for message in error.messages)
    flavours = {f"methods.{name}.flavour": method.race_flavour for name, method in plan.methods.items()}
    models = {f"robot_models[{index}]": name for index, name in enumerate(plan.robot_models)}
    for index, reality in enumerate(plan.assess.realities):
        if isinstance(reality, str):
            models[f"assess.realities[{index}]"] = reality
    for keys, known in ((flavours, shipped.flavours()), (models, shipped.robot_models())):
        for key, name in keys.items():
            if name not in known:
                yield f"{plan.where(key)}: expected the name of a shipped one, {found(name)}"


def study_part(folder: Path) -> PagePart:
    """How far a study is: a table of its designs by state, as HTML.

    Raises:
        StudyError: The folder cannot be read.
    """
    if not (folder / FACTS).exists():
        return PagePart("")
    status = read_status(folder)
    groups = status.counts_by_kind
    states = [state for state in STATES if any(counts[state] for counts in groups.values())]
    rows = [(*key, *(counts[state] or "" for state in states)) for key, counts in groups.items()]
    done = f"{status.counts['done']} of {len(status.cells)} designs are assessed."
    shown = table(("mission", "method", "budget", *states), rows, name="cells")
    return PagePart(section("cells", "Designs", f"<p>{done}</p>", shown))
