"""Experiments as films and pictures, drawn without a display or browser."""

import contextlib
import itertools
import math
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError, excerpt, printable
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor_kernels import colours_at
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.pictures.figures import draw_caption, house_style, save_figure
from mercator_design.show.pictures.scenery import (
    OUTSIDE,
    PIXELS,
    arena_grid,
    covered,
    draw_arena,
    draw_floor,
    draw_light,
    led_colour,
    limits,
    name_zones,
    placed,
    show_pixels,
    state_colour,
)
from mercator_design.system.files import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist

FORMATS = (".mp4", ".gif")

_RATES = {".mp4": 25.0, ".gif": 12.5}  # frames a second
_DPI = 108
_SIZE = 5.2  # of a scene [inches]
_TRAIL = 80  # cycles
_LEGEND, _SWATCH = 84, 6  # letters in a row of the legend, and those that would fill the place of a colour
_ARROW = ((0.75, 0.0), (-0.35, 0.42), (-0.12, 0.0), (-0.35, -0.42))  # shares of the body's radius
_TURNS = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
_LED = np.column_stack([0.22 * np.cos(_TURNS) - 0.6, 0.22 * np.sin(_TURNS)])
"""The disc that has the colour of the LEDs, in the same shares."""

Frame: TypeAlias = NDArray[np.uint8]
"""(rows, columns, 3) red, green and blue."""


class Film:
    """Experiments side by side, as a film at a speed."""

    def __init__(self, shown: Sequence[ShownExperiment], path: Path, *, speed: float, caption: str) -> None:
        """Prepare a film.

        Args:
            shown: The experiments to show.
            path: The file; its suffix is one of FORMATS.
            speed: Seconds of the experiment in a second of the film.
            caption: Line below the scenes.

        Raises:
            MercatorError: A package for this format is missing.
        """
        self._shown, self._path, self._caption = shown, path, caption
        self._rate = _RATES[path.suffix.lower()]
        self._write = _write_gif if path.suffix.lower() == ".gif" else _mp4_writer()
        seconds = max(one.trace.cycles * one.trace.control_period for one in shown)
        self.times: Floats = np.append(np.arange(0.0, seconds, speed / self._rate), seconds)

    def write(self, watch: Callable[[int], None] = lambda done: None) -> None:  # noqa: ARG005 - a name for the reader
        """Write the film; `watch` is called with the number of frames drawn.

        Raises:
            OSError: The file cannot be written.
        """
        with house_style():
            stage = Stage(self._shown, self._caption)
            self._write(self._path, self._frames(stage, watch), self._rate)

    def _frames(self, stage: "Stage", watch: Callable[[int], None]) -> Iterator[Frame]:
        for done, time in enumerate(self.times, start=1):
            yield stage.frame(float(time))
            watch(done)


def save_still(path: Path, shown: Sequence[ShownExperiment], time: float, *, caption: str) -> None:
    """Write a picture of a time [s]; the suffix .png, .svg or .pdf is the format.

    Raises:
        OSError: The file cannot be written.
    """
    with house_style():
        stage = Stage(shown, caption)
        stage.hold(time)
        save_figure(path, stage.figure)


class Stage:
    """A figure of experiments side by side; for each frame, only the moving parts are drawn again."""

    def __init__(self, shown: Sequence[ShownExperiment], caption: str) -> None:
        height = _SIZE + 1.5
        self.figure = Figure(figsize=(_SIZE * len(shown), height), dpi=_DPI)
        self._canvas = cast("Any", FigureCanvasAgg(self.figure))  # without types
        self._scenes = [_Scene(self.figure, one, k / len(shown), 1.0 / len(shown)) for k, one in enumerate(shown)]
        draw_caption(self.figure, caption, 0.05 / height, "bottom")
        self._moving = [artist for scene in self._scenes for artist in scene.moving]
        self._clocks = [scene.clock for scene in self._scenes]
        for artist in (*self._moving, *self._clocks):
            artist.set_animated(True)
        self._canvas.draw()
        self._still = self._with_clocks = self._canvas.copy_from_bbox(self.figure.bbox)

    def hold(self, time: float) -> None:
        """Move all experiments to a time [s], for saving the figure."""
        for scene in self._scenes:
            scene.move(time)
        for artist in (*self._moving, *self._clocks):
            artist.set_animated(False)

    def frame(self, time: float) -> Frame:
        """Move all experiments to a time [s], and draw; times must not decrease."""
        texts = [clock.get_text() for clock in self._clocks]
        for scene in self._scenes:
            scene.move(time)
        if texts != [clock.get_text() for clock in self._clocks]:  # text is slow to draw
            self._canvas.restore_region(self._still)
            for clock in self._clocks:
                self.figure.draw_artist(clock)
            self._with_clocks = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._with_clocks)
        for artist in self._moving:
            self.figure.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3]


