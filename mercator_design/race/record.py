"""What has happened in a race, in memory.

The *digest* is of what happened, not of how: the start, configurations and experiments in order of their numbers, and
the ends. So a race that was stopped and resumed has the same as one that was not, whatever ran its experiments, and a
race that was tested the same as one that was not.
"""

import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from mercator_design.checked_lines import Event
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.events import End, Finished, Iteration, Measured, Revised, Tested
from mercator_design.race.parameter import Configuration
from mercator_design.race.race import Experiment

FORMAT = 1


@dataclass(slots=True)
class Record:
    """What has happened in a race, in memory."""

    start: Event = field(default_factory=dict)
    configurations: dict[int, Configuration] = field(default_factory=dict)
    parents: dict[int, int | None] = field(default_factory=dict)
    experiments: dict[int, Finished] = field(default_factory=dict)
    ahead: dict[Experiment, Measured] = field(default_factory=dict)
    revised: dict[int, dict[Experiment, Revised]] = field(default_factory=dict)  # by number of an experiment
    tests: dict[Experiment, Tested] = field(default_factory=dict)
    iterations: dict[int, Iteration] = field(default_factory=dict)
    budgets: list[int] = field(default_factory=list)  # growing
    ends: list[End] = field(default_factory=list)
    sessions: list[Event] = field(default_factory=list)  # starts and stops of processes

    @property
    def budget(self) -> int:
        """The largest that was given."""
        return self.budgets[-1]

    @property
    def is_complete(self) -> bool:
        """Whether the race has ended under the largest budget."""
        return len(self.ends) == len(self.budgets)

    def results(self) -> list[Finished]:
        """The experiments in order of their numbers, with the scores that they have by now."""
        latest = {where: one for number in sorted(self.revised) for where, one in self.revised[number].items()}
        finished = [self.experiments[number] for number in sorted(self.experiments)]
        if not latest:
            return finished
        newer = [latest.get(Experiment(one.configuration, one.instance)) for one in finished]
        return [
            one if new is None else replace(one, score=new.score, failure=new.failure)
            for one, new in zip(finished, newer, strict=True)
        ]

    def test_scores(self) -> dict[int, tuple[float, ...]]:
        """The scores of each configuration on the test instances, in order of these; without tests that failed."""
        found: dict[int, list[float]] = {}
        for where in sorted(self.tests):
            if (score := self.tests[where].score) is not None:
                found.setdefault(where.configuration, []).append(score)
        return {configuration: tuple(scores) for configuration, scores in found.items()}

    def digest(self, n_ends: int | None = None) -> str:
        """Of the start and all that happened up to one of the ends (by default the last), as hexadecimal text."""
        ends = self.ends[:n_ends]
        most = ends[-1].experiments if ends else len(self.experiments)
        counted = sorted(number for number in self.experiments if number < most)
        digest = hashlib.sha256(_text(self.start).encode())
        raced = {self.experiments[number].configuration for number in counted}
        for number in sorted(raced):
            digest.update(f"\n{number} {self.parents[number]} {_text(self.configurations[number])}".encode())
        for number in counted:
            e = self.experiments[number]
            words = f"\n{number} {e.iteration} {e.configuration} {e.instance} {e.seed} {e.score!r} {e.outcome}"
            digest.update(words.encode())
        for number in sorted(number for number in self.revised if number < most):
            for where, new in sorted(self.revised[number].items()):
                digest.update(f"\nrevised {number} {where.configuration} {where.instance} {new.score!r}".encode())
        for end in ends:
            digest.update(f"\nend {end.budget} {end.experiments} {end.winner}".encode())
        return digest.hexdigest()

    def note(self, events: Sequence[Event]) -> None:
        """Take in events.

        Raises:
            RaceError: One does not fit to those before.
        """
        for event in events:
            self._take(event)

    def begin(self, start: Mapping[str, Any]) -> None:
        """Take in what makes the race."""
        self.note([{"event": "start", "format": FORMAT, **start}])

    def note_experiments(self, finished: Sequence[Finished]) -> None:
        """Take in experiments that have finished."""
        self.note([{"event": "experiment"} | {name: getattr(one, name) for name in _FIELDS} for one in finished])

    def note_iteration(self, iteration: Iteration) -> None:
        """Take in that an iteration has ended."""
        self.note([{"event": "iteration", **asdict(iteration)}])

    def note_test(self, tested: Tested) -> None:
        """Take in a test that has finished."""
        self.note([{"event": "test", **asdict(tested)}])

    def note_ahead(self, experiment: Experiment, measured: Measured) -> None:
        """Take in an experiment that the race has not asked for yet."""
        self.note([{"event": "ahead", **experiment._asdict(), **measured._asdict()}])

    def note_revised(self, revised: Revised) -> None:
        """Take in a score that has replaced another one."""
        self.note([{"event": "revised", **asdict(revised)}])

    def note_end(self, end: End) -> None:
        """Take in that the race has ended, with the digest of all up to there."""
        self.ends.append(end)
        digest = self.digest()
        self.ends.pop()
        self.note(
            [
                {
                    "event": "end",
                    "budget": end.budget,
                    "experiments": end.experiments,
                    "winner": end.winner,
                    "digest": digest,
                }
            ]
        )

    def _take(self, event: Event) -> None:
        event = {**event}
        kind = event.pop("event", None)
        try:
            if not self.start and kind != "start":
                raise ValueError(f"expected the start of a race first, found {excerpt(str(kind))}")  # noqa: TRY301
            match kind:
                case "experiment":
                    one = Finished(**event)
                    if self.experiments.setdefault(one.experiment, one) != one:
                        raise ValueError(f"experiment {one.experiment} finished twice, with different results")  # noqa: TRY301
                case "ahead":
                    where = Experiment(event["configuration"], event["instance"])
                    self.ahead[where] = Measured(event["score"], event["outcome"])
                case "revised":
                    new = Revised(**event)
                    self.revised.setdefault(new.experiment, {})[Experiment(new.configuration, new.instance)] = new
                case "iteration":
                    ended = Iteration(**event | {"elites": tuple(event["elites"])})
                    self.iterations[ended.iteration] = ended
                case "test":
                    test = Tested(**event)
                    where = Experiment(test.configuration, test.instance)
                    if self.tests.setdefault(where, test) != test:
                        raise ValueError(  # noqa: TRY301
                            f"configuration {test.configuration} was tested twice on instance {test.instance}, with "
                            "different results"
                        )
                case "configuration":
                    # Their names are those of other configurations: once in memory is enough.
                    values = {sys.intern(name): value for name, value in event["values"].items()}
                    self.configurations[event["configuration"]] = values
                    self.parents[event["configuration"]] = event["parent"]
                case "start":
                    if self.start or event.get("format") != FORMAT:
                        found = "a second start" if self.start else f"format {event.get('format')}"
                        raise ValueError(f"expected one start, of format {FORMAT}, found {found}")  # noqa: TRY301
                    self.start = event
                    self.budgets = [event["budget"]]
                case "extend":
                    if event["budget"] <= self.budget:
                        raise ValueError(f"expected a budget larger than {self.budget}, found {event['budget']}")  # noqa: TRY301
                    self.budgets.append(event["budget"])
                case "end":
                    self.ends.append(End(**event))
                case "session" | "stop":
                    self.sessions.append({"event": kind, **event})
                case _:
                    raise ValueError(f"expected an event, found {excerpt(str(kind))}")  # noqa: TRY301
        except (ValueError, TypeError, KeyError) as error:
            what = f"{kind} without {error}" if isinstance(error, KeyError) else str(error)
            raise RaceError(what) from None


_FIELDS = Finished.__slots__


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
