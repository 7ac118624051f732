"""The settings of a Pi's firmware: config.txt with the files that it includes, and the sections for each model.

Sources: "config.txt" in the documents of Raspberry Pi, its conditional filters; the README of its overlays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from mercator_design.robot.setup.text import text_of

Model: TypeAlias = frozenset[str]
"""The sections of config.txt for a model."""

_ANY = {"all"}
# By the beginning of a name in the device tree, behind "Raspberry Pi "; longer ones first.
_MODELS: dict[str, Model] = {
    name: frozenset(sections.split())
    for name, sections in {
        "Compute Module 5": "pi5 cm5",
        "Compute Module 4S": "pi4 cm4s",
        "Compute Module 4": "pi4 cm4",
        "Compute Module 3 Plus": "pi3 cm3 cm3+",
        "Compute Module 3": "pi3 cm3",
        "Compute Module 0": "pi0 pi02 cm0",
        "Compute Module": "pi1 cm1",
        "500": "pi5 pi500",
        "400": "pi4 pi400",
        "Zero 2": "pi0 pi02",
        "Zero W": "pi0 pi0w",
        "Zero": "pi0",
        "3 Model A Plus": "pi3 pi3+",
        "3 Model B Plus": "pi3 pi3+",
        "5": "pi5",
        "4": "pi4",
        "3": "pi3",
        "2": "pi2",
        "Model": "pi1",
    }.items()
}
_WITHOUT_BLUETOOTH = {"pi1", "pi2", "cm1", "cm3"}
_NAMED = frozenset[str]().union(*_MODELS.values()) | {"none"}
_ON = {"", "1", "on", "yes", "true", "y"}
_MAX_DEPTH = 8  # of included files


@dataclass
class BootSettings:
    """Settings of the firmware for a model.

    values: The last value of each key.
    overlays: Names of the overlays.
    parameters: The last value of each parameter of the device tree.
    """

    values: dict[str, str] = field(default_factory=dict)
    overlays: set[str] = field(default_factory=set)
    parameters: dict[str, str] = field(default_factory=dict)

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter of the device tree is on."""
        return self.parameters.get(name, "off") in _ON


def models(name: str) -> list[Model]:
    """The models that a name in the device tree may be; if it is not known, all with Bluetooth."""
    found = next((model for start, model in _MODELS.items() if name.startswith(f"Raspberry Pi {start}")), None)
    return [found] if found is not None else [each for each in _MODELS.values() if has_bluetooth(each)]


def has_bluetooth(model: Model) -> bool:
    """Whether Bluetooth has the better UART by default, and the header the other one."""
    return not model & _WITHOUT_BLUETOOTH and model != {"pi0"}


def boot_settings(config: Path, model: Model, *, other_filters: bool) -> BootSettings:
    """Read the settings of config.txt for a model.

    Args:
        config: The file.
        model: The model.
        other_filters: Whether sections hold that do not depend on the model, for example on a pin or a screen.
    """
    found = BootSettings()
    for line in _Reader(model, other_filters).lines(config):
        key, _, value = line.partition("=")
        if key in {"dtoverlay", "device_tree_overlay"}:
            name = value.replace(":", ",").partition(",")[0]
            found.overlays.add(Path(name).name.removesuffix(".dtbo"))
        elif key in {"dtparam", "device_tree_param"}:
            for parameter in value.split(","):
                name, _, state = parameter.partition("=")
                found.parameters[name] = state.lower()
        else:
            found.values[key] = value
    return found


class _Reader:
    """Reads the lines that hold; an included file stands in the place of its line."""

    def __init__(self, model: Model, other_filters: bool) -> None:
        self._model, self._other_filters = model, other_filters
        self._is_model, self._is_rest = True, True  # whether the latest filters of both kinds hold

    def lines(self, path: Path, depth: int = 0) -> Iterator[str]:
        for line in text_of(path).splitlines():
            words = line.partition("#")[0].split()
            text = "".join(words)
            if text.startswith("["):
                self._enter(text.strip("[]").lower())
            elif self._is_model and self._is_rest and text:
                if words[0] == "include" and len(words) > 1 and depth < _MAX_DEPTH:
                    yield from self.lines(path.parent / words[1], depth + 1)
                else:
                    yield text

    def _enter(self, section: str) -> None:
        if section in _ANY:
            self._is_model = self._is_rest = True
        elif section in _NAMED:
            self._is_model = section in self._model
        else:
            self._is_rest = self._other_filters
