"""British and American spelling: files and options may have either; the program writes its own."""

import difflib
from collections.abc import Collection

_PAIRS = (
    ("colour", "color"),
    ("grey", "gray"),
    ("centre", "center"),
    ("maximise", "maximize"),
    ("minimise", "minimize"),
    ("neighbour", "neighbor"),
    ("behaviour", "behavior"),
)

_SYNONYMS = {
    "circle": ("disc", "regular_polygon"),
    "disk": ("disc", "regular_polygon"),
    "round": ("disc", "regular_polygon"),
    "square": ("rectangle", "regular_polygon"),
    "rectangle": ("polygon",),
    "box": ("rectangle", "polygon"),
    "annulus": ("ring",),
    "donut": ("ring",),
    "triangle": ("regular_polygon", "polygon"),
    "hexagon": ("regular_polygon", "polygon"),
    "octagon": ("regular_polygon", "polygon"),
    "dodecagon": ("regular_polygon", "polygon"),
    "grid": ("tiles",),
    "checkerboard": ("tiles",),
    "half": ("half_plane",),
    "points": ("poses",),
    "fixed": ("poses",),
}
"""Other words for names in missions, each with the names that it may mean; the first known one is chosen."""


def find(word: str, known: Collection[str]) -> str | None:
    """The known word that equals a word in either spelling; the exact spelling is preferred."""
    if word in known:
        return word
    wanted = folded(word)
    return next((each for each in known if folded(each) == wanted), None)


def nearest(word: str, known: Collection[str]) -> str:
    """The known word that means the same as a word, or is most similar to it; empty if none is."""
    meant = [each for each in _SYNONYMS.get(word.lower(), ()) if each in known]
    return meant[0] if meant else next(iter(difflib.get_close_matches(word[:100], known, n=1)), "")


def folded(word: str) -> str:
    """A word in one spelling: equal for words that differ only in British or American spelling."""
    for british, american in _PAIRS:
        word = word.replace(british, american)
    return word
