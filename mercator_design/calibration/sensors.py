"""The noise of each sensor of a robot model, fitted to selected measurements of recordings."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import stats

from mercator_design.arrays import Flags, Floats
from mercator_design.calibration.noise import Levels, Noise, fit_noise, levels_of
from mercator_design.calibration.scenes import MIN_DURATION, RobotRecording, Series, StillScene, read_recording
from mercator_design.errors import MercatorError
from mercator_design.robot.devices.samples import STANDARD_GRAVITY
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import Ground

MIN_SAMPLES = 100
"""Samples of a sensor, in addition to one for each channel in each scene."""

_MIN_OF_CHANNEL = 20
_PRESENT = 0.5  # minimum share of valid measurements of a channel
_FAR = 6.0  # standard deviations of an outlier from a channel's median
_MARGIN = 4.0  # standard deviations to the ends of the range, at least
_SLANT = 0.3  # standard deviations from one beam to the next, at most ...
_SIGNIFICANT = 3.0  # ... or standard errors of the difference, which are larger in a short scene
_SWEEP = 1e-4  # [rad] Larger variations of a beam's angle matter.
_DRIFT = 1e-9  # significance level of a drift
_FOLLOWING = 0.2  # correlation of a measurement with the next one
_UNDECIDED = 2.0  # difference of Akaike's criterion
_BAD = 0.05  # p-value
_MIN_STEP = 1e-3  # of the standard deviation; a smaller step makes no difference


class Sensor(NamedTuple):
    """A sensor with noise.

    key: The key of a robot model.
    recorded: The name in recordings.
    unit: The unit in robot models; empty if there is none.
    scale: The factor from values in recordings to this unit.
    """

    key: str
    recorded: str
    unit: str
    scale: float = 1.0


SENSORS = (
    Sensor("proximity", "proximity", "m"),
    Sensor("ground", "ground", "levels"),
    Sensor("lidar", "lidar", "m"),
    Sensor("ambient_light", "ambient_light", "lux"),
    Sensor("velocity", "velocity", "m/s"),
    Sensor("accelerometer", "acceleration", "g", 1.0 / STANDARD_GRAVITY),
    Sensor("gyroscope", "turning", "rad/s"),
    Sensor("imu", "attitude", "rad"),
    Sensor("locator", "position", "m"),
    Sensor("quaternion", "orientation", ""),
)
"""All recorded sensors. Their axes differ from the simulator's, which makes no difference to noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """The noise of a sensor.

    samples, channels, scenes: The numbers of used samples, of channels, counted in each scene, and of scenes.
    step: The difference of adjacent values; 0 if all are equal.
    noise: None if there is none, or it is less than a step; `why_none` has the reason.
    """

    sensor: Sensor
    samples: int
    channels: int
    scenes: int
    step: float
    noise: Noise | None
    why_none: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The noise of a robot, from recordings.

    base: The robot model with the sensors.
    sensors: The sensors with enough samples.
    unknown: The sensors with samples, but too few that can be used.
    notes: Notes on samples left out, and on possible mistakes.
    """

    base: RobotModel
    recordings: tuple[RobotRecording, ...]
    sensors: tuple[SensorNoise, ...]
    unknown: tuple[Sensor, ...]
    notes: tuple[str, ...]


def calibrate(paths: Sequence[Path], base: RobotModel, *, seed: int) -> Calibration:
    """Fit the noise of each sensor of a robot model to recordings of the robot at rest.

    Args:
        paths: The recordings.
        base: The robot model.
        seed: Seed of the simulated measurements, from which accuracy and quality of a fit are estimated.

    Raises:
        RobotError: if a file cannot be read, or is not a recording.
        MercatorError: if there are too few samples, or a recording is given twice.
    """
    recordings = tuple(map(read_recording, paths))
    for one, other in itertools.combinations(recordings, 2):
        if one.start == other.start:
            raise MercatorError(f"{other.path} is the same recording as {one.path}, which would count twice")
    scenes = [scene for recording in recordings for scene in recording.scenes]
    notes = [note for recording in recordings for note in _motion(recording)]
    robots = sorted({recording.start.robot for recording in recordings})
    if len(robots) > 1:
        notes.append(f"recordings of {', '.join(robots)}: what is fitted is the noise of all of them together")
    measured: list[SensorNoise] = []
    unknown: list[Sensor] = []
    for number, sensor in enumerate(SENSORS):
        part = getattr(base, sensor.key)
        if not any(sensor.recorded in scene.sensors for scene in scenes):
            continue
        if part is None or (isinstance(part, Ground) and part.gray):
            notes.append(f"{sensor.key}: recorded, but {base.name} has no such sensor")
            continue
        limits = getattr(part, "range", (0.0, 255.0))
        found = _measured(sensor, limits, scenes, np.random.default_rng([seed, number]), notes)
        if found is None:
            unknown.append(sensor)
        else:
            measured.append(found)
    if not measured:
        raise MercatorError("; ".join(["nothing to measure noise from", *notes]))
    return Calibration(
        base=base, recordings=recordings, sensors=tuple(measured), unknown=tuple(unknown), notes=tuple(notes)
    )


