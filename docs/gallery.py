"""Draws every shipped mission into docs/pictures/missions/, and the gallery of docs/reference/shipped-missions.md.

Run: python docs/gallery.py
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from docs.made_part import MadePart, table
from mercator_design.config import shipped
from mercator_design.missions.mission import load_mission
from mercator_design.results.experiments.preview import preview_of
from mercator_design.show.pictures.preview import save_preview
from mercator_design.sim.simulate import Simulator

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures" / "missions"
GALLERY = MadePart(ROOT / "docs" / "reference" / "shipped-missions.md", "gallery", "gallery.py")
COLUMNS = 4


def gallery(names: list[str]) -> str:
    """Pictures of some missions that lead to their files."""
    cells = [f"[![{name}](../pictures/missions/{name}.png)](../../scenarios/{name}.yaml)" for name in names]
    cells += [""] * (-len(cells) % COLUMNS)
    return table([""] * COLUMNS, [cells[first : first + COLUMNS] for first in range(0, len(cells), COLUMNS)])


def draw(name: str, path: Path) -> None:
    """The picture of a mission in 256 colours, which is a quarter of what `mdesign missions preview` writes."""
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        save_preview(picture, preview_of(Simulator(load_mission(name)), seed=1))
        with Image.open(picture) as image:
            image.convert("RGB").quantize(256, method=Image.Quantize.FASTOCTREE).save(path, optimize=True)


def main() -> None:
    names = list(shipped.missions())
    PICTURES.mkdir(exist_ok=True)
    for old in PICTURES.glob("*.png"):
        if old.stem not in names:
            old.unlink()
    for name in names:
        draw(name, PICTURES / f"{name}.png")
    GALLERY.write(gallery(names))
    size = sum(path.stat().st_size for path in PICTURES.glob("*.png"))
    print(f"{PICTURES}: {len(names)} pictures, {size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
