"""What the makers' own programs send, from recordings of them."""

import gzip
import json
from pathlib import Path

_DATA = Path(__file__).parents[1] / "data"


def _read(name):
    with gzip.open(_DATA / f"robot_{name}.json.gz") as file:
        return json.load(file)


def sdk(name):
    """Frames that the RVR's SDK sends in a sequence of calls."""
    (found,) = [sequence for sequence in _read("rvr")["encode_sequences"] if sequence["name"] == name]
    return [bytes.fromhex(frame) for frame in found["hex"]]


def ydlidar_sessions():
    """By program: times [s], and what the YDLidar SDK sends then to start a scan."""
    return {
        name: [(time, bytes.fromhex(sent)) for time, sent in session]
        for name, session in _read("ydlidar")["sessions"].items()
    }