def _motion(recording: RobotRecording) -> Iterator[str]:
    for begin, end in recording.moves:
        yield f"{recording.path}: the robot was moved from {begin:.0f} to {end:.0f} s, which is left out"
    if not recording.scenes:
        found = f"found {recording.rest:.1f} s at most (recording: {recording.duration:.1f} s)"
        yield f"{recording.path}: expected a robot at rest for {MIN_DURATION:g} s, {found}"


def _measured(
    sensor: Sensor,
    limits: tuple[float, float],
    scenes: Sequence[StillScene],
    random: np.random.Generator,
    notes: list[str],
) -> SensorNoise | None:
    """The noise of a sensor; None if there are too few samples. Notes are added to `notes`."""
    channels: list[Floats] = []
    n_scenes = 0
    follow: list[tuple[float, float]] = []
    for scene in scenes:
        if sensor.recorded in scene.sensors:
            where = f"{sensor.key}, {scene.name}"
            values = _usable(scene.sensors[sensor.recorded], sensor.scale, limits, where, notes)
            channels += [channel[~np.isnan(channel)] for channel in values.T]
            follow.append(_following(values - _moments(values)[0]))
            n_scenes += values.shape[1] > 0
    samples = sum(map(len, channels))
    if samples - len(channels) < MIN_SAMPLES:
        expected = f"{MIN_SAMPLES + len(channels)} samples ({MIN_SAMPLES}, and one for each channel)"
        notes.append(
            f"{sensor.key}: expected at least {expected} that can be used, found {samples}"
            if channels
            else f"{sensor.key}: none of its samples can be used"
        )
        return None
    step = _step(channels)
    found = partial(SensorNoise, sensor=sensor, samples=samples, channels=len(channels), scenes=n_scenes, step=step)
    if step == 0.0:
        return found(noise=None, why_none="all samples of a channel are equal")
    levels = _counted(channels, step)
    if levels is None:
        return found(noise=None, why_none=f"less than the step of its values, {step:.3g}")
    noise = fit_noise(levels, random)
    notes += _warnings(sensor, noise)
    together, apart = map(sum, zip(*follow, strict=True))
    if together > _FOLLOWING * apart:
        notes.append(
            f"{sensor.key}: samples resemble those before them (correlation {together / apart:.2f}), so there is "
            "less to learn from than it seems"
        )
    return found(noise=noise)


def _warnings(sensor: Sensor, noise: Noise) -> Iterator[str]:
    if noise.aic_difference < _UNDECIDED:
        yield f"{sensor.key}: too few samples, or too large a step, to tell a Gaussian from a uniform distribution"
    if noise.p_value < _BAD:
        yield f"{sensor.key}: not quite {noise.family.name} (p = {noise.p_value:.2g}); --plot shows how far from it"


def _usable(series: Series, scale: float, limits: tuple[float, float], where: str, notes: list[str]) -> Floats:
    """The values (n, channels) of the channels that can be used; notes on the others are added to `notes`."""
    values = scale * series.values
    everything = np.ones(values.shape[1], dtype=bool)
    seen = np.sum(~np.isnan(values), axis=0)
    why = f"they measure nothing for more than {1.0 - _PRESENT:.0%} of the time"
    use = _kept(everything, seen >= max(_PRESENT * len(values), 1), why, where, notes)
    use = _kept(use, seen >= _MIN_OF_CHANNEL, f"fewer than {_MIN_OF_CHANNEL} samples", where, notes)
    far = _far_out(values, use)
    values = np.where(far, np.nan, values)
    if series.angles is not None and use.any():
        use = _kept(use, _is_flat(values, use), "what they see is slanting, or has an edge", where, notes)
        values = _without_sweep(values, series.angles)
    low, high = limits
    centres, sd = _moments(values)
    inside = (centres - _MARGIN * sd > low) & (centres + _MARGIN * sd < high)
    use = _kept(use, inside, f"too near to the ends of the range, {low:g} to {high:g}", where, notes)
    use = _kept(use, _is_spread(series.times, values), "all their samples have the same time", where, notes)
    use = _kept(use, *_steady(series.times, values, use), where, notes)
    if out := np.sum(far[:, use]):
        notes.append(f"{where}: {out} of {np.sum(seen[use])} samples left out: they lie far from the others")
    return values[:, use]


