"""Writes maps to a folder."""

import contextlib
import itertools
import json
import re
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

from mercator_design.mapping.plan.plans import Plan
from mercator_design.show.maps import formats
from mercator_design.show.maps.page import REPORT, page_of
from mercator_design.show.maps.picture import picture_of
from mercator_design.show.maps.summary import figures
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.system.files import replacing

SUMMARY = "summary.json"

_SUFFIXES = (".png", ".pgm", ".yaml", ".geojson", ".csv", ".tum")  # of the files of a map
_MAX_NAME = 60  # characters of a robot's name in that of a file
_ROBOT_MODEL = "mercator"  # whose shape the replay has


def made_files(folder: Path) -> list[Path]:
    """The files in a folder that a map may replace or remove, by their endings."""
    try:
        return sorted(path for path in folder.iterdir() if path.suffix in {*_SUFFIXES, ".html", ".json"})
    except OSError:
        return []


def write_maps(
    folder: Path, plans: Sequence[Plan], messages: Sequence[str], caption: str = "", seed: int = 0
) -> dict[str, Any]:
    """Write maps: a page, pictures, files for other programs, and a summary, which is returned.

    Files of an earlier map in the folder, which its summary names, are replaced or removed.

    Args:
        folder: Made if it is not there.
        plans: The maps, the largest first. The names of the files of others have their number.
        messages: Sentences on the maps.
        caption: Of the pictures: the command that made the maps.
        seed: Of the places whose relations are compared with the truth.

    Raises:
        OSError: A file cannot be written.
    """
    pictures = [picture_of(plan, caption) for plan in plans]
    contents: dict[Path, bytes] = {}
    for number, (plan, picture) in enumerate(zip(plans, pictures, strict=True)):
        contents |= _contents(folder, number, plan, picture, {path.stem.lower() for path in contents})
    found = figures(plans, messages, [*contents, folder / REPORT, folder / SUMMARY], seed)
    page = page_of(plans, found, pictures, load_robot_model(_ROBOT_MODEL), caption)
    contents |= {folder / REPORT: page.encode(), folder / SUMMARY: f"{json.dumps(found, indent=1)}\n".encode()}
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    before = _written_before(folder)
    try:
        _write(contents)
    except BaseException:
        if is_new:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise
    for path in before - contents.keys():
        path.unlink(missing_ok=True)
    return found


def _write(contents: Mapping[Path, bytes]) -> None:
    """Write files together: if the disk has no room for one of them, none is replaced."""
    with contextlib.ExitStack() as stack:
        for path, data in contents.items():
            file = stack.enter_context(replacing(path))
            file.write(data)
            file.flush()


def _written_before(folder: Path) -> set[Path]:
    """The files of an earlier map in the folder, by its summary."""
    try:
        names = json.loads((folder / SUMMARY).read_text())["files"]
        return {folder / Path(name).name for name in names if Path(name).suffix in _SUFFIXES}
    except (OSError, ValueError, LookupError, TypeError):
        return set()


def _contents(folder: Path, number: int, plan: Plan, picture: bytes, taken: set[str]) -> dict[Path, bytes]:
    """The files of a map; `taken` are the names of others, in lower case and without endings."""
    end = "" if number == 0 else f"-{number + 1}"
    cells = folder / f"map{end}.pgm"
    contents: dict[Path, bytes] = {
        folder / f"map{end}.png": picture,
        cells: formats.pgm_of(plan.occupancy),
        folder / f"map{end}.yaml": formats.yaml_of(plan.occupancy, cells.name).encode(),
        folder / f"walls{end}.geojson": formats.geojson_of(plan).encode(),
        folder / f"keyframes{end}.csv": formats.keyframes_csv(plan).encode(),
        folder / f"surfels{end}.csv": formats.surfels_csv(plan.pieces).encode(),
    }
    for way in plan.ways:
        name = _file_name(way.name, end, taken | {path.stem.lower() for path in contents})
        contents[folder / f"{name}.tum"] = formats.tum_of(way).encode()
    return contents


def _file_name(robot: str, end: str, taken: Container[str]) -> str:
    """A name of a file, which no other one has in a file system that does not tell upper from lower case."""
    name = (re.sub(r"[^A-Za-z0-9]+", "-", robot)[:_MAX_NAME].strip("-") or "robot") + end
    numbered = (name if number == 1 else f"{name}-{number}" for number in itertools.count(1))
    return next(one for one in numbered if one.lower() not in taken)
