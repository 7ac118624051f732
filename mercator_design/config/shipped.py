"""The missions, robot models and flavours that come with the package, and the search for a file by name or path."""

import functools
import os
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from mercator_design.config import spelling
from mercator_design.config.building import is_name
from mercator_design.errors import MissionError, excerpt

PACKAGE = Path(__file__).parents[1]


def missions() -> dict[str, Path]:
    """Name -> file of the shipped missions, in the order of their names."""
    return _files(_folder())


def studies() -> dict[str, Path]:
    """Name -> file of the shipped studies, in the order of their names."""
    return _files(_folder() / "studies")


def robot_models() -> dict[str, Path]:
    """Name -> file of the shipped robot models, in the order of their names."""
    return _files(_folder() / "robots")


@functools.cache
def flavours() -> dict[str, Traversable]:
    """Name -> file of the shipped flavours, in the order of their names; robots have them in a zip file."""
    packaged = files(PACKAGE.name).joinpath("scenarios")
    folder = packaged if packaged.is_dir() else _folder()
    found = [one for one in folder.joinpath("flavours").iterdir() if one.name.endswith(".yaml")]
    return dict(sorted((one.name.removesuffix(".yaml"), one) for one in found))


def find(name_or_path: str | Path, shipped: Mapping[str, Path], kind: str) -> Path:
    """The file that a name or path means.

    Raises:
        MissionError: if it is neither, with the nearest known name.
    """
    text = str(name_or_path)
    return Path(text) if is_path(text) else shipped[named(text, shipped, kind)]


def is_path(text: str) -> bool:
    """Whether a text means a file: it looks like a path, or there is such a file."""
    return not is_name(text) or os.path.isfile(text)  # noqa: PTH113 - which raises if the name is too long


def named(text: str, shipped: Mapping[str, Path], kind: str) -> str:
    """The shipped name that a text means, in British or American spelling.

    Raises:
        MissionError: There is none, with the nearest known name.
    """
    name = spelling.find(text, shipped)
    if name is None:
        near = spelling.nearest(text, shipped)
        hint = f"did you mean '{near}'?" if near else f"shipped are: {', '.join(shipped)}"
        raise MissionError(f"{excerpt(text)}: no such {kind}; {hint}")
    return name


def _folder() -> Path:
    """The folder of shipped files: in the package, or beside it in a clone."""
    packaged = PACKAGE / "scenarios"
    return packaged if packaged.is_dir() else PACKAGE.parent / "scenarios"


def _files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.yaml"), key=lambda path: path.stem)}
