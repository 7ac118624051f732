"""Files of the system."""

from pathlib import Path


def text_of(path: Path) -> str:
    """The text of a file; empty if it cannot be read."""
    try:
        return path.read_text(errors="replace").replace("\0", " ")
    except OSError:
        return ""
