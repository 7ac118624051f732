"""`mdesign calibrate`, on recordings whose noise is known. Seeds are fixed; bounds have chances below 1e-6."""

import json
import math

import numpy as np
import pytest

from mercator_design.calibration import noise
from mercator_design.calibration.scenes import read_recording
from mercator_design.robot.logs.events import FORMAT
from mercator_design.robot.logs.log import to_lines
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Uniform
from tests.calibration import recordings
from tests.calibration.recordings import CENTRES, NOISE, measured, write

MODEL = {
    "proximity": Gaussian(sd=0.03),
    "ground": Gaussian(sd=5.0),
    "lidar": Uniform(half_width=0.005),
    "ambient_light": Gaussian(sd=3.0),
    "velocity": Uniform(half_width=0.01),
    "accelerometer": Gaussian(sd=0.02),
    "gyroscope": Gaussian(sd=0.004),
    "imu": Uniform(half_width=0.002),
    "locator": Gaussian(sd=0.001),
    "quaternion": Gaussian(sd=0.003),
}
"""The noise of `recordings.NOISE` as robot models have it."""


@pytest.fixture(autouse=True)
def few_simulations(monkeypatch):
    """Of fits, whose intervals and p-values test_noise.py tests."""
    monkeypatch.setattr(noise, "SIMULATIONS", 39)


@pytest.fixture
def calibrate(mdesign, tmp_path):
    """Run the command; gives its JSON, by sensor, its notes, and what it said."""

    def run(*arguments):
        code, out, err = mdesign("calibrate", *arguments, "--json", "-o", tmp_path / "model.yaml")
        assert code == 0, err
        found = json.loads(out)
        return {one["sensor"]: one for one in found["sensors"]}, "\n".join(found["notes"]), err

    return run


def only(*sensors):
    return {sensor: CENTRES[sensor] for sensor in sensors}


def test_every_sensor(calibrate, mdesign, tmp_path):
    days = {seed: f"2026-01-0{seed}T12:00:00+00:00" for seed in (1, 2)}
    scenes = [write(tmp_path / f"{seed}.jsonl", measured(15.0, seed), time=day) for seed, day in days.items()]
    sensors, notes, err = calibrate(*scenes, "--plot", tmp_path / "noise.png", "--name", "ours")
    assert [*sensors] == [*MODEL]
    assert "left out" not in notes
    assert [line.removeprefix("Note: ") for line in err.splitlines()] == notes.splitlines()
    model = load_robot_model(str(tmp_path / "model.yaml"))
    assert model.name == "ours"
    assert model.body == load_robot_model("mercator").body
    for key, expected in MODEL.items():
        found, one = getattr(model, key).noise, sensors[key]
        assert type(found) is type(expected), key
        assert one["scenes"] == 2
        name = one["distribution"]
        parameter = {"gaussian": "sd", "uniform": "half_width"}[name]
        assert getattr(found, parameter) == pytest.approx(one["parameter"], rel=1e-3)
        # Six standard errors of a standard deviation, which are more than a half width is ever off.
        error = 1.0 / np.sqrt(2.0 * (one["samples"] - one["channels"]))
        assert one["parameter"] == pytest.approx(getattr(expected, parameter), rel=6.0 * error + 0.01), key
        low, high = one["interval"]
        assert low < one["parameter"] < high
        assert one["aic_difference"] > 10.0
    assert (tmp_path / "noise.png").read_bytes().startswith(b"\x89PNG")
    options = ("--fsm-config", "--nstates 1 --s0 0 --rwm0 20", "--mission", "aggregation", "-n", 2, "-j", 1)
    code, out, err = mdesign("evaluate", *options, "--robot-model", tmp_path / "model.yaml")
    assert (code, "ours" in out) == (0, True), err


