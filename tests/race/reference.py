"""What R's irace 4.4.3 does, measured; see data/README.md. Configurations and instances count from 1."""

import gzip
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

DATA = Path(__file__).parent.parent / "data"


@cache
def load(name: str) -> Any:
    with gzip.open(DATA / f"{name}.json.gz", "rt", encoding="utf-8") as file:
        return json.load(file)


def table(rows) -> np.ndarray:
    """Costs with NaN where there are none."""
    return np.array([[math.nan if cost is None else float(cost) for cost in row] for row in rows])


def configuration(row) -> dict:
    """The values of a row of irace's table of configurations."""
    return {name: value for name, value in row.items() if not name.startswith(".") and value is not None}
