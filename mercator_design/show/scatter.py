"""Scatter charts as SVG text, in the style of show/charts.py: points with error bars in both directions."""

from collections.abc import Sequence
from typing import NamedTuple

from mercator_design.show.charts import Axis, ChartFrame, number
from mercator_design.show.markup import escaped


class Spot(NamedTuple):
    """A point with its errors; if it is filled, its name is drawn beside it."""

    name: str
    x: float
    y: float
    x_error: float = 0.0
    y_error: float = 0.0
    colour: int = 0
    is_filled: bool = True


def scatter_chart(spots: Sequence[Spot], x: Axis, y: Axis, steps: Sequence[tuple[float, float]] = ()) -> str:
    """Points with bars of one error to each side.

    Args:
        spots: The points.
        x: The axis across.
        y: The axis upwards.
        steps: Corners of a line that is drawn below them, for example of a front.
    """
    frame = ChartFrame(
        x=x,
        y=y,
        xs=[value for one in spots for value in (one.x - one.x_error, one.x + one.x_error)],
        ys=[value for one in spots for value in (one.y - one.y_error, one.y + one.y_error)],
        height=300.0,
    )
    drawn, labelled = list[str](), list[tuple[float, float]]()
    if len(steps) > 1:
        path = "L".join(f"{a:.1f} {b:.1f}" for a, b in (frame.at(*corner) for corner in steps))
        drawn.append(f'<path d="M{path}" fill="none" stroke="var(--faint)" stroke-dasharray="4 3"/>')
    end = frame.width - frame.right
    for one in spots:
        colour = f"var(--k{one.colour})"
        (left, low), (right, high) = (
            frame.at(one.x + sign * one.x_error, one.y + sign * one.y_error) for sign in (-1.0, 1.0)
        )
        cx, cy = frame.at(one.x, one.y)
        told = f"{one.name}: {x.name} {number(one.x)} ± {number(one.x_error)}, "
        told += f"{y.name} {number(one.y)} ± {number(one.y_error)}"
        fill = colour if one.is_filled else "none"
        drawn.append(
            f'<g data-name="{escaped(one.name)}" data-x="{one.x:.6g}" data-y="{one.y:.6g}"><title>{escaped(told)}'
            f'</title><path d="M{left:.1f} {cy:.1f}H{right:.1f}M{cx:.1f} {low:.1f}V{high:.1f}" stroke="{colour}" '
            f'stroke-width="1.5" fill="none"/><circle cx="{cx:.1f}" cy="{cy:.1f}" r="4.5" fill="{fill}" '
            f'stroke="{colour}" stroke-width="1.5"/></g>'
        )
        if one.is_filled:
            width = 8.0 + 7.0 * len(one.name)
            place = f'x="{cx - 8:.1f}" text-anchor="end"' if cx > end - width else f'x="{cx + 8:.1f}"'
            is_free = all(abs(cx - a) > width or abs(cy - 7.0 - b) > 12.0 for a, b in labelled)
            labelled.append((cx, cy - 7.0 if is_free else cy + 16.0))
            drawn.append(f'<text class="tick" {place} y="{labelled[-1][1]:.1f}">{escaped(one.name)}</text>')
    return frame.svg(drawn)