def test_the_page_and_the_model_tell_what_was_found(mdesign, tmp_path):
    given = NOISE | {"velocity": recordings.gaussian(0.0), "ground": recordings.gaussian(0.0)}
    sensors = ("proximity", "ground", "velocity")
    file = write(tmp_path / "still.jsonl", measured(noise=given, centres=only(*sensors)))
    code, out, err = mdesign("calibrate", file, "-o", tmp_path / "model.yaml")
    assert (code, err) == (0, "")
    title, *rows = out.splitlines()
    assert title.split()[:4] == ["sensor", "samples", "scenes", "noise"]
    assert rows[0].split()[:4] == ["proximity", "1440", "1", "gaussian,"]
    assert "none: all samples of a channel are equal" in rows[1]
    text = (tmp_path / "model.yaml").read_text()
    assert "still.jsonl: tester, 2026-01-01T12:00:00+00:00, 30 s" in text
    assert "noise: {distribution: gaussian, sd: 0.0" in text
    assert "noise: null  # all samples of a channel are equal; 1800 samples" in text
    assert "velocity" not in text  # has none in the base either
    model = load_robot_model(str(tmp_path / "model.yaml"))
    assert (model.name, model.ground.noise) == ("model", None)


def test_a_robot_that_is_moved_between_is_seen_in_two_places(calibrate, tmp_path):
    """As one that is put from one colour on another."""
    centres = only("ground", "attitude", "turning")
    parts = [measured(20.0, seed, centres=centres) for seed in (1, 2, 3)]
    found = {}
    for sensor in centres:
        times = np.concatenate([20.0 * k + part[sensor][0] for k, part in enumerate(parts)])
        values = [part[sensor][1] for part in parts]
        if sensor == "attitude":
            values[1] = values[1] + [0.3, 0.1, 1.0] * np.linspace(0.0, 1.0, len(values[1]))[:, np.newaxis]
            values[2] = values[2] + [0.3, 0.1, 1.0]
        if sensor == "ground":
            values[2] = values[2] + [60.0, -40.0, 0.0]
        found[sensor] = times, np.concatenate(values)
    file = write(tmp_path / "moved.jsonl", found)
    recording = read_recording(file)
    ((begin, end),) = recording.moves
    assert (begin, end) == (pytest.approx(20.0, abs=2.0), pytest.approx(40.0, abs=2.0))
    sensors, notes, _ = calibrate(file)
    assert "the robot was moved from" in notes
    assert sensors["ground"]["scenes"] == 2
    assert sensors["ground"]["parameter"] == pytest.approx(5.0, rel=0.1)
    assert sensors["imu"]["parameter"] == pytest.approx(0.002, rel=0.05)


def test_a_robot_that_is_driven_rests_before_and_after(tmp_path):
    """However slowly it goes."""
    found = measured(40.0, centres=only("ground", "attitude"))
    times = np.arange(0.0, 40.0, 0.05)
    found["wheels"] = times, np.where((times > 15.0) & (times < 22.0), 1e-3, 0.0)[:, np.newaxis] * [1.0, 1.0]
    recording = read_recording(write(tmp_path / "drive.jsonl", found))
    assert (recording.moves, recording.rest) == ([(14.0, 23.0)], pytest.approx(17.0, abs=0.1))
    assert [scene.name for scene in recording.scenes] == ["drive.jsonl, 0 to 14 s", "drive.jsonl, 23 to 40 s"]


def test_yaw_goes_on_where_it_wraps(tmp_path):
    found = measured(30.0, centres=only("attitude"))
    times, values = found["attitude"]
    values[:, 2] = (values[:, 2] + 0.002 * times - 0.03) % math.tau - math.pi
    assert (values[0, 2] > 3.0, values[-1, 2] < -3.0) == (True, True)
    assert not read_recording(write(tmp_path / "still.jsonl", found)).moves


def test_beams_count_from_the_lidar_s_front(tmp_path):
    ranges = 1.0 + 0.01 * np.arange(recordings.BEAMS)
    found = {"lidar": (np.arange(40) / 7.0, np.tile(ranges, (40, 1)))}
    for angle in (0.0, 0.5):
        path = write(tmp_path / f"{angle}.jsonl", found, lidar_angle=angle)
        (scene,) = read_recording(path).scenes
        assert scene.sensors["lidar"].values == pytest.approx(np.tile([ranges[0], *ranges[:0:-1]], (40, 1)))
        assert scene.sensors["lidar"].angles == pytest.approx(0.0, abs=1e-4)


