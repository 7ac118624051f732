"""Progress on stderr: a moving line on a terminal, plain lines elsewhere, or nothing."""

import math
import sys
import threading
import time
from collections.abc import Callable
from datetime import timedelta
from statistics import fmean, stdev
from typing import Literal, NamedTuple, Protocol, Self, get_args

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Column

from mercator_design.command import print_message
from mercator_design.errors import printable
from mercator_design.race.elimination.summary import Elite
from mercator_design.race.elimination.summary import Progress as RaceProgress
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import Event, ExperimentDone, IterationEnded, TestDone
from mercator_design.race.session.view import RaceView

Mode = Literal["auto", "plain", "rich", "none"]
MODES: tuple[Mode, ...] = get_args(Mode)
"""`auto` is `rich` if stderr is a terminal, else `plain`."""
PLAIN_EVERY = 30.0
"""Maximum seconds between two plain lines."""
_WIDE = 100
"""Minimum width of a terminal for a bar and the spread of scores [characters]."""

Clock = Callable[[], float]


class _State(NamedTuple):
    """The state of the work that is shown."""

    text: str
    done: int
    total: int
    rate: float  # per second
    unit: str = "experiments"

    @property
    def pace(self) -> str:
        """The rate as text; empty if it is not known."""
        return f"{self.rate:.0f}/s" if self.rate >= 10 else f"{self.rate:.2g}/s" * (self.rate > 0)

    @property
    def left(self) -> str:
        """The remaining time as text; empty if it is not known or there is none."""
        left = (self.total - self.done) / self.rate if self.rate > 0 else 0.0
        return str(timedelta(seconds=round(left))) if 0.5 < left < 1e9 else ""


class _Line:
    """Shows states; this one shows nothing."""

    every = math.inf
    """Minimum seconds between two updates: computing the progress of a race takes a millisecond."""
    is_wide = False
    """Whether there is space for all figures."""

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def show(self, state: _State) -> None:
        """Show the present state."""

    def conclude(self, state: _State) -> None:
        """Show the state at the end of a part of the work."""


class _PlainLines(_Line):
    """Prints the latest state at least every `PLAIN_EVERY` seconds, also while nothing happens."""

    every = 1.0
    is_wide = True

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._printed = clock()
        self._state: _State | None = None
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()

    def show(self, state: _State) -> None:
        self._state = state
        self.print_if_due()

    def conclude(self, state: _State) -> None:
        with self._lock:
            self._print(state)

    def print_if_due(self) -> None:
        """Print the latest state if the last line is old."""
        with self._lock:
            if self._state is not None and self._clock() - self._printed >= PLAIN_EVERY:
                self._print(self._state)

    def _run(self) -> None:
        while not self._ended.wait(1.0):
            self.print_if_due()

    def _print(self, state: _State) -> None:
        self._printed = self._clock()
        total, pace = f"/{state.total}" if state.total else "", f", {state.pace}" if state.pace else ""
        left = f", {state.left} left" if state.left else ""
        print_message(f"{state.text}, {state.done}{total} {state.unit}{pace}{left}")


class _MovingLine(_Line):
    """A line of a terminal, with a bar if there is space."""

    every = 0.1

    def __init__(self, console: Console) -> None:
        self.is_wide = console.width >= _WIDE
        # If there is too little space, the text is cut, because the figures are more important.
        self._progress = Progress(
            TextColumn(
                "{task.description}",
                markup=False,  # names may have brackets
                table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
            ),
            *([BarColumn(bar_width=10)] if self.is_wide else []),
            MofNCompleteColumn(table_column=Column(no_wrap=True)),
            TextColumn("{task.fields[rate]}", table_column=Column(no_wrap=True)),
            TextColumn("{task.fields[left]}", table_column=Column(no_wrap=True)),
            console=console,
            transient=True,
            expand=True,
            redirect_stdout=sys.stdout.isatty(),
        )
        self._task = self._progress.add_task("", total=None, rate="", left="")

    def start(self) -> None:
        self._progress.start()

    def stop(self) -> None:
        self._progress.stop()

    def show(self, state: _State) -> None:
        self._progress.update(
            self._task,
            completed=state.done,
            total=state.total,
            rate=state.pace,
            left=state.left,
            description=state.text,
        )


class Display:
    """Counts experiments, or other work, with their rate and the remaining time.

    Args:
        what: The text before the count.
        total: Number of experiments; 0 if it is not known.
        mode: How to show it.
        unit: What is counted.
        clock: Seconds.

    Attributes:
        known: Number of experiments that were done before; they do not count for the rate.
    """

    def __init__(
        self,
        what: str,
        total: int,
        mode: Mode = "auto",
        *,
        unit: str = "experiments",
        clock: Clock = time.monotonic,
    ) -> None:
        self.known, self._unit = 0, unit
        self._clock = clock
        self._started = clock()
        self._shown = -math.inf
        console = Console(stderr=True, force_terminal=True if mode == "rich" else None)
        if mode == "auto":
            mode = "rich" if console.is_terminal else "plain"
        self.line = _Line()
        if mode == "rich":
            self.line = _MovingLine(console)
        elif mode == "plain":
            self.line = _PlainLines(clock)
        self._text, self._total = what, total
        self.show(0)

    def __enter__(self) -> Self:
        self.line.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.line.stop()

    def _is_silent(self) -> bool:
        """Whether there was an update just before."""
        now = self._clock()
        if now - self._shown < self.line.every:
            return True
        self._shown = now
        return False

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return self._clock() - self._started

    def show(self, done: int, text: str | None = None, total: int | None = None) -> None:
        """Set the count, the text before it, and the total."""
        self._text = self._text if text is None else text
        self._total = self._total if total is None else total
        self.line.show(self._state(self._text, done))

    def _state(self, text: str, done: int) -> _State:
        return _State(printable(text), done, self._total, self._rate(max(done - self.known, 0)), self._unit)

    def _rate(self, new: int) -> float:
        """What is done in a second, of what is new; 0 if that is not known."""
        return new / max(self.seconds, 1e-3)


