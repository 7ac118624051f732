"""Functions on run folders that workers compute: parts of a job's page."""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from mercator_design.results.analysis.comparison import read_comparison
from mercator_design.results.experiments.winner import ShownRun, chosen_runs
from mercator_design.results.facts import Facts
from mercator_design.show.report.answer import answer
from mercator_design.show.report.comparison import comparison_part, elites_part
from mercator_design.show.report.course import course
from mercator_design.show.report.importance import importance
from mercator_design.show.report.markup import note
from mercator_design.show.report.origin import origin
from mercator_design.show.report.request import request


@dataclass(frozen=True)
class PagePart:
    """A part of a page.

    text: HTML.
    best: Number of the winner, or of the best configuration so far; None if there is none yet.
    runs: Its median, best and worst run.
    """

    text: str
    best: int | None = None
    runs: tuple[ShownRun, ...] = ()

    @cached_property
    def version(self) -> str:
        """Digest of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]


def race_part(folder: Path) -> PagePart:
    """The race so far, or of a race that has ended its winner and the comparison of it with others, as HTML.

    Raises:
        MercatorError: The folder cannot be read.
    """
    facts = _facts(folder)
    is_compared = facts.record.is_complete and facts.designer is not None
    comparison = read_comparison(folder, facts.record) if is_compared else None
    notes = [note(f"Note: {text}") for text in facts.notes]
    sections = [course(facts)]
    if facts.record.is_complete:
        sections = [comparison_part(facts, comparison, ""), *sections, elites_part(facts), importance(facts)]
    text = "".join([*notes, answer(facts, comparison, []), *sections])
    return PagePart(text, facts.best, tuple(chosen_runs(facts)))


def about_part(folder: Path) -> PagePart:
    """Request and origin of the race, as HTML.

    Raises:
        MercatorError: The folder cannot be read.
    """
    facts = _facts(folder)
    return PagePart(request(facts) + origin(facts))


def _facts(folder: Path) -> Facts:
    """The facts of a run folder, whose commands name it as users know it."""
    return replace(Facts.read(folder), named=Path(folder.name))