def test_a_drift_that_is_small_beside_the_noise_is_kept(calibrate, tmp_path):
    """Though there is no doubt of it."""
    found = measured(180.0, centres=only("ambient_light"))
    times, values = found["ambient_light"]
    values[:, 0] += 0.6 * 3.0 * times / 180.0
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", found))
    assert "drift" not in notes
    assert sensors["ambient_light"]["channels"] == 1


def test_recordings_of_several_robots_are_told(calibrate, tmp_path):
    files = [write(tmp_path / f"{k}.jsonl", measured(centres=only("turning")), robot=f"robot-{k}") for k in (1, 2)]
    _, notes, _ = calibrate(*files)
    assert "recordings of robot-1, robot-2: what is fitted is the noise of all of them together" in notes


def test_what_is_left_out(calibrate, tmp_path):
    """What is cut off, drifts, or sees nothing; beams beside an edge and on a slanting wall."""
    centres = {name: [*CENTRES[name]] for name in ("ground", "proximity", "lidar")}
    centres["ground"][0] = 250.0
    centres["lidar"][40:60] = [3.0] * 20
    centres["lidar"][80:110] = list(1.5 + 0.01 * np.arange(30))
    found = measured(60.0, centres=centres)
    found["ground"][1].clip(0.0, 255.0, out=found["ground"][1])
    times, distances = found["proximity"]
    distances[:, 2] += 0.003 * times
    distances[:, 4] = np.inf
    distances[:, 5] = -np.inf
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", found))
    assert "ground, still.jsonl: 1 of 3 channels left out: too near to the ends of the range, 0 to 255" in notes
    assert "proximity, still.jsonl: 2 of 8 channels left out: they measure nothing" in notes
    assert "proximity, still.jsonl: 1 of 8 channels left out: they drift, by up to 0.18 in 60 s" in notes
    assert "lidar, still.jsonl: " in notes
    assert (sensors["ground"]["channels"], sensors["proximity"]["channels"]) == (2, 5)
    assert sensors["lidar"]["channels"] == recordings.BEAMS - 4 - 31
    assert sensors["proximity"]["parameter"] == pytest.approx(0.03, rel=0.15)
    assert sensors["lidar"]["parameter"] == pytest.approx(0.005, rel=0.03)


def test_wild_samples_are_no_noise(calibrate, tmp_path):
    """Half a percent of them, anywhere, would widen it eightfold."""
    found = measured(60.0, noise={"proximity": recordings.gaussian(0.005)}, centres=only("proximity"))
    random, (_, distances) = np.random.default_rng(4), found["proximity"]
    distances.flat[random.choice(distances.size, 15, replace=False)] = np.linspace(1.75, 1.9, 15).round(3)
    distances[:4, 2] = 0.0  # too near to tell
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", found))
    assert "proximity, still.jsonl: 15 of 2876 samples left out: they lie far from the others" in notes
    assert (sensors["proximity"]["samples"], sensors["proximity"]["channels"]) == (2861, 8)
    assert sensors["proximity"]["parameter"] == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("sd", [0.4, 0.8, 1.4, 2.1])
def test_noise_of_few_steps_has_no_wild_samples(calibrate, tmp_path, sd):
    """Where the median of distances is a whole step, and tells little."""
    given = {"ground": recordings.gaussian(sd)}
    centres = {"ground": [100.0, 120.5, 140.3]}
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", measured(60.0, noise=given, centres=centres)))
    assert sensors["ground"]["samples"] == 3600, notes
    assert sensors["ground"]["parameter"] == pytest.approx(sd, rel=0.12)


