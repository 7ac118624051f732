"""Arrays as few bytes, for the viewer: see `unpack` in viewer/viewer.js."""

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray


class PackedArrays:
    """Arrays (rows, columns), packed one after the other.

    layout: Name, kind and shape of each.
    """

    def __init__(self) -> None:
        self.layout: list[dict[str, Any]] = []
        self._bytes: list[bytes] = []

    def add(self, name: str, values: NDArray[Any]) -> None:
        """Add numbers from 0 to 255."""
        self._add(name, "bytes", values)
        self._bytes.append(np.ascontiguousarray(values, dtype=np.uint8).tobytes())

    def add_differences(self, name: str, values: NDArray[np.int64]) -> None:
        """Add 16-bit numbers: the differences along each row, first their low bytes, then their high bytes."""
        self._add(name, "delta16", values)
        differences = np.diff(values, axis=1, prepend=0).astype(np.uint16)
        self._bytes += [(differences & 255).astype(np.uint8).tobytes(), (differences >> 8).astype(np.uint8).tobytes()]

    def _add(self, name: str, kind: str, values: NDArray[Any]) -> None:
        rows, columns = values.shape
        self.layout.append({"name": name, "kind": kind, "rows": rows, "columns": columns})

    def text(self) -> str:
        """All arrays, deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._bytes), 9)).decode()
