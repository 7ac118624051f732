"""Films, pictures and plots, drawn without a display."""

import dataclasses
import io
import subprocess

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

import mercator_design as md
from mercator_design.errors import MercatorError
from mercator_design.show.pictures.figures import house_style
from mercator_design.show.pictures.film import Film, Stage, save_still
from mercator_design.show.pictures.plots import KINDS, plots, save_plots, usual_kinds
from mercator_design.show.pictures.scenery import limits
from tests.tiers import some

CAPTION = "mdesign replay fsm.txt --video film.mp4"
BLUE = (0, 114, 178)


def has(frame, colour):
    return (np.abs(frame.astype(int) - colour).max(axis=-1) < 12).any()


def decoded(path):
    """The frames of a film, by ffmpeg as pictures in PPM."""
    line = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", path, "-f", "image2pipe", "-c:v", "ppm", "-"]
    data = io.BytesIO(subprocess.run(line, capture_output=True, check=True).stdout)
    frames = []
    while data.readline() == b"P6\n":
        width, height = map(int, data.readline().split())
        assert data.readline() == b"255\n"
        frames.append(np.frombuffer(data.read(3 * width * height), np.uint8).reshape(height, width, 3))
    return frames


@pytest.mark.thorough
def test_mp4(shown, tmp_path):
    film = Film([shown], tmp_path / "film.mp4", speed=24.0, caption=CAPTION)
    seen = []
    film.write(seen.append)
    images = decoded(tmp_path / "film.mp4")
    assert len(images) == len(film.times) == seen[-1]
    assert images[0].shape[0] % 2 == images[0].shape[1] % 2 == 0
    assert film.times[-1] == 6.0
    assert all(has(image, BLUE) for image in images)
    assert (images[0] != images[-1]).any()
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_gif(cleaning, tmp_path):
    film = Film([cleaning], tmp_path / "film.gif", speed=48.0, caption=CAPTION)
    film.write()
    with Image.open(tmp_path / "film.gif") as image:
        assert image.n_frames == len(film.times) > 2
        assert has(np.asarray(image.convert("RGB")), BLUE)


def test_nothing_is_left_of_a_film_that_fails(shown, tmp_path):
    film = Film([shown], tmp_path / "film.mp4", speed=24.0, caption=CAPTION)

    def fail(done):
        if done == 3:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        film.write(fail)
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_mp4_that_ffmpeg_cannot_write(shown, tmp_path, monkeypatch):
    path = tmp_path / "film.mp4"
    path.write_bytes(b"the film before")
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\ncat > /dev/null\necho 'No space left on device' >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(program))
    with pytest.raises(OSError, match="ffmpeg: No space left on device"):
        Film([shown], path, speed=24.0, caption=CAPTION).write()
    assert path.read_bytes() == b"the film before"
    assert {one.name for one in tmp_path.iterdir()} == {"film.mp4", "ffmpeg"}


@pytest.mark.thorough
def test_words_of_others_in_pictures(shown, tmp_path):
    formula, letters = r"a$\frac$ $$ $\def\x$b", "\x1b[31m漢字\x07" + "x" * 10_000
    one = dataclasses.replace(shown, title=formula)
    save_still(tmp_path / "still.png", [one], 1.0, caption=letters)
    save_plots(tmp_path / "plot.png", [dataclasses.replace(shown, title=letters)], ["score"], caption=formula)


def test_mp4_without_its_package(shown, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MercatorError, match="need the package imageio-ffmpeg"):
        Film([shown], tmp_path / "film.mp4", speed=24.0, caption=CAPTION)


@pytest.mark.thorough
def test_picture(shown, tmp_path):
    paths = [tmp_path / "still.png", tmp_path / "again.png"]
    for path in paths:
        save_still(path, [shown, shown], 3.0, caption=CAPTION)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with Image.open(paths[0]) as image:
        assert image.width > 1.5 * image.height


