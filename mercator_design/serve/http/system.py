"""Routes on the service itself: whether it is well, and figures for Prometheus."""

import shutil
import sqlite3
from collections.abc import Iterable, Mapping

from fastapi import APIRouter
from fastapi.responses import PlainTextResponse

from mercator_design import __version__
from mercator_design.errors import MercatorError
from mercator_design.serve.http.context import TheService
from mercator_design.serve.jobs.job import STATES

router = APIRouter(tags=["system"])

_PROMETHEUS = "text/plain; version=0.0.4; charset=utf-8"


@router.get("/healthz", response_class=PlainTextResponse)
async def health() -> PlainTextResponse:
    """Whether the service answers; for a supervisor of processes, which would start it again."""
    return PlainTextResponse("ok\n")


@router.get("/readyz", response_class=PlainTextResponse)
def readiness(service: TheService) -> PlainTextResponse:
    """Whether the service can work; for a proxy, which would send no requests."""
    try:
        service.index.counts()
        service.accounts.users.accounts()
        is_ready = service.supervisor.is_alive
    except (MercatorError, sqlite3.Error):
        is_ready = False
    return PlainTextResponse("ready\n") if is_ready else PlainTextResponse("not ready\n", 503)


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(service: TheService) -> PlainTextResponse:
    """Figures for Prometheus, in its text format."""
    counts = service.index.counts()
    answers = {str(status): number for status, number in sorted(service.accounts.answers.items()) if status}
    parts = [
        _metric("info", "gauge", "Version of the service.", {__version__: 1}, "version"),
        _metric("ready", "gauge", "Whether jobs are looked after.", {"": int(service.supervisor.is_alive)}),
        _metric("jobs", "gauge", "Jobs by state.", {state: counts.get(state, 0) for state in STATES}, "state"),
        _metric("http_answers_total", "counter", "Answers by status.", answers, "status"),
        _metric("event_streams", "gauge", "Open event streams.", {"": service.accounts.streams.counts.total()}),
        _metric("free_disk_bytes", "gauge", "Free disk for jobs.", {"": shutil.disk_usage(service.data).free}),
    ]
    return PlainTextResponse("".join(line for part in parts for line in part), media_type=_PROMETHEUS)


def _metric(name: str, kind: str, text: str, values: Mapping[str, float], label: str = "") -> Iterable[str]:
    """Lines of a metric with a value for each value of a label."""
    yield f"# HELP mercator_{name} {text}\n# TYPE mercator_{name} {kind}\n"
    for value, number in values.items():
        marks = f'{{{label}="{value}"}}' if label else ""
        yield f"mercator_{name}{marks} {number}\n"
