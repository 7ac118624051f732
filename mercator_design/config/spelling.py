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


def find(word: str, known: Collection[str]) -> str | None:
    """The known word that equals a word in either spelling; the exact spelling is preferred."""
    if word in known:
        return word
    wanted = folded(word)
    return next((each for each in known if folded(each) == wanted), None)


def nearest(word: str, known: Collection[str]) -> str:
    """The known word that is most similar to a word; empty if none is."""
    return next(iter(difflib.get_close_matches(word[:100], known, n=1)), "")


def folded(word: str) -> str:
    """A word in one spelling: equal for words that differ only in British or American spelling."""
    for british, american in _PAIRS:
        word = word.replace(british, american)
    return word
