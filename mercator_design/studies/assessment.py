"""How a design is assessed: its scores on the study's fresh instances, in each reality; kept in its run folder.

The instances are those of `mdesign evaluate --seed` with the study's seed, the same for all designs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from mercator_design.config.checked_lines import to_line
from mercator_design.config.json_data import read_json
from mercator_design.config.schema import Range
from mercator_design.config.writing import plain
from mercator_design.designer import Experimenter
from mercator_design.errors import StudyError
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.results.analysis.evaluation import Experimenters
from mercator_design.seeds import instance_seed
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import text_of
from mercator_design.studies.resolving import StudiedMission
from mercator_design.system.files import remove_drafts, write_text

ASSESSMENT = "assessment.json"
Score = Annotated[float, Range(-1e30, 1e30)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """The contents of assessment.json, a line with a checksum as those of journals: edited scores are refused.

    software: The text of what was assessed.
    seed: That of the study, of which the instances are.
    scores: By reality, on the instances in their order.
    by_objective: The same of a mission with several objectives without weights: of each instance by each.
    """

    software: str
    seed: Annotated[int, Range(0)]
    scores: Mapping[str, tuple[Score, ...]]
    by_objective: Mapping[str, tuple[tuple[Score, ...], ...]] = field(default_factory=dict)

    def rows(self, reality: str, n_objectives: int) -> list[tuple[float, ...]]:
        """The scores by each objective on each instance in a reality.

        Raises:
            StudyError: They are not known by each.
        """
        found = self.scores.get(reality, ())
        rows: list[tuple[float, ...]] = [(score,) for score in found]
        if n_objectives > 1:
            rows = [*self.by_objective.get(reality, ())]
        if len(rows) != len(found) or any(len(row) != n_objectives for row in rows):
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


def known_rows(folder: Path, known: Assessment, reality: str, n_objectives: int) -> list[tuple[float, ...]]:
    """As `Assessment.rows`; errors name the file."""
    try:
        return known.rows(reality, n_objectives)
    except StudyError as error:
        raise StudyError(f"{folder / ASSESSMENT}: {error}") from None


def n_missing(known: Assessment | None, realities: Mapping[str, object] | tuple[str, ...], runs: int) -> int:
    """How many experiments an assessment lacks."""
    done = {} if known is None else known.scores
    return sum(max(runs - len(done.get(name, ())), 0) for name in realities)


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
    text, known = text_of(software), read_assessment(folder)
    if known is not None and (known.software, known.seed) != (text, seed):
        raise StudyError(
            f"{folder / ASSESSMENT}: expected scores of the design beside it with seed {seed}, found those of another: "
            "delete it to assess the design again"
        )
    by_each = mission.simulator.mission.is_ranked_by_all
    n_objectives = len(mission.simulator.mission.objectives) if by_each else 1
    before = {} if known is None else {name: known_rows(folder, known, name, n_objectives) for name in known.scores}
    simulators, items, owners = list[Simulator](), list[tuple[int, Software, int]](), list[str]()
    for name, models in mission.realities.items():
        first = len(simulators)
        simulators += models
        for instance in range(len(before.get(name, ())), runs):
            owners.append(name)
            items.append((first + instance % len(models), software, instance_seed(seed, "evaluation", instance)))
    if not items:
        return
    flavour = flavour_of(software.flavour)
    assessor = Experimenters([Experimenter(one, flavour) for one in simulators])
    scores = {name: [*found] for name, found in before.items()}
    for name, measured in zip(owners, in_order(executor, assessor, items, watch, stopped), strict=True):
        scores.setdefault(name, []).append(measured.scores if by_each else (measured.score,))
    made = Assessment(
        software=text,
        seed=seed,
        scores={name: tuple(row[0] for row in rows) for name, rows in scores.items()},
        by_objective={name: tuple(rows) for name, rows in scores.items()} if by_each else {},
    )
    remove_drafts(folder / ASSESSMENT)
    write_text(folder / ASSESSMENT, to_line(plain(made)))