def test_a_channel_that_is_noisier_than_others_has_no_wild_samples(calibrate, tmp_path):
    found = measured(60.0, noise={"proximity": recordings.gaussian(0.003)}, centres=only("proximity"))
    _, distances = found["proximity"]
    distances[:, 3] += np.random.default_rng(4).normal(0.0, 0.03, len(distances)).round(3)
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", found))
    assert sensors["proximity"]["samples"] == 2880, notes


def test_beams_of_a_short_scene_are_flat(calibrate, tmp_path):
    """By chance, means of a few samples differ by more than by a slanting wall, and samples seem to drift."""
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", measured(5.5, centres=only("lidar"))))
    assert sensors["lidar"]["channels"] >= recordings.BEAMS - 16, notes
    assert "drift" not in notes


def test_a_lidar_whose_angles_change_from_turn_to_turn(calibrate, tmp_path, monkeypatch):
    """Where walls slant a little, ranges change with angles, here as much as by noise; that is no noise."""
    jitter, usual = np.random.default_rng(4), recordings.turn

    def turn(ranges, front):
        off = jitter.uniform(-0.02, 0.02)
        return [[angle + off, round(reach - 0.04 * off, 5)] for angle, reach in usual(ranges, front)]

    monkeypatch.setattr(recordings, "turn", turn)
    given = {"lidar": recordings.gaussian(0.0005)}
    sensors, _, _ = calibrate(write(tmp_path / "still.jsonl", measured(30.0, noise=given, centres=only("lidar"))))
    assert sensors["lidar"]["distribution"] == "gaussian"
    assert sensors["lidar"]["parameter"] == pytest.approx(0.0005, rel=0.03)


def test_a_lidar_that_sees_nothing(calibrate, tmp_path):
    """As one whose beams go above the walls."""
    given = NOISE | {"lidar": recordings.gaussian(0.0)}
    file = write(tmp_path / "still.jsonl", measured(noise=given, centres=only("ground") | {"lidar": [0.0] * 120}))
    sensors, notes, _ = calibrate(file)
    assert [*sensors] == ["ground"]
    assert "\n# lidar: too little that can be used; as in the base\n" in (tmp_path / "model.yaml").read_text()
    assert "lidar: none of its samples can be used" in notes
    assert "lidar, still.jsonl: 120 of 120 channels left out: they measure nothing" in notes


def test_samples_that_follow_each_other(calibrate, tmp_path):
    found = measured(60.0, centres=only("turning"))
    times, values = found["turning"]
    values[1:] = 0.5 * (values[1:] + values[:-1])
    _, notes, _ = calibrate(write(tmp_path / "still.jsonl", {"turning": (times, values)}))
    assert "gyroscope: samples resemble those before them (correlation 0." in notes


def test_noise_that_the_step_hides(calibrate, tmp_path):
    centres = {"ground": [100.0, 120.5, 140.0]}
    given = {"ground": recordings.gaussian(0.05)}
    sensors, _, _ = calibrate(write(tmp_path / "still.jsonl", measured(noise=given, centres=centres)))
    assert sensors["ground"]["distribution"] is None
    assert sensors["ground"]["step"] == 1.0
    assert "null  # less than the step of its values, 1; 1800 samples" in (tmp_path / "model.yaml").read_text()


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (
            5.8,
            "ambient_light: expected at least 101 samples (100, and one for each channel) that can be used, found 29",
        ),
        (1.0, "expected a robot at rest for 5 s, found 0.8 s at most (recording: 0.8 s)"),
    ],
)
def test_too_little(mdesign, tmp_path, seconds, words):
    times, values = measured(seconds, centres=only("ambient_light"))["ambient_light"]
    file = write(tmp_path / "short.jsonl", {"ambient_light": (times[::4], values[::4])})
    code, out, err = mdesign("calibrate", file, "-o", tmp_path / "model.yaml")
    assert (code, out) == (1, "")
    assert words in err
    assert not (tmp_path / "model.yaml").exists()


