"""Progress bars on stderr; none if stderr is not a terminal."""

import time
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from mercator_design.errors import printable
from mercator_design.race.running.evaluation import Testing
from mercator_design.race.running.events import Event, ExperimentDone, TestDone
from mercator_design.race.running.task import Task

_REFRESH = 0.1
"""Seconds between two updates."""
_WIDE = 100
"""Minimum width of a terminal for a bar and the spread of scores [characters]."""


class Display:
    """A line that counts experiments, with their rate, the remaining time, and a bar if there is space."""

    def __init__(self, what: str, total: int) -> None:
        console = Console(stderr=True)
        self._started = time.monotonic()
        self._shown = 0.0
        self._is_wide = console.width >= _WIDE
        # If there is too little space, the text is cut, because the figures are more important.
        self._progress = Progress(
            TextColumn(
                "{task.description}",
                markup=False,  # names may have brackets
                table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
            ),
            *([BarColumn(bar_width=10)] if self._is_wide else []),
            MofNCompleteColumn(table_column=Column(no_wrap=True)),
            TextColumn("{task.fields[rate]}", table_column=Column(no_wrap=True)),
            TimeRemainingColumn(table_column=Column(no_wrap=True)),
            console=console,
            disable=not console.is_terminal,
            transient=True,
            expand=True,
        )
        self._task = self._progress.add_task(printable(what), total=total, rate="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def _is_silent(self) -> bool:
        """Whether nothing is shown, or there was an update just before."""
        now = time.monotonic()
        if self._progress.disable or now - self._shown < _REFRESH:
            return True
        self._shown = now
        return False

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._started

    def show(self, done: int, description: str | None = None, total: int | None = None) -> None:
        """Set the count, the text before the bar, and the total."""
        description = None if description is None else printable(description)
        rate = f"{done / max(self.seconds, 1e-3):.0f}/s"
        self._progress.update(self._task, completed=done, total=total, rate=rate, description=description)


class RaceDisplay(Display):
    """Progress of a race: iteration, alive configurations, mean and spread of the best, experiments, remaining time."""

    def __init__(self, task: Task[Any], budget: int, testing: Testing | None) -> None:
        self._raced = task
        self._testing = testing
        self._n_run = self._n_tested = 0
        self._planned = task.optimizer.progress.iterations
        super().__init__(task.name, budget)

    def note(self, event: Event) -> None:
        """Show the progress after an event."""
        match event:
            case ExperimentDone():
                self._n_run += 1
                if not self._is_silent():
                    self._show_race()
            case TestDone():
                self._n_tested += 1
                if self._testing is not None and not self._is_silent():
                    n_tests = len(self._testing.experiments(self._raced.optimizer))
                    self.show(self._n_tested, f"{self._raced.name}: testing", n_tests)

    def _show_race(self) -> None:
        now = self._raced.optimizer.progress
        best = ""
        if now.best is not None:
            sd = f"sd {now.best.sd:.3g}, " if now.best.n_results > 1 else ""
            how = f" ({sd}n={now.best.n_results})" if self._is_wide else ""
            best = f", best {self._raced.score(now.best.mean):.4g}{how}"
        # After the last iteration, the rest of the budget goes into a race of the best.
        stage = f"iteration {now.iteration}" if now.iteration <= now.iterations else "final race"
        if now.iteration < now.iterations or now.iteration == now.iterations == self._planned:  # no further ones yet
            stage += f"/{now.iterations}"
        self.show(self._n_run, f"{self._raced.name}: {stage}, {now.alive} alive{best}")


class AblationDisplay(Display):
    """Progress of an ablation, whose length is not known."""

    def __init__(self) -> None:
        super().__init__("ablation", 0)

    def __enter__(self) -> Self:
        return self  # it starts with the first experiment, as there may be none

    def update(self, step: int, done: int) -> None:
        """Show the current step and the number of experiments done."""
        if not self._is_silent():
            self._progress.start()
            self.show(done, f"ablation: step {step + 1}")
