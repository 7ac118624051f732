"""A page of replays: one HTML file that needs nothing else."""

import html
import json
from collections.abc import Sequence
from importlib.resources import files

from mercator_design.view.replay import Replay

POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
"""The content security policy of our pages: they cannot ask for anything."""

_SCRIPTS = ("inflate.js", "viewer.js")


def viewer_script() -> str:
    """The viewer; it defines `MercatorReplay`."""
    return "\n".join(_asset(name) for name in _SCRIPTS)


def viewer_style() -> str:
    """The style of the viewer."""
    return _asset("viewer.css")


def script_json(data: object) -> str:
    """Data as JSON that is safe within a script element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def replay_page(replays: Sequence[Replay], title: str) -> str:
    """One HTML file that plays replays side by side, without a request."""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{html.escape(title)}</title>
<style>html, body {{ margin: 0; height: 100%; }}
{viewer_style()}</style></head>
<body><div id="replay"></div>
<script type="application/json" id="replays">{script_json(list(replays))}</script>
<script>{viewer_script()}
const replays = JSON.parse(document.getElementById("replays").textContent);
MercatorReplay.mount(document.getElementById("replay"), replays).then((player) => (window.player = player));
</script></body></html>
"""


def in_notebook(page: str, height: int = 720) -> str:
    """A page as a cell of a notebook: a frame of a height [pixels], apart from the notebook's own page."""
    style = f"width: 100%; height: {height}px; border: 0"
    return f'<iframe srcdoc="{html.escape(page)}" style="{style}" sandbox="allow-scripts"></iframe>'


def _asset(name: str) -> str:
    return files(__package__).joinpath("viewer", name).read_text(encoding="utf-8")
