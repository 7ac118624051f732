"""The proof of a race's choice: its winner on fresh instances, against others.

The others are the runner-up, random PFSMs (another on each instance), and PFSMs of one state, the simplest ones.
The experiments do not count towards the budget. Instances and random PFSMs depend on the race's seed alone. The results
are kept in the run folder.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mercator_design.config.json_data import read_json
from mercator_design.config.schema import Length, Range
from mercator_design.config.writing import plain
from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.fsm.pfsm import Pfsm, State
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.fsm.text import to_text
from mercator_design.modules.behaviours import BEHAVIOURS
from mercator_design.modules.module import Module, numbered
from mercator_design.race.analysis.pairs import Pair, compared
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.race.session.events import Number
from mercator_design.race.session.record import Record
from mercator_design.seeds import generator, instance_seed
from mercator_design.system.files import write_text, writing

PROOF = "proof.json"
RUNNER_UP, RANDOM, ALONE = "runner-up", "random PFSMs", " alone"
"""Names of contestants; that of a PFSM of one state is its behaviour with `ALONE`."""
_SHARE = 0.08  # of the budget
_MIN_RUNS, _MAX_RUNS = 5, 50  # instances


@dataclass(frozen=True, slots=True, kw_only=True)
class Contestant:
    """A contestant of the proof: the winner, or a PFSM that it is compared with.

    fsm: Its text; empty if each instance has a PFSM of its own.
    scores: On the instances, in their order.
    """

    name: str
    fsm: str
    scores: tuple[Annotated[float, Range(-1e30, 1e30)], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """The contents of proof.json.

    journal: The digest of the race's journal.
    seeds: Seeds of the instances.
    contestants: The winner first.
    """

    journal: str
    seeds: Annotated[tuple[Number, ...], Length(1)]
    contestants: Annotated[tuple[Contestant, ...], Length(2)]

    @property
    def winner(self) -> Scores:
        """The scores of the winner."""
        return Scores(self.contestants[0].scores)

    def pairs(self) -> list[Pair[str]]:
        """The winner against each of the others, by paired tests."""
        scores = {one.name: dict(enumerate(one.scores)) for one in self.contestants}
        winner, *others = scores
        return compared(scores, [(winner, other) for other in others])


def default_runs(designer: Designer, record: Record) -> int:
    """The number of instances for which the experiments are about 8 % of the budget; at least 5, at most 50."""
    n = len(_contestants(designer, record, 1))
    return max(_MIN_RUNS, min(_MAX_RUNS, int(_SHARE * record.budget / n)))


def read_proof(folder: Path, record: Record) -> Proof | None:
    """The proof in a run folder; None if there is none, or if it is of another end of the race.

    Raises:
        RaceError: It is damaged.
    """
    file = folder / PROOF
    if not file.exists():
        return None
    try:
        proof: Proof = read_json(file, Proof, error=RaceError)
    except RaceError as error:
        raise RaceError(f"{error}; delete it to make it again") from None
    if any(len(one.scores) != len(proof.seeds) for one in proof.contestants):
        raise RaceError(f"{file}: expected {len(proof.seeds)} scores of each contestant; delete it to make it again")
    return proof if record.ends and proof.journal == record.ends[-1].digest else None


def prove(
    folder: Path,
    designer: Designer,
    record: Record,
    executor: Executor,
    *,
    runs: int,
    watch: Callable[[int, int], None] = lambda done, total: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> Proof:
    """Run the experiments of a proof, and write it to the run folder.

    Args:
        folder: The run folder.
        designer: The task of the race.
        record: Its record; the race has ended.
        executor: Runs the experiments.
        runs: Number of instances.
        watch: Called with the numbers of experiments done and in all.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        ExecutorStopped: see `stopped`; running experiments have finished.
        MercatorError: An experiment failed, or the proof cannot be written.
    """
    seeds = tuple(instance_seed(designer.optimizer.seed, "proof", instance) for instance in range(runs))
    contestants = _contestants(designer, record, runs)
    items = [one for pfsms in contestants.values() for one in zip(pfsms, seeds, strict=True)]
    found = in_order(executor, designer.function, items, lambda done: watch(done, len(items)), stopped)
    scores = [one.score for one in found]
    proof = Proof(
        journal=record.ends[-1].digest,
        seeds=seeds,
        contestants=tuple(
            Contestant(
                name=name,
                fsm="" if name == RANDOM else to_text(pfsms[0]),
                scores=tuple(scores[k * runs : (k + 1) * runs]),
            )
            for k, (name, pfsms) in enumerate(contestants.items())
        ),
    )
    with writing(folder / PROOF, RaceError):
        write_text(folder / PROOF, json.dumps(plain(proof)) + "\n")
    return proof


def _contestants(designer: Designer, record: Record, runs: int) -> dict[str, list[Pfsm]]:
    """The PFSM of each contestant on each instance, by the contestant's name; the winner first."""
    flavour, space = designer.flavour, designer.optimizer.space
    draws = generator(designer.optimizer.seed, "proof, random PFSMs")

    def random() -> Pfsm:
        drawn = space.build(lambda parameter, bounds: parameter.quantile(float(draws.random()), bounds))
        return to_pfsm(drawn, flavour)

    winner = record.ends[-1].winner
    others = [number for one in reversed(record.view.iterations) for number in one.elites if number != winner]
    raced = {"winner": winner, **({RUNNER_UP: others[0]} if others else {})}
    return {
        **{name: [to_pfsm(record.configurations[number], flavour)] * runs for name, number in raced.items()},
        RANDOM: [random() for _ in range(runs)],
        **{
            behaviour.name.replace("_", " ") + ALONE: [_one_state(behaviour, flavour)] * runs
            for behaviour in numbered(BEHAVIOURS, flavour).values()
        },
    }


def _one_state(behaviour: Module, flavour: str) -> Pfsm:
    """A PFSM of one state; each parameter is the middle of its sampled range, rounded if it is an integer."""
    middles = ((one, sum(one.sampled) / 2) for one in behaviour.parameters)
    values = tuple(float(round(middle)) if one.integer else middle for one, middle in middles)
    return Pfsm((State(behaviour.name, values),), flavour)
