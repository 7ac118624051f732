"""What was run in a study: its plan and dates in one table, and links from its page to designs and their reports."""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from urllib.parse import quote

from mercator_design.results.files import read_provenance
from mercator_design.results.provenance import PROVENANCE
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html, folded, note, section, table
from mercator_design.show.report.page import REPORT
from mercator_design.studies.folder import CELLS, PLAN, StudyFacts, read_facts
from mercator_design.studies.layout import Cell
from mercator_design.studies.plan import StudyMethod, StudyMission, StudyPlan, load_plan
from mercator_design.studies.running import FSM

_DAY_AND_TIME = 16


def what_was_run(folder: Path) -> Html:
    """The section of a study's page on its plan; all links start from the folder.

    Raises:
        StudyError: It is no study's folder, or its plan is damaged.
        RaceError: The provenance of a cell is damaged.
    """
    facts, plan = read_facts(folder), load_plan(folder / PLAN)
    rows = [(key, text) for key, text in _facts(folder, facts, plan) if text]
    cells = sorted(facts.layout.cells, key=lambda cell: (cell.mission, cell.method, cell.budget))
    groups = groupby(cells, key=lambda cell: (cell.mission, cell.method, cell.budget))
    links = [
        (mission, method, budget or "by hand", Html(", ".join(_links(folder, [*group]))))
        for (mission, method, budget), group in groups
    ]
    command = Html(f"<code>mdesign report {CELLS}/MISSION/METHOD/BUDGET/REPETITION</code>")
    designs = folded(
        "Designs and reports",
        table(("mission", "method", "budget", "designs, by repetition"), links, name="cells"),
        note("The report of a race is written by ", command, ", and then linked here when this page is written again."),
    )
    return section("run", "What was run", table(("", ""), rows, name="plan"), designs)


def _facts(folder: Path, facts: StudyFacts, plan: StudyPlan) -> Iterator[tuple[str, str]]:
    """Rows of names and values; files without their folders, as pages are passed on."""
    layout = facts.layout
    yield "description", plan.description
    for name, method in plan.methods.items():
        yield f"method {name}", _method(method, layout.flavours.get(name, ""))
    for entry in plan.mission_entries:
        yield "mission", _mission(entry)
    yield "robot models (design)", ", ".join(sorted({one.robot_model for one in layout.missions.values()}))
    if races := any(n is None for n in layout.methods.values()):
        yield "budgets", f"{', '.join(map(str, layout.budgets))} experiments"
        last = layout.seed + layout.repetitions - 1
        yield "repetitions", f"{layout.repetitions}, with race seeds {layout.seed} to {last}, the same for each method"
    yield "assessed", f"{layout.runs} fresh instances in each reality, of the study's seed {layout.seed}"
    yield (
        "realities",
        ", ".join(
            ["the design model"]
            + [
                one
                if isinstance(one, str)
                else f"{one.label}: {one.sample} models of width {one.width:g}, seed {one.seed}"
                for one in plan.assess.realities
            ]
        ),
    )
    yield "plugins", ", ".join(Path(one).name for one in plan.plugins)
    yield "mercator_design", facts.mercator_design
    cells = (folder / CELLS / cell.path for cell in layout.cells if cell.budget) if races else ()
    known = [read_provenance(cell) for cell in cells if (cell / PROVENANCE).exists()]
    if known:
        start = min(one.started for one in known)
        ends = [one.finished for one in known if one.finished]
        yield "races", f"from {_minute(start)}" + f" to {_minute(max(ends))}" * bool(ends)


def _minute(time: str) -> str:
    return f"{time[:_DAY_AND_TIME].replace('T', ' ')} UTC"


def _method(method: StudyMethod, flavour: str) -> str:
    if method.files is not None:
        return f"{len(method.files)} file{'s' * (len(method.files) > 1)} by hand, flavour {flavour}"
    options = ", ".join(f"{key}={value}" for key, value in (method.options or {}).items())
    return f"{method.race}, flavour {flavour}, {f'options {options}' if options else 'options by default'}"


def _mission(entry: StudyMission) -> str:
    if entry.sample is not None:
        what = f"sampled: {entry.sample}, seeds {', '.join(map(str, entry.seeds or ()))}"
    else:
        what = Path(entry.mission or "").name + f" as {entry.name}" * bool(entry.name)
    return what + f", with {', '.join(entry.set)}" * bool(entry.set)


def _links(folder: Path, cells: list[Cell]) -> Iterator[str]:
    """A link to each design that exists, with one to its report."""
    for cell in cells:
        path = Path(CELLS, cell.path)
        yield _link(folder, path / FSM, str(cell.repetition)) + (
            f" ({_link(folder, path / REPORT, 'report')})" if (folder / path / REPORT).exists() else ""
        )


def _link(folder: Path, file: Path, text: str) -> str:
    is_there = (folder / file).exists()
    return f'<a href="{escaped(quote(file.as_posix()))}">{escaped(text)}</a>' if is_there else escaped(text)