class _Scene:
    """One experiment in a figure.

    moving: The parts that change in each frame, from back to front.
    clock: The time and the score, in words.
    """

    def __init__(self, figure: Figure, shown: ShownExperiment, left: float, width: float) -> None:
        self._trace, self._shown = shown.trace, shown
        axes = figure.add_axes((left + 0.1 * width, 0.27, 0.86 * width, 0.62), facecolor=OUTSIDE, aspect="equal")
        low, high = limits(shown)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
        axes.tick_params(length=2.0, width=0.6)
        figure.text(
            left + 0.5 * width, 0.985, excerpt(printable(shown.title)), ha="center", va="top", size=9.0, weight="bold"
        )
        self.clock = figure.text(left + 0.5 * width, 0.94, "", ha="center", va="top", size=8.0)
        self._floor = None
        body = shown.robot_model.body
        self._body, self._arrow = body.outline(), np.array(_ARROW) * body.corner
        self._led = _LED * body.corner
        mission = shown.mission
        if mission is not None:
            draw_arena(axes, mission)
            if len(self._trace.floor.changes):
                self._floor = _ChangingFloor(axes, mission, self._trace)
            else:
                draw_floor(axes, mission, self._trace.floor)
            name_zones(axes, mission, self._trace.floor, self._trace.zone_rows)
            for light in mission.lights:
                draw_light(axes, light, low, high)
        self._bodies = PolyCollection([], edgecolors="black", linewidths=0.6, zorder=10)
        self._arrows = PolyCollection([], facecolors="white", edgecolors="black", linewidths=0.4, zorder=11)
        self._leds = PolyCollection([], edgecolors="black", linewidths=0.4, zorder=12)
        self._trails = LineCollection([], linewidths=1.0, zorder=9)
        for collection in (self._trails, self._bodies, self._arrows, self._leds):
            axes.add_collection(collection, autolim=False)
        timeline = figure.add_axes((left + 0.1 * width, 0.12, 0.86 * width, 0.075))
        self._cursor = _draw_timeline(timeline, shown)
        _draw_legend(figure, shown, left + 0.53 * width)
        floor: list[Artist] = [self._floor.image] if self._floor is not None else []
        self.moving: list[Artist] = [*floor, self._trails, self._bodies, self._arrows, self._leds, self._cursor]

    def move(self, time: float) -> None:
        """Show a time [s]."""
        trace = self._trace
        cycle = min(time / trace.control_period, float(trace.cycles))
        if self._floor is not None:
            self._floor.move(math.ceil(cycle))
        poses = _poses_at(trace, cycle)
        colours = [*map(state_colour, self._shown.colours_at(math.ceil(cycle)).tolist())]
        self._bodies.set_verts(list(placed(self._body, poses)))
        self._bodies.set_facecolor(colours)
        self._arrows.set_verts(list(placed(self._arrow, poses)))
        if self._shown.led_colours is not None:
            leds = self._shown.led_colours[math.ceil(cycle)]
            self._leds.set_verts(list(placed(self._led, poses[leds >= 0])))
            self._leds.set_facecolor([*map(led_colour, leds[leds >= 0].tolist())])
        first = max(math.ceil(cycle) - _TRAIL, 0)
        tracks = trace.poses[first : math.floor(cycle) + 1 : 2, :, :2]
        self._trails.set_segments(list(np.concatenate([tracks, poses[np.newaxis, :, :2]]).swapaxes(0, 1)))
        self._trails.set_edgecolor(colours)
        seconds = cycle * trace.control_period
        text = f"{seconds:.0f} s of {trace.cycles * trace.control_period:g} s"
        done = np.flatnonzero(self._shown.curve.cycles <= cycle)
        if len(done):
            text += f", score so far {self._shown.curve.scores[done[-1]]:.4g}"
        self.clock.set_text(text)
        self._cursor.set_xdata([seconds, seconds])


class _ChangingFloor:
    """A floor whose zones change: only the pixels of zones that have changed are computed again."""

    def __init__(self, axes: Axes, mission: Mission, trace: Trace) -> None:
        self._floor, self._trace, self._cycle = trace.floor.copy(), trace, 0
        grid = arena_grid(mission, PIXELS)
        self._points, self._pixels = grid.reshape(-1, 2), np.round(colours_at(self._floor, grid)).astype(np.uint8)
        self._of_zone = [np.flatnonzero(covered(self._floor, (row,), grid)) for row in range(len(self._floor.zones))]
        self.image = show_pixels(axes, mission, grid[0, :, 0], grid[:, 0, 1], self._pixels)

    def move(self, cycle: int) -> None:
        """Advance to a cycle."""
        before = self._floor.zones.copy()
        poses = np.ascontiguousarray(self._trace.poses)
        for number in range(self._cycle + 1, cycle + 1):
            change_floor(self._floor, poses[number], number * self._trace.control_period)
        self._cycle = max(cycle, self._cycle)
        changed = np.flatnonzero((self._floor.zones != before).any(axis=1))
        if len(changed):
            places = np.unique(np.concatenate([self._of_zone[row] for row in changed]))
            flat = self._pixels.reshape(-1, 3)
            flat[places] = np.round(colours_at(self._floor, self._points[places])).astype(np.uint8)
            self.image.set_data(self._pixels)


