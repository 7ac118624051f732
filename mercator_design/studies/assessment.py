"""How a design is assessed: its scores on the study's fresh instances, in each reality; kept in its run folder.

The design of a race is its winner; if the race gives a front, the others of the front are assessed with it. The
instances are those of `mdesign evaluate --seed` with the study's seed, the same for all designs.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from mercator_design.config.checked_lines import to_line
from mercator_design.config.json_data import read_json
from mercator_design.config.schema import Range
from mercator_design.config.writing import plain
from mercator_design.designer import Designer, Experimenter
from mercator_design.errors import StudyError
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.results.analysis.evaluation import Experimenters
from mercator_design.results.analysis.front import file_on_front
from mercator_design.results.files import read_provenance
from mercator_design.seeds import instance_seed
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import text_of
from mercator_design.software.files import read_fsm
from mercator_design.studies.resolving import StudiedMission
from mercator_design.system.files import remove_drafts, write_text

ASSESSMENT = "assessment.json"
_WINNER = ""
"""Stands for the winner among files of the front."""
Score = Annotated[float, Range(-1e30, 1e30)]


Rows = tuple[tuple[Score, ...], ...]
"""Of each instance the scores by each objective."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AssessedOther:
    """Another design of the front than the winner: its text, and its scores in each reality."""

    software: str
    by_objective: Mapping[str, Rows]


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """The contents of assessment.json, a line with a checksum as those of journals: edited scores are refused.

    software: The text of what was assessed.
    seed: That of the study, of which the instances are.
    scores: By reality, on the instances in their order.
    by_objective: The same of a mission with several objectives without weights: of each instance by each.
    front: Of the other designs of the front, by their files.
    """

    software: str
    seed: Annotated[int, Range(0)]
    scores: Mapping[str, tuple[Score, ...]]
    by_objective: Mapping[str, Rows] = field(default_factory=dict)
    front: Mapping[str, AssessedOther] = field(default_factory=dict)

    def rows(self, reality: str, n_objectives: int, other: str = "") -> list[tuple[float, ...]]:
        """The scores of the winner, or of another design of the front, on each instance in a reality.

        Raises:
            StudyError: They are not known by each objective.
        """
        scores = self.scores.get(reality, ())
        if other:
            rows: list[tuple[float, ...]] = [*self.front[other].by_objective.get(reality, ())]
        else:
            rows = [*self.by_objective.get(reality, ())] if n_objectives > 1 else [(score,) for score in scores]
        is_other_number = not other and len(rows) != len(scores)
        if is_other_number or any(len(row) != n_objectives for row in rows):
            raise StudyError(
                f"expected scores of {reality} by each of {n_objectives} objectives, found others: delete it to assess "
                "the design again"
            )
        return rows


def read_assessment(folder: Path) -> Assessment | None:
    """The assessment in a run folder; None if there is none.

    Raises:
        StudyError: It is damaged.
    """
    file = folder / ASSESSMENT
    if not file.exists():
        return None
    try:
        found: Assessment = read_json(file, Assessment, error=StudyError, is_checked=True)
    except StudyError as error:
        raise StudyError(f"{error}; delete it to assess the design again") from None
    return found


def known_rows(
    folder: Path, known: Assessment, reality: str, n_objectives: int, other: str = ""
) -> list[tuple[float, ...]]:
    """As `Assessment.rows`; errors name the file."""
    try:
        return known.rows(reality, n_objectives, other)
    except StudyError as error:
        raise StudyError(f"{folder / ASSESSMENT}: {error}") from None


def front_scores(
    folder: Path, known: Assessment, reality: str, n_objectives: int
) -> dict[str, list[tuple[float, ...]]]:
    """The rows of `known_rows` of all designs of a front by their files, the winner's first."""
    files = {Designer.WINNER: "", **{name: name for name in known.front}}
    return {file: known_rows(folder, known, reality, n_objectives, other) for file, other in files.items()}


