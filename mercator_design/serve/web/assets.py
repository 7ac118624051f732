"""The files that pages load: scripts and styles, each at /assets/NAME?v=DIGEST, so that browsers keep them."""

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from fastapi import APIRouter, Response

from mercator_design.serve.http.problems import Missing
from mercator_design.show.charts import STYLE
from mercator_design.show.page import viewer_script, viewer_style
from mercator_design.show.report.page import asset as page_asset

router = APIRouter(include_in_schema=False)

_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_FOREVER = {"Cache-Control": "public, max-age=31536000, immutable"}


@dataclass(frozen=True, slots=True)
class Asset:
    """A file that pages load."""

    data: bytes
    kind: str
    address: str


@cache
def assets() -> MappingProxyType[str, Asset]:
    own = files(__package__).joinpath("assets")
    texts = {one.name: one.read_bytes() for one in own.iterdir() if one.name.endswith(tuple(_TYPES))}
    made = {
        "viewer.js": viewer_script(),
        "viewer.css": viewer_style(),
        "page.js": page_asset("page.js"),
        "charts.css": STYLE,
        "report.css": page_asset("page.css"),
    }
    texts |= {name: text.encode() for name, text in made.items()}
    found = {}
    for name, data in texts.items():
        kind = _TYPES[name[name.rindex(".") :]]
        address = f"/assets/{name}?v={hashlib.sha256(data).hexdigest()[:12]}"
        found[name] = Asset(data, f"{kind}; charset=utf-8", address)
    return MappingProxyType(found)


@router.get("/assets/{name}")
def asset(name: str) -> Response:
    found = assets().get(name)
    if found is None:
        raise Missing(f"there is no asset {name}")
    return Response(found.data, headers=_FOREVER, media_type=found.kind)
