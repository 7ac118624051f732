"""A page of replays: one HTML file that needs nothing else."""

import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.markup import escaped
from mercator_design.show.replay import replay_of
from mercator_design.system.files import write_text

POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
"""The content security policy of our pages: they cannot ask for anything."""

_SCRIPTS = ("inflate.js", "viewer.js")
_PLAY = """const replays = JSON.parse(document.getElementById("replays").textContent);
MercatorReplay.mount(document.getElementById("replay"), replays, true).then((player) => (window.player = player));
"""


def viewer_script() -> str:
    """The viewer; it defines `MercatorReplay`."""
    return "\n".join(_asset(name) for name in _SCRIPTS)


def viewer_style() -> str:
    return _asset("viewer.css")


def script_json(data: object) -> str:
    """Data as JSON that is safe within a script element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def document(title: str, style: str, body: str, script: str, *, policy: str = POLICY) -> str:
    """A page in HTML; only the title is escaped here."""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{escaped(title)}</title>
<style>{style}</style></head>
<body>{body}
<script>{script}</script></body></html>
"""


class ReplayPage:
    """One HTML file that plays experiments side by side, without a request; a notebook shows it."""

    def __init__(self, shown: Sequence[ShownExperiment]) -> None:
        replays = script_json([replay_of(one) for one in shown])
        style = f"html, body {{ margin: 0; height: 100%; }}\n{viewer_style()}"
        body = f'<div id="replay"></div>\n<script type="application/json" id="replays">{replays}</script>'
        self.html = document(shown[0].title, style, body, f"{viewer_script()}\n{_PLAY}")

    def save(self, path: str | Path) -> None:
        """Write the page.

        Raises:
            OSError: The file cannot be written.
        """
        write_text(Path(path), self.html)

    def _repr_html_(self) -> str:
        """The cell of a notebook: a frame, apart from the notebook's own page."""
        style = "width: 100%; height: 720px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.html)}" style="{style}" sandbox="allow-scripts"></iframe>'


def _asset(name: str) -> str:
    return files(__package__).joinpath("viewer", name).read_text(encoding="utf-8")