def others_on_front(folder: Path) -> tuple[str, ...]:
    """The files of the designs of a race's front in its run folder, without the winner's.

    Raises:
        RaceError: Its provenance cannot be read.
    """
    found = sorted(file.name for file in folder.glob("front-*.txt"))
    winner = file_on_front(read_provenance(folder).winner) if found else ""
    return tuple(name for name in found if name != winner)


def n_missing(
    known: Assessment | None, realities: Mapping[str, object] | tuple[str, ...], runs: int, others: Collection[str] = ()
) -> int:
    """How many experiments an assessment lacks, of the winner and of others of the front."""
    front = {} if known is None else known.front
    done: list[Mapping[str, Sequence[object]]] = [{} if known is None else known.scores]
    done += [front[name].by_objective if name in front else {} for name in others]
    return sum(max(runs - len(own.get(name, ())), 0) for own in done for name in realities)


def assess(
    folder: Path,
    software: Software,
    mission: StudiedMission,
    executor: Executor,
    *,
    seed: int,
    runs: int,
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Run the experiments that an assessment lacks, and write it.

    Args:
        folder: The run folder of the design.
        software: The design.
        mission: Its mission, with the realities.
        executor: Runs the experiments.
        seed: Of the study.
        runs: Number of instances.
        watch: Called with the number of experiments done now.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        StudyError: The assessment is damaged, or of other control software or instances.
        ExecutorStopped: see `stopped`; what has run is lost, as scores are written together.
        MercatorError: An experiment failed.
    """
    known, compared = read_assessment(folder), mission.simulator.mission.compared_by()
    others = others_on_front(folder) if len(compared) > 1 else ()
    designs = {_WINNER: software, **{name: read_fsm(folder / name).software for name in others}}
    texts = {name: text_of(one) for name, one in designs.items()}
    front = {} if known is None else known.front
    before = {name: one.software for name, one in front.items()}
    if known is not None and (known.seed != seed or texts != texts | before | {_WINNER: known.software}):
        raise StudyError(
            f"{folder / ASSESSMENT}: expected scores of the design beside it with seed {seed}, found those of another: "
            "delete it to assess the design again"
        )
    scores: dict[str, dict[str, list[tuple[float, ...]]]] = {name: {} for name in designs}
    if known is not None:
        done = {_WINNER: known.scores, **{name: one.by_objective for name, one in front.items()}}
        for name, reality in ((name, reality) for name, own in done.items() for reality in own):
            scores[name][reality] = known_rows(folder, known, reality, len(compared), name)
    simulators, items, owners = list[Simulator](), list[tuple[int, Software, int]](), list[list[tuple[float, ...]]]()
    for reality, models in mission.realities.items():
        first = len(simulators)
        simulators += models
        for name, one in designs.items():
            own = scores[name].setdefault(reality, [])
            for instance in range(len(own), runs):
                owners.append(own)
                items.append((first + instance % len(models), one, instance_seed(seed, "evaluation", instance)))
    if not items:
        return
    flavour = flavour_of(software.flavour)
    assessor = Experimenters([Experimenter(one, flavour) for one in simulators])
    for own, measured in zip(owners, in_order(executor, assessor, items, watch, stopped), strict=True):
        own.append(measured.scores if len(compared) > 1 else (measured.score,))
    rows = {name: {reality: tuple(one) for reality, one in found.items()} for name, found in scores.items()}
    winner = rows.pop(_WINNER)
    made = Assessment(
        software=texts[_WINNER],
        seed=seed,
        scores={reality: tuple(row[0] for row in one) for reality, one in winner.items()},
        by_objective=winner if len(compared) > 1 else {},
        front={name: AssessedOther(software=texts[name], by_objective=one) for name, one in rows.items()},
    )
    remove_drafts(folder / ASSESSMENT)
    write_text(folder / ASSESSMENT, to_line(plain(made)))
