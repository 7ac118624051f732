"""Reading data for a benchmark: JSON, gzip'd or not."""

import gzip
import json
import zlib
from pathlib import Path
from typing import Any

from mercator_design.errors import MercatorError


def read_json(file: Path, error: type[MercatorError]) -> Any:
    """The content of a file.

    Raises:
        error: naming the file, if it cannot be read or is not JSON.
    """
    try:
        content = file.read_bytes()
    except OSError as reason:
        raise error(f"{file}: cannot be read: {reason.strerror or reason}") from None
    try:
        return json.loads(gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content)
    except (OSError, EOFError, zlib.error) as reason:
        raise error(f"{file}: damaged gzip: {reason}") from None
    except (ValueError, RecursionError) as reason:
        raise error(f"{file}: expected JSON, gzip'd or not: {reason}") from None
