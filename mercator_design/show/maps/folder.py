"""Writes maps to a folder."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mercator_design.mapping.plan.plans import Plan
from mercator_design.show.maps import formats
from mercator_design.show.maps.picture import picture_of
from mercator_design.show.maps.summary import figures
from mercator_design.system.files import write_bytes, write_text

SUMMARY = "summary.json"


def write_maps(folder: Path, plans: Sequence[Plan], messages: Sequence[str], caption: str = "") -> dict[str, Any]:
    """Write maps: pictures, files for other programs, and a summary, which is returned.

    Args:
        folder: Made if it is not there.
        plans: The maps, the largest first. The names of the files of others have their number.
        messages: Sentences on the maps.
        caption: Of the pictures.

    Raises:
        OSError: A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [file for number, plan in enumerate(plans) for file in _write(folder, number, plan, caption)]
    found = figures(plans, messages, [*files, folder / SUMMARY])
    write_text(folder / SUMMARY, json.dumps(found, indent=1) + "\n")
    return found


def _write(folder: Path, number: int, plan: Plan, caption: str) -> list[Path]:
    end = "" if number == 0 else f"-{number + 1}"
    picture = folder / f"map{end}.pgm"
    contents: dict[Path, bytes] = {
        folder / f"map{end}.png": picture_of(plan, caption),
        picture: formats.pgm_of(plan.occupancy),
        folder / f"map{end}.yaml": formats.yaml_of(plan.occupancy, picture.name).encode(),
        folder / f"walls{end}.geojson": formats.geojson_of(plan).encode(),
        folder / f"surfels{end}.csv": formats.surfels_csv(plan.pieces).encode(),
    }
    for way in plan.ways:
        name = re.sub(r"[^A-Za-z0-9]+", "-", way.name).strip("-") or "robot"
        path = folder / f"{name}{end}.tum"
        while path in contents:
            path = path.with_stem(f"{path.stem}-2")
        contents[path] = formats.tum_of(way).encode()
    for path, data in contents.items():
        write_bytes(path, data)
    return list(contents)