def _kept(use: Flags, good: Flags, why: str, where: str, notes: list[str]) -> Flags:
    """The good channels in use; a note with the number of others and the reason is added to `notes`."""
    if out := np.sum(use & ~good):
        notes.append(f"{where}: {out} of {len(use)} channels left out: {why}")
    return use & good


def _moments(values: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation of each channel; NaN for a channel without measurements."""
    n = np.sum(~np.isnan(values), axis=0)
    with np.errstate(invalid="ignore"):  # 0 / 0
        means = np.nansum(values, axis=0) / n
        return means, np.sqrt(np.nansum((values - means) ** 2, axis=0) / n)


def _far_out(values: Floats, use: Flags) -> Flags:
    """Which values of the channels in use are outliers: so far from their median that they cannot be usual noise.

    The standard deviation is that of a Gaussian with the same median distance, plus half a step because values are
    rounded: that of the channel, or that of all channels if it is larger.
    """
    far = np.zeros(values.shape, dtype=bool)
    if use.any():
        used = values[:, use]
        distances = np.abs(used - np.nanmedian(used, axis=0))
        usual = np.maximum(np.nanmedian(distances, axis=0), np.nanmedian(distances))
        step = _step([channel[~np.isnan(channel)] for channel in used.T])
        far[:, use] = distances > _FAR * (usual + 0.5 * step) / stats.norm.ppf(0.75)
    return far


def _is_flat(values: Floats, use: Flags) -> Flags:
    """Which beams measure nearly the same as their neighbours, so that their exact angle does not matter."""
    means, sd = _moments(values)
    steps = np.abs(means - np.roll(means, 1))
    n = np.maximum(np.sum(~np.isnan(values), axis=0), 1)
    limits = np.median(sd[use]) * np.maximum(_SLANT, _SIGNIFICANT * np.sqrt(1.0 / n + 1.0 / np.roll(n, 1)))
    like_before: Flags = steps <= limits
    return like_before & np.roll(like_before, -1)


def _without_sweep(values: Floats, angles: Floats) -> Floats:
    """The values of beams, without the variation due to angles that change from turn to turn."""
    off = angles - _moments(angles)[0]
    sweep = np.nansum(off**2, axis=0)
    slopes = np.nansum(off * (values - _moments(values)[0]), axis=0) / np.maximum(sweep, _SWEEP**2)
    return values - np.where(sweep > len(values) * _SWEEP**2, slopes, 0.0) * off


def _is_spread(times: Floats, values: Floats) -> Flags:
    """Which channels have measurements at more than one time."""
    return np.array([len(np.unique(times[~np.isnan(channel)])) > 1 for channel in values.T], dtype=bool)


def _steady(times: Floats, values: Floats, use: Flags) -> tuple[Flags, str]:
    """Which channels in use do not drift by more than their noise in a scene; and the largest drift, in words."""
    steady, worst = np.ones(values.shape[1], dtype=bool), 0.0
    for k in np.flatnonzero(use):
        there = ~np.isnan(values[:, k])
        time, channel = times[there], values[there, k]
        line = stats.linregress(time, channel)
        drift = abs(line.slope) * (times[-1] - times[0])
        if line.pvalue < _DRIFT and drift > np.std(channel - line.slope * time):
            steady[k], worst = False, max(worst, drift)
    return steady, f"they drift, by up to {worst:.2g} in {times[-1] - times[0]:.0f} s" if worst else ""


def _following(residuals: Floats) -> tuple[float, float]:
    """Numerator and denominator of the correlation of measurements with the next ones."""
    both = residuals[:-1] * residuals[1:]
    return float(np.nansum(both)), float(np.nansum(residuals**2))


def _step(channels: Sequence[Floats]) -> float:
    """The smallest difference of values of the same channel; 0 if all are equal."""
    gaps = np.concatenate([np.diff(np.unique(channel)) for channel in channels])
    if not len(gaps):
        return 0.0
    sd = math.sqrt(np.mean(np.concatenate([channel - channel.mean() for channel in channels]) ** 2))
    return max(float(gaps.min()), _MIN_STEP * sd)


def _counted(channels: Sequence[Floats], step: float) -> Levels | None:
    """The counted values of channels, each minus its minimum; None if no channel has three levels."""
    numbers = np.repeat(np.arange(len(channels)), [len(channel) for channel in channels])
    levels = levels_of(numbers, np.concatenate([channel - channel.min() for channel in channels]), step)
    return levels if np.bincount(levels.channel).max() >= 3 else None
