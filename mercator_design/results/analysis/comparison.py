"""The comparison of a race's winner with others on fresh instances: those on which the winner was tested.

The others are the runner-up, random control software of the flavour (another on each instance), and PFSMs of one state,
the simplest ones, if PFSMs were raced. Their experiments do not count towards the budget; the random ones depend on the
race's seed alone. The results are kept in the run folder.
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
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import Module
from mercator_design.race.analysis.pairs import Pair, compared
from mercator_design.race.executors.executor import Executor, in_order
from mercator_design.race.session.events import Number
from mercator_design.race.session.record import Record
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.seeds import generator
from mercator_design.software.architectures import architecture_of, decoded, text_of
from mercator_design.system.files import write_text, writing

COMPARISON = "comparison.json"
TEST_RUNS = 30
"""Number of fresh instances on which the winner of a race is tested, and others with it, by default."""
RUNNER_UP, RANDOM, ALONE = "runner-up", "random {}s", " alone"
"""Names of contestants, the second with the noun of the architecture; that of a PFSM of one state is its behaviour with
`ALONE`."""
MAX_OTHERS = 50
"""Maximum number of instances on which the others run; the first of those of the winner."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contestant:
    """A contestant of the comparison: the winner, or control software that it is compared with.

    fsm: Its text; empty if each instance has another one.
    scores: On the instances, in their order; those of the others may be fewer.
    """

    name: str
    fsm: str
    scores: Annotated[tuple[Annotated[float, Range(-1e30, 1e30)], ...], Length(1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class WinnerComparison:
    """The contents of comparison.json.

    journal: The digest of the race's journal.
    seeds: Seeds of the instances.
    contestants: The winner first.
    """

    journal: str
    seeds: Annotated[tuple[Number, ...], Length(1)]
    contestants: Annotated[tuple[Contestant, ...], Length(2)]

    def pairs(self, possible: ScoreRange = ANY_SCORE) -> list[Pair[str]]:
        """The winner against each of the others, by paired tests on their common instances."""
        scores = {one.name: dict(enumerate(one.scores)) for one in self.contestants}
        winner, *others = scores
        return compared(scores, [(winner, other) for other in others], possible)


def winner_tests(record: Record) -> dict[int, float]:
    """The scores of the winner on fresh instances, by the seeds of these, in their order."""
    own = sorted(where for where in record.tests if where.configuration == record.view.leader)
    tests = (record.tests[where] for where in own)
    return {one.seed: one.score for one in tests if one.score is not None}


def n_compared(flavour: str, runs: int) -> int:
    """The number of experiments of the others, at most, if the winner was tested on a number of instances."""
    return (2 + len(_alone(flavour))) * min(runs, MAX_OTHERS)


def read_comparison(folder: Path, record: Record) -> WinnerComparison | None:
    """The comparison in a run folder; None if there is none, or if it is of another end of the race or other tests.

    Raises:
        RaceError: It is damaged.
    """
    file = folder / COMPARISON
    if not file.exists():
        return None
    try:
        found: WinnerComparison = read_json(file, WinnerComparison, error=RaceError)
    except RaceError as error:
        raise RaceError(f"{error}; delete it to make it again") from None
    winner, *others = found.contestants
    if len(winner.scores) != len(found.seeds) or any(len(one.scores) > len(found.seeds) for one in others):
        raise RaceError(f"{file}: expected scores on {len(found.seeds)} instances; delete it to make it again")
    is_same = dict(zip(found.seeds, winner.scores, strict=True)) == winner_tests(record)
    return found if is_same and record.ends and found.journal == record.ends[-1].digest else None


def compare_winner(
    folder: Path,
    designer: Designer,
    record: Record,
    executor: Executor,
    *,
    watch: Callable[[int, int], None] = lambda done, total: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> WinnerComparison:
    """Run the experiments of a comparison, and write it to the run folder.

    Args:
        folder: The run folder.
        designer: The task of the race.
        record: Its record; the race has ended, and its winner was tested.
        executor: Runs the experiments.
        watch: Called with the numbers of experiments done and in all.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        ExecutorStopped: see `stopped`; running experiments have finished.
        MercatorError: An experiment failed, or the comparison cannot be written.
    """
    tests = winner_tests(record)
    seeds = [*tests][:MAX_OTHERS]
    n = len(seeds)
    (name, (winner, *_)), *others = _contestants(designer, record, n).items()
    items = [one for _, pfsms in others for one in zip(pfsms, seeds, strict=True)]
    found = in_order(executor, designer.function, items, lambda done: watch(done, len(items)), stopped)
    scores = [one.score for one in found]
    comparison = WinnerComparison(
        journal=record.ends[-1].digest,
        seeds=tuple(tests),
        contestants=(
            Contestant(name=name, fsm=text_of(winner), scores=tuple(tests.values())),
            *(
                Contestant(
                    name=name,
                    fsm="" if name == _random_name(designer.flavour) else text_of(pfsms[0]),
                    scores=tuple(scores[k * n : (k + 1) * n]),
                )
                for k, (name, pfsms) in enumerate(others)
            ),
        ),
    )
    with writing(folder / COMPARISON, RaceError):
        write_text(folder / COMPARISON, json.dumps(plain(comparison)) + "\n")
    return comparison


def _contestants(designer: Designer, record: Record, runs: int) -> dict[str, list[Software]]:
    """The control software of each contestant on each instance, by the contestant's name; the winner first."""
    flavour, space = designer.flavour, designer.optimizer.space
    draws = generator(designer.optimizer.seed, "comparison, random PFSMs")

    def random() -> Software:
        drawn = space.build(lambda parameter, bounds: parameter.quantile(float(draws.random()), bounds))
        return decoded(drawn, flavour)

    winner = record.ends[-1].winner
    others = [number for one in reversed(record.view.iterations) for number in one.elites if number != winner]
    raced = {"winner": winner, **({RUNNER_UP: others[0]} if others else {})}
    return {
        **{name: [decoded(record.configurations[number], flavour)] * runs for name, number in raced.items()},
        _random_name(flavour): [random() for _ in range(runs)],
        **{
            behaviour.name.replace("_", " ") + ALONE: [_one_state(behaviour, flavour)] * runs
            for behaviour in _alone(flavour)
        },
    }


def _random_name(flavour: str) -> str:
    return RANDOM.format(architecture_of(flavour).noun)


def _alone(flavour: str) -> list[Module]:
    """The behaviours of which there are PFSMs of one state."""
    given = flavour_of(flavour)
    return [*given.numbered("behaviour").values()] if given.architecture == "pfsm" else []


def _one_state(behaviour: Module, flavour: str) -> Pfsm:
    """A PFSM of one state; each parameter is the middle of its sampled range, rounded if it is an integer."""
    middles = ((one, sum(one.sampled) / 2) for one in behaviour.parameters)
    values = tuple(float(round(middle)) if one.integer else middle for one, middle in middles)
    return Pfsm((State(behaviour.name, values),), flavour)