def test_robots_are_drawn_where_they_are(shown):
    with house_style():
        stage = Stage([shown], CAPTION)
        frame = stage.frame(3.0)
        axes = stage.figure.axes[0]
        x, y, _ = shown.trace.poses[30, 0]
        column, row = axes.transData.transform((x, y))
    near = frame[len(frame) - round(row) - 3 : len(frame) - round(row) + 3, round(column) - 3 : round(column) + 3]
    assert (near == 255).all(axis=-1).any()  # the arrow


@pytest.mark.thorough
def test_floor_changes_in_a_film(cleaning):
    with house_style():
        stage = Stage([cleaning], CAPTION)
        before = stage.frame(0.0).copy()
        after = stage.frame(20.0)
        axes = stage.figure.axes[0]
        zones = cleaning.trace.zone_colors(tuple(cleaning.trace.zone_rows))[-1]
        cleaned = cleaning.trace.floor.zones[np.flatnonzero((zones == 127.0).all(axis=1))[0]]
        corners = cleaned[1:3] + 0.8 * cleaned[3:5] * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        places = [(len(before) - round(y), round(x)) for x, y in axes.transData.transform(corners)]
    assert [0, 0, 0] in [before[place].tolist() for place in places]
    assert [0, 0, 0] not in [after[place].tolist() for place in places]


@pytest.mark.thorough
def test_swarm_without_an_arena(shown, tmp_path):
    alone = dataclasses.replace(shown, mission=None, pfsms=(), pfsm_of=(), fired=None, recording=None)
    save_still(tmp_path / "still.png", [alone], 1.0, caption=CAPTION)
    save_plots(tmp_path / "plots.png", [alone], [*KINDS], caption=CAPTION)
    low, high = limits(alone)
    places = alone.trace.poses[..., :2]
    assert (low < places.min(axis=(0, 1))).all()
    assert (high > places.max(axis=(0, 1))).all()


def test_plots_have_units_legends_and_the_command(shown):
    with house_style():
        figure = plots([shown, shown], usual_kinds([shown]), caption=CAPTION)
    axes = figure.axes
    labels = {(one.get_xlabel(), one.get_ylabel()) for one in axes}
    assert labels == {("x [m]", "y [m]"), ("time [s]", "robot"), ("time [s]", "distance [m]"), ("time [s]", "score")}
    assert sum(one.get_legend() is not None for one in axes) == 8  # presence has a bar of colours
    assert CAPTION in [text.get_text() for text in figure.texts]


def test_legend_of_different_pfsms(shown):
    other = md.parse_fsm("--nstates 1 --s0 1")
    mixed = dataclasses.replace(shown, pfsms=(*shown.pfsms, other), pfsm_of=(0, 1, 0), named_states=())
    with house_style():
        stage = Stage([mixed], CAPTION)
    (legend,) = stage.figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["state 0", "state 1"]


def test_distances(shown):
    with house_style():
        figure = plots([shown], ["distances"], caption=CAPTION)
    nearest, pairs = (line.get_ydata() for line in figure.axes[0].lines)
    places = shown.trace.poses[-1, :, :2]
    between = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    assert pairs[-1] == pytest.approx(between.sum() / 6)
    assert nearest[-1] == pytest.approx(np.sort(between, axis=1)[:, 1].mean())


def test_presence_is_the_time_of_all_robots(shown):
    with house_style():
        figure = plots([shown], ["presence"], caption=CAPTION)
    mesh = figure.axes[0].collections[0]
    assert mesh.get_array().sum() == pytest.approx(3 * 6.0)


@pytest.mark.swept
@pytest.mark.parametrize("suffix", some(["png", "svg", "pdf"], 1))
def test_plot_files(suffix, shown, tmp_path):
    path = tmp_path / f"plots.{suffix}"
    save_plots(path, [shown], ["states", "score"], caption="$x^2$ <script>")
    assert path.stat().st_size > 5000
