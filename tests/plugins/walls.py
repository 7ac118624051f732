"""The plugin and the flavour of the tutorial."""

import re
from pathlib import Path

_TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "your-own-behaviour.md"
_TEXT = _TUTORIAL.read_text()
PLUGIN = re.search(r"```python\n(.+?)```", _TEXT, re.DOTALL)[1]
FLAVOUR = re.search(r"```yml\n(.+?)```", _TEXT, re.DOTALL)[1]
LINE = (
    "--nstates 2 --s0 2 --gain0 0.5 --n0 1 --n0x0 0 --c0x0 2 --beta0x0 0.5 "
    "--s1 0 --rwm1 20 --n1 1 --n1x0 0 --c1x0 1 --p1x0 0.1"
)
"""A PFSM of the flavour: follow a wall; near one, explore for a second."""


def write(folder):
    """Write walls.py and walls.yaml."""
    (folder / "walls.py").write_text(PLUGIN)
    (folder / "walls.yaml").write_text(FLAVOUR)