def test_what_is_no_recording(mdesign, tmp_path):
    run = tmp_path / "run.jsonl"
    run.write_text("".join(to_lines([{"event": "start", "kind": "run", "format": FORMAT}])))
    other = tmp_path / "other.jsonl"
    start = {"event": "start", "kind": "recording", "format": FORMAT, "robot": "tester", "lidar_angle": 0.0}
    start |= {"time": "2026-01-01T12:00:00+00:00", "version": "0.1.0"}
    other.write_text("".join(to_lines([start, {"event": "sample", "sensor": "ground"}])))
    empty = tmp_path / "empty.jsonl"
    empty.write_text("".join(to_lines([start])))
    for file, words in (
        (run, "line 1: expected the log of a recording, found that of a run"),
        (other, "line 2: sample.time: missing key; expected a number >= 0 and <= 1e+06"),
        (empty, "expected a recording of sensors, found no sample"),
        (tmp_path / "none.jsonl", "cannot be read: No such file or directory"),
    ):
        code, _, err = mdesign("calibrate", file, "-o", tmp_path / "model.yaml")
        assert (code, words in err) == (1, True), err


def test_a_recording_counts_once(mdesign, tmp_path):
    file = write(tmp_path / "still.jsonl", measured(centres=only("turning")))
    again = tmp_path / "again.jsonl"
    again.write_bytes(file.read_bytes())
    for other in (file, again):
        code, _, err = mdesign("calibrate", file, other, "-o", tmp_path / "model.yaml")
        assert (code, f"{other} is the same recording as {file}" in err) == (1, True)


def test_without_its_picture_no_model_is_written(mdesign, tmp_path):
    file = write(tmp_path / "still.jsonl", measured(centres=only("turning")))
    output, plot = tmp_path / "model.yaml", tmp_path / "none" / "noise.png"
    code, _, err = mdesign("calibrate", file, "-o", output, "--plot", plot)
    assert (code, err.splitlines()[-1]) == (1, f"Error: {plot}: cannot be written: No such file or directory")
    assert not output.exists()


def test_an_existing_file_is_kept(mdesign, tmp_path):
    model = tmp_path / "robot.yaml"
    model.write_text("name: mine\n")
    code, _, err = mdesign("calibrate", tmp_path / "any.jsonl", "-o", model)
    assert (code, err) == (
        1,
        f"Error: {model}: expected a new file, found an existing one; give another name, or remove it\n",
    )
    assert model.read_text() == "name: mine\n"


def test_a_base_of_one_s_own(calibrate, tmp_path):
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "blind.yaml").write_text("schema: 1\nbase: mercator\nlidar: null\nneighbours: null\nbody: {mass: 3.0}\n")
    file = write(tmp_path / "still.jsonl", measured(centres=only("lidar", "turning")))
    sensors, notes, _ = calibrate(file, "--base", folder / "blind.yaml")
    assert "lidar" not in sensors
    assert "lidar: recorded, but blind has no such sensor" in notes
    assert load_robot_model(str(tmp_path / "model.yaml")).body.mass == 3.0


def test_the_seed_decides(mdesign, tmp_path):
    file = write(tmp_path / "still.jsonl", measured(centres=only("turning")))

    def run(seed, name):
        code, out, err = mdesign("calibrate", file, "--seed", seed, "-o", tmp_path / name)
        assert code == 0, err
        return out, (tmp_path / name).read_text()

    assert run(1, "a.yaml") == run(1, "b.yaml")
    assert run(1, "c.yaml") != run(2, "d.yaml")


def test_samples_that_came_at_one_time_are_left_out(calibrate, tmp_path):
    """As after the program was held up."""
    found = measured(centres=only("proximity", "velocity"))
    times, values = found["proximity"]
    found["proximity"] = np.full_like(times, 20.0), values
    sensors, notes, _ = calibrate(write(tmp_path / "still.jsonl", found))
    assert [*sensors] == ["velocity"]
    assert "proximity, still.jsonl: 8 of 8 channels left out: all their samples have the same time" in notes
