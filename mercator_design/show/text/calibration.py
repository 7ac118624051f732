"""The noise of a robot at rest: as a table, as JSON, as a picture, as a robot model."""

import json
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mercator_design.calibration.noise import CONFIDENCE, SIMULATIONS, Noise
from mercator_design.calibration.sensors import Calibration, SensorNoise
from mercator_design.errors import printable
from mercator_design.show.pictures.figures import house_style, save_figure
from mercator_design.show.text.columns import aligned

_COLUMNS = 3  # of a picture
_BARS = 40
_DENSITY, _FOUND = "#d55e00", "#b9d3e6"


def calibration_page(calibration: Calibration) -> str:
    """A line for each sensor."""
    rows: list[tuple[object, ...]] = [
        ("sensor", "samples", "scenes", "noise", f"at {CONFIDENCE:.0%}", "AIC of the other", "fit: p")
    ]
    rows += [(one.sensor.key, one.samples, one.scenes, *_cells(one)) for one in calibration.sensors]
    return "\n".join(aligned(rows))


def calibration_json(calibration: Calibration, seed: int) -> str:
    """The noise as JSON, with all digits and notes."""
    return json.dumps(
        {
            "base": calibration.base.name,
            "recordings": [str(recording.path) for recording in calibration.recordings],
            "seed": seed,
            "sensors": [_sensor_data(one) for one in calibration.sensors],
            "unknown": [sensor.key for sensor in calibration.unknown],
            "notes": calibration.notes,
        },
        indent=2,
    )


def model_text(calibration: Calibration, base: str, name: str | None) -> str:
    """A robot model with only the noise, and its origin in comments."""
    lines = ["# Noise measured on a robot at rest, by `mdesign calibrate` from"]
    for recording in calibration.recordings:
        start = recording.start
        lines.append(f"#   {recording.path.name}: {start.robot}, {start.time}, {recording.duration:.0f} s")
    lines += [
        f"# In brackets: the interval at {CONFIDENCE:.0%}; p, by {SIMULATIONS} simulations, of a fit as bad by chance.",
        "# All other keys are those of the base.",
    ]
    text = "".join(f"{printable(line)}\n" for line in lines) + "schema: 1\n"
    if name is not None:
        text += f"name: {json.dumps(name)}\n"
    text += f"base: {json.dumps(base)}\n"
    for one in calibration.sensors:
        if one.noise is None and getattr(calibration.base, one.sensor.key).noise is None:
            continue
        text += f"{one.sensor.key}:\n  noise: {_yaml_value(one)}\n"
    for sensor in calibration.unknown:
        text += f"# {sensor.key}: too little that can be used; as in the base\n"
    return text


def save_noise(path: Path, calibration: Calibration, *, caption: str) -> None:
    """Draw a histogram of the noise of each sensor, and the fitted distribution, with a caption below.

    The suffix of the path, .png or .svg, is the format.

    Raises:
        OSError: The picture cannot be written.
    """
    noisy = [(one, one.noise) for one in calibration.sensors if one.noise is not None]
    rows = max(1, math.ceil(len(noisy) / _COLUMNS))
    with house_style():
        figure = Figure(figsize=(2.6 * min(_COLUMNS, max(1, len(noisy))), 2.1 * rows), layout="constrained")
        for number, (one, noise) in enumerate(noisy, start=1):
            axes = figure.add_subplot(rows, min(_COLUMNS, len(noisy)), number)
            _draw(axes, one, noise)
            if number == 1:
                figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
        save_figure(path, figure, caption)


def _draw(axes: Axes, one: SensorNoise, noise: Noise) -> None:
    """A histogram with bars of whole steps, and the density of the noise after rounding."""
    levels = noise.levels
    found = levels.level - noise.centres[levels.channel]
    reach = float(np.abs(found).max()) + 0.5 * levels.step
    width = levels.step * max(1, round(2.0 * reach / (_BARS * levels.step)))
    bars = math.ceil(reach / width + 0.5)
    edges = width * (np.arange(2 * bars) - bars + 0.5)
    axes.hist(
        found,
        bins=[*edges],
        weights=levels.count,
        density=True,
        color=_FOUND,
        edgecolor="white",
        linewidth=0.3,
        label="measured",
    )
    x = np.linspace(edges[0], edges[-1], 500)
    below, above = (noise.family.cumulative(x + side * levels.step, noise.parameter) for side in (-0.5, 0.5))
    density = (above - below) / levels.step
    axes.plot(x, density, color=_DENSITY, linewidth=1.0, label="fitted")
    axes.set_yticks([])
    axes.xaxis.set_major_locator(MaxNLocator(4, symmetric=True))
    axes.tick_params(length=2.0, width=0.6, pad=2.0)
    axes.set_xlabel(f"noise [{one.sensor.unit}]" if one.sensor.unit else "noise", labelpad=1.0)
    axes.set_title(f"{one.sensor.key}, n={one.samples}\n{_noise_text(noise)}, p={noise.p_value:.2g}", fontsize=7.5)


def _cells(one: SensorNoise) -> tuple[object, ...]:
    if one.noise is None:
        return (f"none: {one.why_none}", None, None, None)
    noise, unit = one.noise, one.sensor.unit
    low, high = noise.interval
    return (
        f"{_noise_text(noise)} {unit}".strip(),
        f"{low:.4g} to {high:.4g}",
        f"{noise.aic_difference:+.3g}",
        f"{noise.p_value:.2g}",
    )


def _noise_text(noise: Noise) -> str:
    return f"{noise.family.name}, {noise.family.parameter.replace('_', ' ')} {noise.parameter:.4g}"


def _yaml_value(one: SensorNoise) -> str:
    if one.noise is None:
        return f"null  # {one.why_none}; {one.samples} samples"
    noise = one.noise
    low, high = noise.interval
    value = f"{{distribution: {noise.family.name}, {noise.family.parameter}: {noise.parameter:.4g}}}"
    unit = f"[{one.sensor.unit}] " if one.sensor.unit else ""
    return f"{value}  # {unit}({low:.4g} to {high:.4g}); p = {noise.p_value:.2g}; {one.samples} samples"


def _sensor_data(one: SensorNoise) -> dict[str, object]:
    noise = one.noise
    return {
        "sensor": one.sensor.key,
        "unit": one.sensor.unit,
        "samples": one.samples,
        "channels": one.channels,
        "scenes": one.scenes,
        "step": one.step,
        "why_none": one.why_none,
        "distribution": None if noise is None else noise.family.name,
        "parameter": None if noise is None else noise.parameter,
        "interval": None if noise is None else noise.interval,
        "aic_difference": None if noise is None else noise.aic_difference,
        "p_value": None if noise is None else noise.p_value,
    }
