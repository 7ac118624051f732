"""The plugin, the flavour and the machine of the example with odometry."""

import re
from pathlib import Path

_TEXT = (Path(__file__).parents[2] / "docs" / "tutorials" / "back-to-a-spot.md").read_text()
_NAMES = {"spots.py": "python", "spots.yaml": "yml", "spots.txt": "text"}


def write(folder):
    """Write spots.py, spots.yaml and spots.txt."""
    for name, language in _NAMES.items():
        (folder / name).write_text(re.search(rf"```{language}\n(.+?)```", _TEXT, re.DOTALL)[1])
