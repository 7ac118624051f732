"""British and American spelling: both are read, with this module; the program writes its own spelling."""

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
    """The one of some known words that a word is, in either spelling; a word itself goes before other spellings."""
    if word in known:
        return word
    wanted = folded(word)
    return next((each for each in known if folded(each) == wanted), None)


def folded(word: str) -> str:
    """Equal for words that differ in their spelling only, also in parts of them."""
    for british, american in _PAIRS:
        word = word.replace(british, american)
    return word