def _poses_at(trace: Trace, cycle: float) -> Floats:
    """The poses (robots, 3) at a time between two cycles."""
    before = math.floor(cycle)
    after = min(before + 1, trace.cycles)
    part = cycle - before
    poses: Floats = (1.0 - part) * trace.poses[before] + part * trace.poses[after]
    return poses


def _draw_timeline(axes: Axes, shown: ShownExperiment) -> Line2D:
    """The score so far over time; the cursor on it."""
    period = shown.trace.control_period
    axes.set_xlim(0.0, shown.trace.cycles * period)
    axes.set_xlabel("time [s]", labelpad=1.0)
    axes.tick_params(length=2.0, width=0.6)
    if len(shown.curve.cycles):
        axes.plot(shown.curve.cycles * period, shown.curve.scores, color="#0072b2", linewidth=1.0)
        axes.set_ylabel("score", labelpad=1.0)
        axes.margins(y=0.12)
    else:
        axes.set_yticks([])
    return axes.axvline(0.0, color="#d55e00", linewidth=1.2)


def _draw_legend(figure: Figure, shown: ShownExperiment, middle: float) -> None:
    """The states and LEDs, by colour."""
    handles: list[Patch | Line2D] = [Patch(color=state_colour(number), label=name) for number, name in shown.legend]
    if shown.led_colours is not None:
        handles.append(
            Line2D([], [], marker="o", linewidth=0.0, color="white", markeredgecolor="black", label="LEDs, as set")
        )
    letters = sum(len(str(handle.get_label())) + _SWATCH for handle in handles)
    n_rows = math.ceil(letters / _LEGEND)
    figure.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(middle, 0.035),
        ncols=max(1, math.ceil(len(handles) / max(1, n_rows))),
        frameon=False,
        fontsize=7.0,
        columnspacing=1.0,
        handlelength=1.0,
    )


def _write_gif(path: Path, frames: Iterator[Frame], rate: float) -> None:
    from PIL import Image

    begin = next(frames)
    leds = [level for levels in LED_COLOURS.values() for level in levels]  # may come later only
    n = 255 - len(LED_COLOURS)
    palette = Image.new("P", (1, 1))
    palette.putpalette((Image.fromarray(begin).quantize(n).getpalette() or [])[: 3 * n] + leds)
    pictures: Iterator[Image.Image] = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in itertools.chain([begin], frames)
    )
    with replacing(path) as file:
        duration = round(1000.0 / rate)
        next(pictures).save(file, format="GIF", save_all=True, append_images=pictures, duration=duration, loop=0)


def _mp4_writer() -> Callable[[Path, Iterator[Frame], float], None]:
    """The function that writes frames as H.264.

    Raises:
        MercatorError: imageio-ffmpeg is not installed.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ModuleNotFoundError:
        raise MercatorError(
            "films as .mp4 need the package imageio-ffmpeg: pip install imageio-ffmpeg; films as .gif need no more"
        ) from None
    return partial(_write_mp4, get_ffmpeg_exe())


def _write_mp4(ffmpeg: str, path: Path, frames: Iterator[Frame], rate: float) -> None:
    """Write frames by ffmpeg, a process of its own."""
    frame = next(frames)
    rows, columns = (n - n % 2 for n in frame.shape[:2])  # what every player understands has even sides
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", f"{rate:g}", "-i", "-"]
    made = ["-c:v", "libx264", "-preset", "veryfast", "-crf", "23", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with replacing(path) as draft, tempfile.TemporaryFile() as said:
        line = [ffmpeg, "-y", "-v", "error", *given, *made, "-f", "mp4", draft.name]
        with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said) as process:  # noqa: S603
            assert process.stdin is not None  # noqa: S101 - a pipe
            try:
                for each in itertools.chain([frame], frames):
                    process.stdin.write(np.ascontiguousarray(each[:rows, :columns]).data)
            except BrokenPipeError:
                pass  # ffmpeg has failed, and says why
            except BaseException:
                process.kill()
                raise
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        if process.returncode:
            said.seek(0)
            words = said.read().decode(errors="replace").strip().splitlines() or [f"exit code {process.returncode}"]
            raise OSError(f"ffmpeg: {words[-1]}")
