"""The part of a document that a program makes, between two comments; and tables in such a part."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from mercator_design.system.files import write_text


class MadePart(NamedTuple):
    """Begins with `<!-- NAME: made by docs/MAKER -->`, ends with `<!-- end of the NAME -->`."""

    document: Path
    name: str
    maker: str

    def read(self) -> str:
        """What stands there.

        Raises:
            ValueError: if the document has no such part.
        """
        return self._divided()[1]

    def write(self, text: str) -> None:
        """Put a text there; errors are those of `read`."""
        before, _, after = self._divided()
        write_text(self.document, before + text + after)

    def _divided(self) -> tuple[str, str, str]:
        begin, end = f"<!-- {self.name}: made by docs/{self.maker} -->\n\n", f"\n<!-- end of the {self.name} -->\n"
        before, begun, rest = self.document.read_text().partition(begin)
        made, ended, after = rest.partition(end)
        if not begun or not ended:
            raise ValueError(f"{self.document}: expected a part between {begin.strip()} and {end.strip()}")
        return before + begin, made, end + after


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
