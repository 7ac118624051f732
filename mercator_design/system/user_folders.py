"""This user's folders for caches and settings."""

from pathlib import Path
from typing import Literal


def user_folder(kind: Literal["cache", "config"]) -> Path | None:
    """The user's folder of this program; None for a user without a home, as in a container that runs as any number."""
    import platformdirs  # a robot does not have it

    try:
        folder: Path = getattr(platformdirs, f"user_{kind}_path")("mercator_design")
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None  # some versions of platformdirs return ~/.cache then
