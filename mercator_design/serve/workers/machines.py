"""Functions on FSMs that workers compute: checks, evaluations, replays."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mercator_design.config.writing import plain
from mercator_design.designer import header_of
from mercator_design.errors import FsmError, MissionError
from mercator_design.fsm.text import to_text
from mercator_design.fsm.words.explain import explanation
from mercator_design.fsm.yaml_form import parse_yaml
from mercator_design.modules.module import KnownSwarm
from mercator_design.race.elimination.summary import Scores
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.serve.settings import UserLimits
from mercator_design.serve.workers.sources import (
    FSM,
    FsmSource,
    MissionSource,
    leader_of,
    raced_fsm,
    text_without_files,
)
from mercator_design.show.charts import Axis, Dot, interval_chart
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.replay import Replay, replay_of
from mercator_design.show.report.markup import p_text
from mercator_design.show.text.evaluations import Comparison, Evaluated, comparison_data
from mercator_design.sim.checks.lint import lint
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import FsmFile, fsm_file_text, fsm_yaml_text

_MAX_CELLS = 1_000_000
"""Maximum number of cycles of all robots in a replay: 20 robots for more than an hour."""
MAX_CHANGES = 100_000
"""Maximum number of changes of zones in the replays of a request."""
_CYCLE = 0.1  # [s] of missions that say nothing else


@dataclass(frozen=True, slots=True, kw_only=True)
class Machines:
    """FSMs that run on the same instances of a mission."""

    fsms: tuple[FsmSource, ...]
    mission: MissionSource
    limits: UserLimits

    def read(self) -> tuple[Simulator, list[FsmFile]]:
        """The simulator, and the FSMs.

        Raises:
            MercatorError: One of them is not valid, or the robots cannot run it.
        """
        simulator = Simulator(self.mission.read(self.limits))
        found = [one.read() for one in self.fsms]
        for one in found:
            simulator.check(one.pfsm)
        return simulator, found


def check_fsm(
    fsm: FsmSource, mission: MissionSource | None, limits: UserLimits, *, narrow: bool = False
) -> dict[str, Any]:
    """Check of an FSM: its mistakes; or if there are none, its forms.

    Raises:
        MissionError: The mission is not valid.
    """
    simulator = None if mission is None else Simulator(mission.read(limits))
    try:
        found = fsm.read()
    except FsmError as error:
        start = f"{FSM}: " if "\n" in fsm.text.strip() else f"{FSM}:1: "  # the line of one line says nothing
        return {"valid": False, "errors": [one.removeprefix(start) for one in error.messages]}
    return {"valid": True, "errors": [], **forms(found, simulator, narrow=narrow)}


def forms(found: FsmFile, simulator: Simulator | None = None, *, narrow: bool = False) -> dict[str, Any]:
    """An FSM as text, YAML, data, explanation and diagram, with findings; on a mission, if one is given."""
    on = None if simulator is None else (simulator.mission, simulator.robot_model)
    written = fsm_yaml_text(FsmFile(software=found.pfsm, header={}, names=found.names))
    swarm = KnownSwarm(_CYCLE) if on is None else KnownSwarm(on[0].control_period, on[0].robots)
    return {
        "text": to_text(found.pfsm),
        "file": fsm_file_text(
            found.pfsm, {} if simulator is None else header_of(simulator, found.pfsm.flavour), found.names
        ),
        "yaml": written,
        "structure": {key: value for key, value in plain(parse_yaml(written, FSM)).items() if key != "header"},
        "explanation": explanation(found.pfsm, found.names, swarm),
        "findings": [asdict(one) for one in lint(found.pfsm, found.names, *(on or ()))],
        "diagram": diagram_svg(found.pfsm, found.names, narrow=narrow),
    }


def winner_of(folder: Path, mission: MissionSource, limits: UserLimits) -> dict[str, Any]:
    """The winner of the race in a run folder, or the best so far, with its forms; the race may be running.

    Raises:
        RaceError: There is none yet, or it is no race of control software.
    """
    record = RaceStatus(folder).read_on()
    (number, headline), view = leader_of(folder, record), record.view
    found = forms(raced_fsm(folder, record, number), Simulator(mission.read(limits)))
    return {
        "configuration": number, "mean": headline.scores.mean, "measured": headline.where,
        "is_winner": view.is_complete, "fsm": {"valid": True, "errors": [], **found},
    }  # fmt: skip


def run_experiments(
    machines: Machines, seeds: Sequence[int], done: int, seconds: float
) -> tuple[tuple[float, ...], float]:
    """Run the next experiments of an evaluation: all FSMs on the first instance, then on the second, ...

    Return their scores, and the time they took [s].

    Args:
        machines: The FSMs and the mission.
        seeds: Seeds of the instances.
        done: The number of experiments that have run.
        seconds: The time after which no further experiment begins.

    Raises:
        MercatorError: One of them cannot run.
    """
    simulator, fsms = machines.read()
    if not done:
        simulator.rehearse(announce=lambda _: None)
    begin, scores = time.monotonic(), list[float]()
    for number in range(done, len(seeds) * len(fsms)):
        instance, place = divmod(number, len(fsms))
        scores.append(simulator.run(fsms[place].pfsm, seeds[instance]).score)
        if time.monotonic() - begin > seconds:
            break
    return tuple(scores), time.monotonic() - begin


def compare_fsms(machines: Machines, seeds: Sequence[int], seed: int, scores: Sequence[float]) -> dict[str, Any]:
    """The figures of an evaluation, as `mdesign evaluate --json` has them for several FSMs; and a chart.

    The scores are in the order of `run_experiments`.
    """
    simulator, fsms = machines.read()
    n, possible = len(fsms), simulator.mission.possible_scores()
    evaluated = [
        Evaluated(source.name, fsm.pfsm, Evaluation(scores=Scores(tuple(scores[k::n]), possible), seeds=tuple(seeds)))
        for k, (source, fsm) in enumerate(zip(machines.fsms, fsms, strict=True))
    ]
    found = Comparison(evaluated, simulator.mission, simulator.robot_model)
    axis = Axis(simulator.mission.score_name)
    return {**comparison_data(found, seed=seed), "chart": interval_chart([*_dots(found)], axis)}


def _dots(found: Comparison) -> Iterator[Dot]:
    for k, one in enumerate(found.of):
        p, scores = found.p_values.get(k), one.scores
        remark = "best mean" if k == found.best and len(found.of) > 1 else "" if p is None else p_text(p)
        yield Dot(one.name, scores.mean, *scores.interval, scores.values, remark, k, scores.quartiles)


def replays(machines: Machines, seed: int) -> list[Replay]:
    """The replays of FSMs on the instance of a seed.

    Raises:
        MercatorError: One of them cannot run, or the experiment is too long to be kept in memory for many users.
    """
    simulator, fsms = machines.read()
    mission = simulator.mission
    if (cells := mission.cycles * mission.robots) > _MAX_CELLS:
        raise MissionError(
            f"{mission.name}: expected at most {_MAX_CELLS:,} cycles of all robots together in a replay, "
            f"found {cells:,}"
        )
    found, changes = list[Replay](), 0
    for source, one in zip(machines.fsms, fsms, strict=True):
        title = f"{source.name} on {mission.name}, seed {seed}"
        found.append(replay_of(ShownExperiment.simulated(simulator, one.pfsm, seed, title=title, states=one.names)))
        changes += len(found[-1]["header"]["floor"]["changes"])
        if changes > MAX_CHANGES:
            raise MissionError(
                f"{mission.name}: expected at most {MAX_CHANGES:,} changes of zones in a replay, found {changes:,}"
            )
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class NewDesign:
    """Files of a new design, and facts of its mission."""

    fsm: str
    mission: str
    mission_name: str
    direction: str


def new_design(machines: Machines) -> NewDesign:
    """The files of a design of one FSM.

    Raises:
        MercatorError: The FSM or its mission is not valid, or the mission has files of its own.
    """
    simulator, (fsm,) = machines.read()
    mission = simulator.mission
    return NewDesign(
        fsm=fsm_file_text(fsm.pfsm, header_of(simulator, fsm.pfsm.flavour), fsm.names),
        mission=text_without_files(mission, simulator.robot_model),
        mission_name=mission.name,
        direction=mission.direction,
    )
