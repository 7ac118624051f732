import gzip
import json
from pathlib import Path

DATA = json.loads(gzip.decompress((Path(__file__).parents[1] / "data" / "maple_trees.json.gz").read_bytes()))
"""Behaviour trees of AutoMoDe-Maple, and what the original does with them."""