class Raced(Protocol):
    """The part of a task that the display needs."""

    @property
    def name(self) -> str:
        """Name of the task."""

    def cost(self, score: float) -> float:
        """The cost of a score."""

    def score(self, cost: float) -> float:
        """The score of a cost."""


class RaceDisplay(Display):
    """Progress of a race: iteration, alive configurations, mean and spread of the best, experiments, remaining time.

    Args:
        task: What is raced.
        view: The state of the race; it takes each event before `note`.
        testing: The tests after the race.
        mode: How to show it.
        plan: The progress of the race's optimizer before it has begun.
        clock: Seconds.
    """

    def __init__(
        self,
        task: Raced,
        view: RaceView,
        testing: Testing | None,
        mode: Mode = "auto",
        *,
        plan: RaceProgress,
        clock: Clock = time.monotonic,
    ) -> None:
        self._task = task
        self._view = view
        self._testing = testing
        self._plan = plan
        self._has_tested = False
        super().__init__(task.name, view.budget, mode, clock=clock)

    @property
    def n_tests(self) -> int:
        """Number of tests after the iterations that have ended so far; at least as many as have run, as of a front."""
        if self._testing is None:
            return 0
        return max(self._testing.n_tests([one.elites for one in self._view.iterations]), len(self._view.tests))

    def note(self, event: Event) -> None:
        """Show the progress after an event."""
        match event:
            case ExperimentDone():
                if not self._is_silent():
                    self._show_race()
            case IterationEnded():
                name = "final race" if event.postselection else f"iteration {event.iteration}"
                is_last = event is self._view.iterations[-1]
                best = self._progress().best if is_last else self._best_of(event)
                text = f"{self._task.name}: {name} ended, {event.alive} alive{self._best_text(best)}"
                n_run = sum(one.used for one in self._view.iterations[: event.iteration])  # there may be more by now
                self.line.conclude(self._state(text, n_run))
            case TestDone():
                if not self._has_tested:
                    self._has_tested = True
                    n_done = len(self._view.tests)
                    self.line.conclude(_State(printable(f"{self._task.name}: testing"), n_done, self.n_tests, 0.0))
                if not self._is_silent():
                    self.show(len(self._view.tests), f"{self._task.name}: testing", self.n_tests)

    def _progress(self) -> RaceProgress:
        return self._view.progress(self._task.cost, self._plan)

    def _show_race(self) -> None:
        now = self._progress()
        # After the last iteration, the rest of the budget goes into a race of the best.
        is_final = 0 < now.iterations < now.iteration
        stage = "final race" if is_final else f"iteration {now.iteration}"
        planned = self._plan.iterations
        if now.iteration < now.iterations or now.iteration == now.iterations == planned:  # no further ones yet
            stage += f"/{now.iterations}"
        text = f"{self._task.name}: {stage}, {now.alive} alive{self._best_text(now.best)}"
        self.show(self._view.n_experiments, text, self._view.budget)

    def _best_of(self, ended: IterationEnded) -> Elite | None:
        """The best of an iteration before the last, with its results at that time."""
        for one in self._view.incumbents:
            if one.ended is ended and one.scores:
                costs = [self._task.cost(score) for score in one.scores.values()]
                sd = stdev(costs) if len(costs) > 1 else math.nan
                return Elite(configuration=ended.elites[0], mean=fmean(costs), sd=sd, n_results=len(costs))
        return None

    def _best_text(self, best: Elite | None) -> str:
        if best is None:
            return ""
        sd = f", sd {best.sd:.3g}" if best.n_results > 1 else ""
        how = f" ({best.n_results} run{'s' * (best.n_results != 1)}{sd})" if self.line.is_wide else ""
        return f", best {self._task.score(best.mean):.4g} in the race{how}"


class AblationDisplay(Display):
    """Progress of an ablation, whose length is not known."""

    def __init__(self) -> None:
        super().__init__("ablation", 0)
        self._is_started = False

    def __enter__(self) -> Self:
        return self  # it starts with the first experiment, as there may be none

    def update(self, step: int, done: int) -> None:
        """Show the current step and the number of experiments done."""
        if not self._is_silent():
            if not self._is_started:
                self._is_started = True
                self.line.start()
            self.show(done, f"ablation: step {step + 1}")
