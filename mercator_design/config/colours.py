"""The colours of floors, labels and lamps, by name."""

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from mercator_design.config.schema import Range

ColourName: TypeAlias = Literal["black", "white", "gray", "red", "green", "blue", "yellow", "magenta", "cyan", "orange"]
Channel: TypeAlias = Annotated[int, Range(0, 255)]
Levels: TypeAlias = tuple[Channel, Channel, Channel]
"""Red, green and blue as a user writes them."""
Colour: TypeAlias = ColourName | Levels
RGB: TypeAlias = tuple[float, float, float]

COLOURS: Mapping[ColourName, RGB] = {
    # As ARGoS defines them, but gray: the floors of its missions use GRAY50.
    "black": (0.0, 0.0, 0.0),
    "white": (255.0, 255.0, 255.0),
    "gray": (127.0, 127.0, 127.0),
    "red": (255.0, 0.0, 0.0),
    "green": (0.0, 255.0, 0.0),
    "blue": (0.0, 0.0, 255.0),
    "yellow": (255.0, 255.0, 0.0),
    "magenta": (255.0, 0.0, 255.0),
    "cyan": (0.0, 255.0, 255.0),
    "orange": (255.0, 140.0, 0.0),
}

LABELS: tuple[ColourName, ...] = ("black", "gray", "white", "red", "green", "blue", "yellow")
"""The colours that modules know. A robot distinguishes these if it does not know the colours of its floor."""

STATE_COLOURS: tuple[Levels, Levels, Levels, Levels] = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167))
"""Colour of a robot's lamps in each state of its PFSM, by Okabe and Ito: colour-blind people can distinguish them."""


def hex_of(red: float, green: float, blue: float) -> str:
    """A colour as HTML and matplotlib write it."""
    return f"#{round(red):02x}{round(green):02x}{round(blue):02x}"


def rgb(colour: Colour) -> RGB:
    """Red, green and blue, each in 0 .. 255."""
    if isinstance(colour, str):
        return COLOURS[colour]
    red, green, blue = colour
    return float(red), float(green), float(blue)
